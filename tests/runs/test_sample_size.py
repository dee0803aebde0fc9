"""Cubes whose designs have samples of different sizes, run together or one after another."""

import itertools
import json

import netCDF4
import numpy as np
import pytest
import xarray as xr

import knitlab
from knitlab.cubes.cube_file import open_cube
from knitlab.io.provenance import provenance
from knitlab.observables.status import Status
from knitlab.runs.plan import make_plan
from knitlab.runs.results_folder import CaseState
from tests.runs import fake_simulator

CELLS = {16: (6, 3), 24: (4, 2), 32: (2, 1)}
"""Unit cells along (y, x) by n_subunit, on 0.3 of the paper's needles."""


def planned(*overrides):
    return make_plan("paper", ("n_stripe=4", "scale=0.3", "strain_max=0.06", *overrides))


def ran(results, *overrides, **options):
    return fake_simulator.ran(planned(*overrides), results, **options)


def stored(results):
    """The cube of a folder, without attributes of its origin and time."""
    cube = open_cube(results)
    for name in provenance():
        del cube.attrs[name]
    return cube


def unit_cells(cube, n_stripe, n_subunit):
    local = cube.sel(n_stripe=n_stripe, n_subunit=n_subunit)
    return int(local["unit_cells_y"]), int(local["unit_cells_x"])


@pytest.mark.slow
@pytest.mark.parametrize("turns", list(itertools.permutations(CELLS)))
def test_successive_runs_give_the_cube_of_one_run(tmp_path, turns):
    for n_subunit in turns:
        ran(tmp_path / "turns", f"n_subunit={n_subunit}")
    ran(tmp_path / "once", "n_subunit=16,24,32")
    xr.testing.assert_identical(stored(tmp_path / "turns"), stored(tmp_path / "once"))


def test_a_cube_states_the_sample_size_of_every_design(tmp_path, monkeypatch):
    ran(tmp_path, "n_subunit=16")
    monkeypatch.setattr(fake_simulator, "POISONED", 4)
    cube = fake_simulator.ran(
        planned("n_subunit=16,24,32"), tmp_path, fake_simulator.simulate_poisoned
    ).cube
    assert cube["status"].values.ravel().tolist() == [Status.ok, Status.failed, Status.failed]
    for n_subunit, cells in CELLS.items():
        assert unit_cells(cube, 4, n_subunit) == cells
    assert "unit_cells" not in json.loads(cube.attrs["parameters"])
    with netCDF4.Dataset(tmp_path / "cube.nc") as dataset:
        for name in ("unit_cells_y", "unit_cells_x"):
            assert dataset[name].dtype == np.int32
            assert dataset[name].units == "1"
            assert dataset[name].long_name
    (row,) = knitlab.open_cube(tmp_path).knitlab.query(n_subunit=24).to_dict("records")
    assert (row["unit_cells_y"], row["unit_cells_x"]) == (4, 2)


def test_a_larger_sample_of_another_part_of_the_needles_joins(tmp_path):
    before = ran(tmp_path, "n_subunit=16,32").cube
    assert "unit_cells" not in json.loads(before.attrs["parameters"])
    cube = ran(tmp_path, "n_stripe=2", "n_subunit=16", "scale=0.6").cube
    assert unit_cells(cube, 2, 16) == (12, 6) == (cube.sizes["cell_y"], cube.sizes["cell_x"])
    for n_subunit in (16, 32):
        rows, columns = cells = CELLS[n_subunit]
        assert unit_cells(cube, 4, n_subunit) == cells
        strain = cube["strain_xx"].sel(n_stripe=4, n_subunit=n_subunit)
        inside = strain[:, :rows, :columns]
        assert np.isfinite(inside).all()
        assert np.isfinite(strain).sum() == inside.size
        np.testing.assert_array_equal(
            inside, before["strain_xx"].sel(n_stripe=4, n_subunit=n_subunit)[:, :rows, :columns]
        )
    assert cube["unit_cells_y"].sel(n_stripe=2, n_subunit=32).isnull()


def test_a_sample_size_that_all_designs_share_is_stated(tmp_path):
    for n_subunit in (32, 40):
        cube = ran(tmp_path, f"n_subunit={n_subunit}").cube
        assert json.loads(cube.attrs["parameters"])["unit_cells"] == [2, 1]


def test_a_cube_is_no_larger_than_its_largest_sample(tmp_path):
    ran(tmp_path, "n_subunit=16,24")
    stale = ran(tmp_path, "n_subunit=16", "scale=0.15")
    assert len(stale.left_in(CaseState.stale_parameters)) == 1
    assert unit_cells(stale.cube, 4, 16) == (6, 3)
    cube = ran(tmp_path, "n_subunit=16", "scale=0.15", refresh=True).cube
    assert unit_cells(cube, 4, 16) == (2, 1)
    assert (cube.sizes["cell_y"], cube.sizes["cell_x"]) == unit_cells(cube, 4, 24) == (4, 2)
