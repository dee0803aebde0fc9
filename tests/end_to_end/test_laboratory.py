"""The tutorial of the laboratory, command by command."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from knitlab.cli import main
from knitlab.cubes.cube_file import open_cube
from tests.end_to_end.test_documentation import examples

ROOT = Path(__file__).parents[2]
PAGE = "docs/tutorials/experiment.md"
REFERENCE = ROOT / "results" / "reference" / "laboratory"
QUICK = ("import", "query", "compare")
"""Commands that simulate nothing."""


@pytest.fixture
def results_folder(tmp_path, monkeypatch):
    """A folder like the repository that already contains the simulation of the tutorial."""
    shutil.copytree(ROOT / "workflows", tmp_path / "workflows")
    shutil.copytree(REFERENCE, tmp_path / "results" / "laboratory")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.slow
def test_the_tutorial_shows_the_output_of_its_commands(results_folder):
    quick = [example for example in examples(PAGE) if example.words[0] in QUICK]
    assert [example.words[0] for example in quick] == [*["import"] * 3, "query", "compare"]
    for example in quick:
        result = CliRunner().invoke(main, example.words)
        assert result.exit_code == 0, result.output
        assert [line.rstrip() for line in result.stdout.splitlines()] == [*example.printed]


@pytest.mark.slow
@pytest.mark.nightly
def test_the_overlay_is_drawn_of_both(results_folder):
    for kind in ("markers", "tensile", "capacitance"):
        words = ["import", kind, "workflows/laboratory/synthetic_4_16.toml"]
        assert CliRunner().invoke(main, words).exit_code == 0
    cube = open_cube("results/synthetic_4_16")
    assert cube.attrs["synthetic"].startswith("yes")
    assert "synthetic" in str(cube["source"].item())
    # Two corners have no marker: their five unit cells are always missing.
    assert (cube["cells_lost"] >= 5).all()
    assert np.isfinite(cube["mean_strain_xx"]).all()
    for kind in ("curves", "auxetic", "tension", "sensor", "capacitors"):
        words = ["map", kind, "results/laboratory", "results/synthetic_4_16"]
        result = CliRunner().invoke(main, [*words, "--select", "cycle=1", "-o", f"{kind}.png"])
        assert result.exit_code == 0, result.output
