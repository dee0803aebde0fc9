"""The workflows of the paper's method, on designs small enough for a test."""

from pathlib import Path

import pytest
import xarray as xr

from knitlab.observables.status import Status
from tests.commands import knitlab

pytestmark = pytest.mark.usefixtures("in_folder")


@pytest.mark.slow
@pytest.mark.nightly
def test_a_relaxation_is_drawn():
    settings = ("n_stripe=8", "n_subunit=16", "boundary=periodic", "snapshots=12", "release=0")
    words = [word for setting in settings for word in ("--set", setting)]
    ran = knitlab("run", "relaxation", *words, "--workers", "0")
    assert ran.exit_code == 0, ran.output
    figures = {path.name for path in Path("results/relaxation/figures").iterdir()}
    assert figures == {"relaxation.png"}
    (path,) = Path("results/relaxation/cases").glob("*.nc")
    case = xr.load_dataset(path)
    assert float(case["kinetic_energy"][-1]) < 1e-9 * float(case["potential_energy"][0])
    assert case["snapshot_position"].sizes["snapshot"] == case.sizes["snapshot"] > 4


@pytest.mark.slow
def test_dynamics_that_cannot_finish_is_reported():
    settings = ("n_stripe=8", "n_subunit=16", "boundary=periodic", "longest_time=0.1")
    words = [word for setting in settings for word in ("--set", setting)]
    ran = knitlab("run", "relaxation", *words, "--workers", "0")
    assert ran.exit_code == 1
    assert "it was still moving at the end of its time" in ran.output
    cube = xr.load_dataset("results/relaxation/cube.nc")
    assert (cube["status"] == Status.not_converged).all()
