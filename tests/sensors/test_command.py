"""The command ``sensing``: its three tables, and exit codes of bad input."""

import pytest
from click.testing import CliRunner

import knitlab as kl
from knitlab.cli import main
from tests.sensors.test_selectivity import SENSOR

ONE = ["--select", "n_stripe=4", "--select", "n_subunit=16"]
STRETCHED = ["--select", "applied_strain=0.1"]  # where its layers do not touch


def run(*words):
    return CliRunner().invoke(main, ["sensing", SENSOR, *words])


@pytest.mark.slow
def test_a_matrix_is_printed_and_drawn(tmp_path):
    file = tmp_path / "matrix.png"
    said = run(*ONE, "--electrode", "w1", "--electrode", "w2", "-o", str(file))
    assert said.exit_code == 0, said.output
    row = said.stdout.splitlines()[1].split()
    relaxed = kl.open_cube(SENSOR).sel(n_stripe=4, n_subunit=16, applied_strain=0)
    capacitance = f"{relaxed['capacitance'].item():.4g}"
    assert row == ["0", "w1", capacitance, f"-{capacitance}"]
    assert file.is_file()


@pytest.mark.slow
@pytest.mark.nightly
def test_gauge_factors_and_cross_talk_are_printed_and_drawn(tmp_path):
    for words in (STRETCHED, ["--sensor", "w1-w2", "--sensor", "w3-w4"]):
        file = tmp_path / f"{len(words)}.png"
        said = run(*ONE, *words, "-o", str(file))
        assert said.exit_code == 0, said.output
        assert file.is_file()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--electrode", "w1", "--electrode", "w2"], "20 designs"),
        ([*ONE, "--sensor", "w1"], "electrode ''"),
        ([*ONE, "--sensor", "w1-w9"], "4 ridges"),
        ([*ONE, "--electrode", "w1", "--sensor", "w1-w2"], "--electrode"),
        ([*ONE, "--select", "cell_x=1"], "cell_x"),
        ([*ONE, "--electrode", "w1", "--where", "n_stripe > 2"], "one design"),
    ],
)
def test_bad_input_has_exit_code_2(words, said):
    result = run(*words)
    assert result.exit_code == 2, result.output
    assert said in result.output
