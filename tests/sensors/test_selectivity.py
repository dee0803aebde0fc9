"""Gauge factors against tests of the equilibrium, and against unit cells that are rolled up."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import knitlab as kl
from knitlab.cubes.case_file import LENGTH_FACTOR, configurations, in_cloth
from knitlab.cubes.cube_file import open_cube
from knitlab.model.fabric import Configuration
from knitlab.observables.capacitance.maxwell import Surroundings
from knitlab.observables.capacitance.panels import panel_chart, panels_on
from knitlab.sensors.readings import electrode_matrices, readings
from knitlab.sensors.selectivity import _Solver, _State
from knitlab.solvers.case import case_of
from tests.export.plates.bent_cell import BentCell
from tests.refusals import refused

SENSOR = "results/reference/sensor"
ONE = {"n_stripe": 4, "n_subunit": 16}
SMALL = 2e-3  # strain of a test whose curve is straight


@cache
def small_test(load="warp", along="wale", strains=(0.0, SMALL), **settings):
    """A test of a small checkerboard with two ridges plated."""
    known = kl.defaults()
    layout = kl.ElectrodeLayout(along=along, within="fabric", face="both", width=1.0)
    return kl.simulate(
        kl.Design(4, 8, boundary="periodic"),
        strains,
        protocol=kl.Protocol(load=load, load_ratio=0.0 if load == "biaxial" else None),
        model=kl.Model(cell_size="flat"),
        sheet=replace(known.sheet, z_max=1.9),
        capacitor=replace(known.capacitor, layout=layout, **settings),
    )


@cache
def of_small(along="wale"):
    return kl.selectivity(small_test(along=along)).isel(applied_strain=0)


def slope(test):
    """Change of ln C over the strain."""
    low, high = np.log(test["capacitance"].values)
    return (high - low) / SMALL


@pytest.mark.parametrize(
    ("load", "sides", "direction"),
    [
        pytest.param("warp", "free", "warp", marks=[pytest.mark.slow, pytest.mark.nightly]),
        pytest.param("weft", "free", "weft", marks=[pytest.mark.slow, pytest.mark.nightly]),
        pytest.param("biaxial", "held", "warp", marks=pytest.mark.slow),
    ],
)
def test_strain_gauges_are_slopes_of_tests(load, sides, direction):
    gauge = of_small()["strain_gauge"].sel(sides=sides, direction=direction)
    assert float(gauge) == pytest.approx(slope(small_test(load)), rel=0.01)


def rolled_up(case, state, axis, curvature):
    """The panels of a checkerboard that is rolled up about an axis, by its own equilibrium."""
    cell = BentCell(case.mesh_shape, case.assemble()[1], state)
    nodes, given = cell.start, (np.zeros(3), np.eye(2)[axis], curvature)
    for _ in range(60):
        nodes = nodes - cell._flexibility @ np.asarray(cell._gradient(nodes, *given))
    nodes = np.asarray(nodes).reshape(-1, 3) - [0, 0, np.mean(np.asarray(nodes)[2::3])]
    relaxed = Configuration(nodes.reshape(np.shape(state.positions)), state.lengths)
    chart = panel_chart(case.electrodes, case.mesh_shape, 1)
    corners = np.asarray(panels_on(chart, case.mesh_shape, relaxed))
    corners -= [*np.asarray(state.lengths) / 2, 0]

    def row(copies):
        """So many unit cells along the electrodes, on a cylinder."""
        turns = (np.arange(copies) - (copies - 1) / 2) * state.lengths[case.electrodes.axis]
        flat = np.concatenate([corners + t * np.eye(3)[case.electrodes.axis] for t in turns])
        arc, radius, space = flat[..., axis], 1 / curvature + flat[..., 2], flat.copy()
        space[..., axis] = radius * np.sin(curvature * arc)
        space[..., 2] = radius * np.cos(curvature * arc) - 1 / curvature
        return space, np.tile(chart.electrode, copies)

    return row


@pytest.mark.slow
@pytest.mark.nightly
@pytest.mark.parametrize("along", ["wale", "course"])
def test_bent_sensors_are_those_of_rolled_up_cells(along):
    test, size = small_test(along=along), 1e-3
    case = case_of(json.loads(test.attrs["parameters"]))
    state = configurations(test)[0]
    solver = _Solver(case, case.capacitor)
    plate, moves = solver._plates.response(case.assemble()[1], state)
    bent = _State(state, moves, plate.height, np.full(4, size))
    gauge = of_small(along)["bending_gauge"].sel(sides="held").values
    for axis in (0, 1):
        rows = [rolled_up(case, state, axis, sign * size) for sign in (1, -1)]
        of_rows, found = [], []
        for copies in (2, 3):
            panels, number = zip(*(row(copies) for row in rows), strict=True)
            matrices = electrode_matrices(np.stack(panels), number[0], 2, Surroundings())
            of_rows.append(readings(matrices, [(0, 1)], "floating")[:, 0])
            found.append(solver.either_side(bent, [2 + axis], 1, copies)[0])
        up, down = of_rows[1] - of_rows[0]
        wanted = np.log(up / down) / (2 * size)
        up, down = found[1] - found[0]
        assert np.log(up / down) / (2 * size) == pytest.approx(wanted, rel=1e-3)
        # Finer panels change it by some per cent of a strain over the thickness.
        scale = in_cloth(test, test).attrs.get(LENGTH_FACTOR, 1.0)
        assert gauge[axis] == pytest.approx(scale * wanted, rel=0.03, abs=0.004 * scale)


@pytest.mark.slow
def test_a_kept_design_has_the_slope_of_its_curve():
    cube = open_cube(SENSOR).sel(ONE)
    curve = cube["capacitance"].values
    found = kl.selectivity(SENSOR, applied_strain=0.1, **ONE).squeeze()
    gauge = found["strain_gauge"].sel(sides="free", direction="warp")
    k = 5
    assert cube["applied_strain"].values[k] == pytest.approx(0.1)
    around = (curve[k - 2] - 8 * curve[k - 1] + 8 * curve[k + 1] - curve[k + 2]) / 12 / 0.02
    assert float(gauge) == pytest.approx(1.1 * around / curve[k], rel=5e-3)
    assert found["capacitance"] == pytest.approx(curve[k])


@pytest.mark.slow
def test_leads_lower_gauge_factors_alike():
    bare, leads = of_small(), kl.selectivity(small_test(lead_capacitance=2.0))
    part = float(bare["capacitance"] / leads["capacitance"][0])
    assert part == pytest.approx(1 - 2.0 / float(leads["capacitance"][0]), rel=1e-6)
    for name in ("strain_gauge", "bending_gauge"):
        np.testing.assert_allclose(leads[name][0], part * bare[name], rtol=1e-6)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"along": "x"}, ["along", "'x'", "weft", "warp"]),
        ({"output": "map.txt"}, ["map.txt", "suffix"]),
        ({"where": "n_stripe > 1"}, ["where"]),
        ({"n_stripe": 4}, ["n_stripe", "applied_strain"]),
    ],
)
def test_invalid_input_is_refused(given, words):
    with refused(*words):
        kl.selectivity(small_test(), **given)


@pytest.mark.slow
def test_states_that_a_sensor_cannot_have_are_refused():
    with refused("plane", "ground = none"):
        kl.selectivity(small_test(ground="plane"))
    bare = kl.simulate(kl.Design(4, 8, boundary="periodic"), [0])
    with refused("electrodes", "layout"):
        kl.selectivity(bare)
