"""Wanted shapes: what is refused before a piece is simulated, and how a search goes on."""

import pytest
from click.testing import CliRunner

import knitlab as kl
from knitlab.cli import main
from tests.refusals import refused

SQUARE = kl.Outline.of_widths([0, 40], [40, 40])


def test_a_machine_that_is_not_known_is_refused_before_anything_is_simulated(tmp_path):
    with refused("machine", "needels"):
        kl.shape(SQUARE, n_stripe=2, n_subunit=8, machine=["needels=200"], results=tmp_path)
    assert not [*tmp_path.rglob("*.nc")]


@pytest.mark.slow
def test_a_target_below_a_unit_cell_is_refused(tmp_path):
    """It would be less than a unit cell from any piece, and so be met by it."""
    tiny = kl.Outline.of_widths([0, 4], [3, 3])
    with refused("target", "3 × 4 mm", "n_subunit"):
        kl.shape(tiny, n_stripe=2, n_subunit=8, results=tmp_path)


@pytest.mark.slow
def test_a_target_wider_than_the_machine_is_refused_before_the_search(tmp_path):
    wide = kl.Outline.of_widths([0, 40], [900, 900])
    with refused("target", "900 mm", "360"):
        kl.shape(wide, n_stripe=2, n_subunit=8, results=tmp_path)
    assert len([*tmp_path.rglob("*.nc")]) == 1


def test_electrodes_of_a_workflow_are_not_left_out_silently(tmp_path):
    with refused("sensor", "electrodes", "without"):
        kl.shape(SQUARE, "sensor", n_stripe=4, n_subunit=16, results=tmp_path)


def test_a_piece_of_the_dynamics_is_refused(tmp_path):
    with refused("method", "dynamics", "equilibrium"):
        kl.shape(SQUARE, n_stripe=2, n_subunit=8, method="dynamics", results=tmp_path)
    assert not [*tmp_path.rglob("*.nc")]


def test_an_interrupted_search_says_how_it_goes_on(monkeypatch, tmp_path):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    target = tmp_path / "square.csv"
    target.write_text("length [mm],width [mm]\n0,40\n40,40\n", encoding="utf-8")
    monkeypatch.setattr(kl, "shape", interrupted)
    done = CliRunner().invoke(main, ["shape", str(target)])
    assert done.exit_code == 1
    assert "run again" in done.output
