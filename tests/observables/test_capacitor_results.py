"""Electrodes in a workflow: refused layouts, and the variables of the cube."""

import numpy as np
import pytest
from scipy.special import ellipk

from knitlab.io.errors import InputError
from knitlab.observables.capacitance.boundary_elements import VACUUM_PERMITTIVITY
from knitlab.observables.capacitance.sensor import CapacitorStatus
from knitlab.observables.schema import VARIABLES
from knitlab.runs.plan import make_plan
from knitlab.runs.run import run_plan
from knitlab.runs.run_options import RunOptions
from knitlab.solvers.case import case_of

SMALL = ("strain_max=0.2", "strain_step=0.05", "knit=rib")
NAMES = {name for name, each in VARIABLES.items() if each.group.name in ("capacitor", "unloading")}


@pytest.fixture(scope="module")
def cube(tmp_path_factory):
    plan = make_plan("sensor_stripes", SMALL)
    return run_plan(plan, tmp_path_factory.mktemp("sensor_stripes"), RunOptions()).cube


@pytest.mark.slow
@pytest.mark.nightly
def test_a_cube_holds_every_variable_of_a_capacitor(cube):
    assert set(cube.data_vars) >= NAMES
    rib = cube.sel(knit="rib", n=4, boundary="periodic")
    assert (rib["capacitor_status"] == CapacitorStatus.measured).all()
    assert (np.diff(rib["capacitance"]) < 0).all()
    assert float(rib["capacitance_ratio"][0]) == 1
    assert float(rib["electrode_length"]) == pytest.approx(100, rel=1e-15)
    assert float(rib["applied_strain_opened"]) == 0
    assert float(rib["sensing_end"]) == 0.2
    assert np.isnan(rib["applied_strain_unfolded"])
    slope = -np.gradient(rib["capacitance"], rib["applied_strain"])[2]
    assert float(rib["sensitivity"]) == pytest.approx(slope, rel=0.02)
    assert rib["mutual_capacitance"].isnull().all()


@pytest.mark.slow
def test_a_stripe_that_does_not_snap_has_no_hysteresis(cube):
    rib = cube.sel(knit="rib", n=4, boundary="periodic")
    np.testing.assert_allclose(rib["capacitance_unloading"], rib["capacitance"], rtol=1e-4)
    assert float(rib["hysteresis"]) < 1e-3


@pytest.mark.slow
def test_capacitance_is_of_the_length_that_was_asked_for(cube, tmp_path):
    plan = make_plan("sensor_stripes", (*SMALL, "electrode_length=50", "permittivity=3"))
    other = run_plan(plan, tmp_path, RunOptions()).cube
    np.testing.assert_allclose(other["capacitance"], 1.5 * cube["capacitance"], rtol=1e-6)
    # In the relaxed, folded state it is larger than that of the same strips in flat fabric.
    modulus = 2 / 6
    flat = VACUUM_PERMITTIVITY * 100 * ellipk(1 - modulus**2) / ellipk(modulus**2)
    assert float(cube["capacitance"][0, 0, 0, 0]) > 1.2 * flat


def test_a_case_with_electrodes_is_read_back_whole():
    (case,) = make_plan("sensor_stripes", SMALL).cases.values()
    assert case_of(case.record) == case
    (drawn,) = make_plan("sensor_stripes", (*SMALL, "width=2", "ridges=2,1")).cases.values()
    assert drawn.capacitor.layout.width == 2
    assert drawn.capacitor.layout.ridges == (2, 1)
    assert drawn.case_id != case.case_id


def test_layouts_can_be_a_dimension():
    plan = make_plan("sensor", ("layout=checkerboard,checkerboard_faces", "n_stripe=4"))
    assert plan.dims == ("n_stripe", "n_subunit", "layout")
    assert len(plan.cases) == 10
    widths = make_plan("sensor", ("width=1,2", "n_stripe=4"))
    assert {case.capacitor.layout.width for case in widths.cases.values()} == {1, 2}


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (("layout=nowhere",), "nowhere.*checkerboard_narrow"),
        (("ridges=1,9",), "ridge 9.*front"),
        (("width=20",), "short circuit.*n_stripe 2  n_subunit 16"),
        (("mask=AB,A",), "equal length"),
        (("mask=AX,AB",), "A, B.*X"),
        (("mask=AB,AB", "n_stripe=4", "n_subunit=16"), "2 rows of 2.*16 rows of 16"),
        (("span=0.1,0.9",), "span.*clamped"),
        (("permittivity=0.5",), "permittivity"),
        (("unloading=true", "method=dynamics"), "dynamics.*unloading"),
    ],
)
def test_impossible_electrodes_are_refused_by_the_plan(overrides, message):
    with pytest.raises(InputError, match=message):
        make_plan("sensor", overrides)


LAYOUTS = ("n_stripe=2", "n_subunit=16", "strain_max=0.04", "unloading=false")


def test_cases_that_share_a_test_are_planned_as_one():
    one = make_plan("sensor", (*LAYOUTS, "layout=checkerboard"))
    both = make_plan("sensor", (*LAYOUTS, "layout=checkerboard,checkerboard_faces"))
    assert len(both.cases) == 2
    ((only,), (batch,)) = one.batches, both.batches
    assert set(batch.cases) == set(both.cases)
    assert batch.estimated_seconds == only.estimated_seconds
    assert batch.unknowns == only.unknowns
    softer = make_plan("sensor", (*LAYOUTS, "k_t_factor=1,0.9"))
    assert sum(its.unknowns for its in softer.batches) == 2 * only.unknowns


@pytest.mark.slow
@pytest.mark.nightly
def test_layouts_measured_in_one_test_are_those_of_a_test_each(tmp_path):
    layouts = ("checkerboard", "checkerboard_faces")
    plan = make_plan("sensor", (*LAYOUTS, f"layout={','.join(layouts)}"))
    both = run_plan(plan, tmp_path / "both", RunOptions()).cube
    for layout in layouts:
        alone = make_plan("sensor", (*LAYOUTS, f"layout={layout}"))
        one = run_plan(alone, tmp_path / layout, RunOptions()).cube.isel(n_stripe=0, n_subunit=0)
        found = both.sel(layout=layout).isel(n_stripe=0, n_subunit=0)
        assert (one["status"], found["status"]) == (1, 1)
        for name in ("reaction_force", "iterations", "capacitance", "electrode_gap"):
            np.testing.assert_array_equal(found[name], one[name], err_msg=name)
    differing = both["capacitance"].sel(layout=layouts[0]) != both["capacitance"].sel(
        layout=layouts[1]
    )
    assert differing.all()
