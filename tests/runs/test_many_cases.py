"""Many cases: a cube in blocks is that in one piece, and a run reads only what it has to."""

import sys
from collections import Counter
from pathlib import Path

import pytest
import xarray as xr
from click.testing import CliRunner

import knitlab as kl
from knitlab.cli import main
from knitlab.cubes.case_file import case_path
from knitlab.runs import cube as runs_cube
from knitlab.runs.batches import Shard
from knitlab.runs.merge import merge_folders
from knitlab.runs.plan import make_plan
from tests.runs import fake_simulator
from tests.runs.fake_simulator import ran, same

FEW = ("n_stripe=4,8", "n_subunit=16,32")
MANY = 200  # values of a factor, of ten designs each
DAMAGED = 3
OPENINGS = 4  # of a case file: to compare it with its checksum, and to read it
counted: list[Counter] = []


def count_openings(event, arguments):
    if event == "open" and counted:
        counted[-1][str(arguments[0])] += 1


def factors(count):
    return ",".join(f"{1 + k / 1000:g}" for k in range(count))


def openings(folder, action):
    """How often an action opens each case file of a folder."""
    counted.append(Counter())
    action()
    files = {Path(name): number for name, number in counted.pop().items()}
    cases = {path for path in files if path.parent == folder / "cases" and path.suffix == ".nc"}
    return {path: files[path] for path in cases}


@pytest.mark.slow
def test_a_cube_in_blocks_is_that_in_one_piece(tmp_path, monkeypatch):
    few = make_plan("periodic", (*FEW, "strain_max=0.06", f"k_t_factor={factors(2)}"))
    more = make_plan("periodic", (*FEW, "strain_max=0.09", f"k_t_factor={factors(4)}"))

    def results(folder):
        """A run, then one of more cases and strains, some of which fail; and shards, merged."""
        ran(few, folder / "one" / "periodic")
        ran(more, folder / "one" / "periodic", fake_simulator.simulate_poisoned)
        for number in (1, 2):
            ran(few, folder / f"shard-{number}" / "periodic", shard=Shard(number, 2))
        merge_folders([*sorted(folder.glob("shard-*"))], folder / "all")
        return [xr.load_dataset(folder / name / "periodic" / "cube.nc") for name in ("one", "all")]

    whole = results(tmp_path / "whole")
    monkeypatch.setattr(runs_cube, "BLOCK_BYTES", 40_000)
    for one, other in zip(whole, results(tmp_path / "blocks"), strict=True):
        boundary = other["boundary_x"]
        assert boundary.encoding["chunksizes"] < boundary.shape
        same(one, other)
        assert one.attrs["parameters"] == other.attrs["parameters"]


@pytest.mark.slow
@pytest.mark.nightly
def test_a_run_of_many_cases_opens_only_what_changed(tmp_path, monkeypatch):
    sys.addaudithook(count_openings)
    monkeypatch.setattr(runs_cube, "BLOCK_BYTES", 1e6)  # some sixty blocks
    settings = ("strain_max=0.06", "robustness=0", f"k_t_factor={factors(MANY)}")
    plan, folder = make_plan("periodic", settings), tmp_path / "periodic"
    ran(plan, folder)
    words = [word for setting in settings for word in ("--set", setting)]
    again = ["run", "periodic", *words, "--results", str(tmp_path), "--workers", "0"]

    def command(*line):
        done = CliRunner().invoke(main, line)
        assert done.exit_code == 0, done.output

    nothing = (
        lambda: command(*again),
        lambda: command("status", "periodic", "--results", str(tmp_path)),
        lambda: command("query", str(folder), "--where", "poisson_ratio_min < 0.5"),
        lambda: kl.open_cube(folder),
    )
    for action in nothing:
        assert openings(folder, action) == {}

    damaged = [case_path(folder, case_id) for case_id in list(plan.cases)[:DAMAGED]]
    for path in damaged:
        path.write_bytes(path.read_bytes()[:-1])
    opened = openings(folder, lambda: ran(plan, folder))
    assert {*opened} == {*damaged}

    (folder / "cube.nc").unlink()
    opened = openings(folder, lambda: ran(plan, folder))
    assert len(opened) == len(plan.cases) == 10 * MANY
    assert max(opened.values()) <= OPENINGS
