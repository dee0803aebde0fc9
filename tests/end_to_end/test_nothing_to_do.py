"""A run with nothing to do does nothing, and a figure is drawn again only if it changed."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import xarray as xr
from click.testing import CliRunner

from knitlab.cli import main
from knitlab.figures.drawing import draw_figure
from knitlab.figures.figure_files import is_drawn
from knitlab.runs.recorded_plan import same_plan
from knitlab.runs.status import finished_cube

SETTINGS = ("n_stripe=4", "n_subunit=8", "strain_max=0.06", "robustness=0")
WORDS = ["run", "periodic", *(word for text in SETTINGS for word in ("--set", text))]


def ran(results, *words):
    said = CliRunner().invoke(main, [*WORDS, "--workers", "0", "--results", str(results), *words])
    assert said.exit_code == 0, said.output
    return said.output


def written(results):
    """Modification time of each file of a results folder."""
    files = [*results.rglob("*.n[cp]*"), *results.rglob("*.p*")]
    return {path: path.stat().st_mtime_ns for path in files}


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    results = tmp_path_factory.mktemp("finished")
    ran(results)
    return results


@pytest.fixture
def results(finished, tmp_path):
    """A copy of the finished results, with the times at which they were written."""
    return Path(shutil.copytree(finished, tmp_path / "results"))


@pytest.mark.slow
def test_a_second_run_prints_the_same_and_writes_nothing(results):
    before = written(results)
    assert len(before) == 5  # case, cube, three figures
    again = ran(results)
    assert again.splitlines()[0] == "0 cases simulated, 1 already there"
    assert again.count("figure  ") == 3
    assert written(results) == before


@pytest.mark.slow
def test_a_second_run_imports_none_of_the_slow_libraries(results):
    words = [*WORDS, "--results", str(results)]
    program = (
        "import sys; from knitlab.cli import main\n"
        f"main({words!r}, standalone_mode=False)\n"
        "print({'jax', 'matplotlib'} & set(sys.modules))"
    )
    said = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert said.stdout.splitlines()[-1] == "set()", said.stderr


def test_a_finished_run_refuses_what_is_invalid(results):
    for words in (["--set", "foo"], ["--set", "foo=3"], ["--case-timeout", "1e99"]):
        said = CliRunner().invoke(main, [*WORDS, "--results", str(results), *words])
        assert said.exit_code == 2, said.output


def test_only_a_figure_that_is_missing_is_drawn(results):
    before = written(results)
    lost = results / "periodic" / "figures" / "auxetic.png"
    lost.unlink()
    ran(results)
    after = written(results)
    figures = [path for path in after if path.parent.name == "figures"]
    assert [path for path in figures if after[path] != before[path]] == [lost]


@pytest.mark.slow
def finished_plan(workflow, settings, results):
    """The cube of a plan that would be made again as it is, if a run would change nothing."""
    record = same_plan(workflow, settings, results)
    return None if record is None else finished_cube(record, results / workflow)


@pytest.mark.parametrize(
    "change",
    [
        lambda folder: next(folder.glob("cases/*.nc")).write_bytes(b"no case"),
        lambda folder: (folder / "cube.nc").unlink(),
        lambda folder: (folder / "plan.json").unlink(),
    ],
)
def test_lost_or_damaged_files_are_recreated(results, change):
    assert finished_plan("periodic", SETTINGS, results)
    change(results / "periodic")
    assert finished_plan("periodic", SETTINGS, results) is None
    ran(results)
    assert finished_plan("periodic", SETTINGS, results)


def test_results_of_other_settings_or_code_are_not_reused(results, monkeypatch):
    assert finished_plan("periodic", SETTINGS[:2], results) is None
    assert finished_plan("sensor", SETTINGS, results) is None
    monkeypatch.setattr("knitlab.runs.recorded_plan.package_digest", lambda: "other code")
    assert finished_plan("periodic", SETTINGS, results) is None


@pytest.mark.slow
def test_a_figure_of_another_cube_is_drawn_again(results, tmp_path):
    folder, output = results / "periodic", tmp_path / "curves.png"
    draw_figure("curves", [folder], output)
    first = output.stat().st_mtime_ns
    draw_figure("curves", [folder], output)
    assert output.stat().st_mtime_ns == first
    assert not is_drawn(output, "another")
    cube = xr.load_dataset(folder / "cube.nc")
    cube["poisson_ratio"] = cube["poisson_ratio"] - 0.1
    cube.to_netcdf(folder / "cube.nc")
    draw_figure("curves", [folder], output)
    assert output.stat().st_mtime_ns > first
