"""Shards and merges by commands, of a real small sweep."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner

from knitlab.cli import main

DESIGNS = ("--set", "n_stripe=4", "--set", "n_subunit=8,16", "--set", "strain_max=0.06")
QUICK = (*DESIGNS, "--set", "robustness=0", "--workers", "0")


def knitlab(*words):
    return CliRunner().invoke(main, words)


@pytest.mark.slow
@pytest.mark.nightly
def test_shards_of_a_real_sweep_are_merged_into_one(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for number in (1, 2):
        said = knitlab(
            "run", "periodic", *QUICK, "--shard", f"{number}/2", "--results", f"{number}"
        )
        assert said.exit_code == 0, said.output
        assert f"1 cases simulated, 0 already there in shard {number}/2" in said.output
    assert not list(tmp_path.rglob("*.png"))
    merged = knitlab("merge", "1", "2", "--results", "both")
    assert merged.exit_code == 0, merged.output
    assert "2 folders, 2 case files copied\n2 designs: 2 ok\n" in merged.output
    whole = knitlab("run", "periodic", *QUICK, "--results", "whole")
    assert whole.exit_code == 0, whole.output
    cubes = [xr.load_dataset(f"{folder}/periodic/cube.nc") for folder in ("both", "whole")]
    assert (cubes[0]["case_id"] == cubes[1]["case_id"]).all()
    for name in ("poisson_ratio", "reaction_force", "relaxed_cell_x"):
        np.testing.assert_allclose(cubes[0][name], cubes[1][name], rtol=1e-6, atol=1e-9)
    last = knitlab("run", "periodic", *QUICK, "--results", "both")
    assert "0 cases simulated, 2 already there" in last.output
    assert list(Path("both").rglob("*.png"))


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("run", "periodic", "--shard", "3"), "--shard 3: is not of the form NUMBER/COUNT"),
        (("run", "periodic", "--shard", "5/4"), "--shard 5/4: is not a part of a plan; give"),
        (("merge", "nowhere"), "nowhere: holds no results: neither plan.json nor cube.nc; check"),
    ],
)
def test_bad_input_is_one_sentence(tmp_path, monkeypatch, words, message):
    monkeypatch.chdir(tmp_path)
    said = knitlab(*words)
    assert said.exit_code == 2
    assert message in said.output
    assert len(said.output.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []
