"""Many cases: cubes in blocks are those in one piece, and little is read when little is to do."""

import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner

import knitlab as kl
from knitlab.cli import main
from knitlab.cubes import case_file
from knitlab.runs import cube as cubes
from knitlab.runs.batches import Shard
from knitlab.runs.merge import merge_folders
from knitlab.runs.plan import make_plan
from tests.runs import fake_simulator
from tests.runs.fake_simulator import ran, same

HERE = Path(__file__).resolve().parents[2]
DESIGNS = 10


def factors(count):
    return ",".join(f"{1 + k / 1000:g}" for k in range(count))


def opened_files(action):
    """How often an action opens a file of each name, as Python's audit events tell."""
    counts, counting = Counter(), [True]

    def hook(event, arguments):
        if event == "open" and counting:
            counts[Path(str(arguments[0])).suffix] += 1

    sys.addaudithook(hook)  # for good, but it counts only here
    result = action()
    counting.clear()
    return result, counts


@pytest.fixture
def small_blocks(monkeypatch):
    monkeypatch.setattr(cubes, "BLOCK_BYTES", 50_000)


def test_a_cube_in_blocks_is_that_in_one_piece(tmp_path, monkeypatch):
    plan = make_plan("periodic", ("strain_max=0.06", f"k_t_factor={factors(4)}"))
    part = make_plan("periodic", ("strain_max=0.06", "n_stripe=4", f"k_t_factor={factors(3)}"))
    longer = make_plan("periodic", ("strain_max=0.09", "n_stripe=8", f"k_t_factor={factors(2)}"))

    def results(folder):
        """A run, one that adds strains, shards, and all of them merged."""
        ran(part, folder / "one" / "periodic")
        ran(plan, folder / "one" / "periodic", fake_simulator.simulate_poisoned)
        ran(longer, folder / "one" / "periodic")
        for number in (1, 2):
            ran(part, folder / f"shard-{number}" / "periodic", shard=Shard(number, 2))
        merge_folders([*sorted(folder.glob("shard-*"))], folder / "all")
        return [xr.load_dataset(folder / name / "periodic" / "cube.nc") for name in ("one", "all")]

    whole = results(tmp_path / "whole")
    monkeypatch.setattr(cubes, "BLOCK_BYTES", 60_000)
    chunks = xr.open_dataset(tmp_path / "whole" / "one" / "periodic" / "cube.nc")
    assert chunks["boundary_x"].encoding["chunksizes"] != ()
    for one, other in zip(whole, results(tmp_path / "blocks"), strict=True):
        same(one, other)
        assert one.attrs["parameters"] == other.attrs["parameters"]
