"""Capacitors on stripes with given folds: measured capacitances, and states without one."""

from dataclasses import replace

import numpy as np
import pytest

from knitlab.model.electrodes import Capacitor, ElectrodeLayout, place_electrodes
from knitlab.model.fabric import Configuration
from knitlab.observables.capacitance.boundary_elements import VACUUM_PERMITTIVITY
from knitlab.observables.capacitance.capacitor import capacitances
from knitlab.observables.capacitance.sensor import CapacitorStatus
from tests.fabrics import CLAMPED, PERIODIC, cell_of, patch_map, pure, stripe

PERIODS = 2
RIDGES = ElectrodeLayout(along="course")
CAPACITOR = Capacitor(
    layout=RIDGES,
    electrode_length=100.0,
    permittivity=1.0,
    clearance=0.1,
    accuracy=0.01,
    linearity=0.99,
    unfolded=0.1,
)
STRIPE = stripe("garter", 8)


def folded(net, fabric, angles):
    """A corrugated stripe at several interior fold angles, ridges at its lines 2 and 6."""
    shape, (across, along) = net.shape, cell_of(fabric)
    rows, columns = np.arange(shape.nodes_y), np.arange(shape.nodes_x)
    states = []
    for angle in angles:
        height = np.abs((rows + 2) % 4 - 2)
        nodes = np.zeros((rows.size, columns.size, 3))
        nodes[..., 0] = across * columns
        nodes[..., 1] = along * np.sin(angle / 2) * rows[:, None]
        nodes[..., 2] = along * np.cos(angle / 2) * height[:, None]
        lengths = across * shape.cells_x, along * np.sin(angle / 2) * shape.cells_y
        states.append(Configuration(nodes, np.array(lengths)))
    return Configuration.stacked(states)


def measured(angles, options=PERIODIC, **changes):
    net, fabric = pure(STRIPE, options, PERIODS, ridges="G")
    capacitor = replace(CAPACITOR, **changes)
    pattern = patch_map(["G"], PERIODS)
    stitches = tuple(np.full(cells, 4.0) for cells in pattern.grid)
    electrodes = place_electrodes(capacitor.layout, pattern, options, stitches)
    return capacitances(electrodes, net, fabric, folded(net, fabric, angles), capacitor)


@pytest.mark.slow
@pytest.mark.nightly
def test_capacitance_falls_as_the_stripe_unfolds():
    found = measured([0.6, 1.2, 2.0, 3.0, np.pi])
    assert (found.status == CapacitorStatus.measured).all()
    assert (np.diff(found.capacitance) < 0).all()
    assert (np.diff(found.gap) >= 0).all()
    assert (found.error <= CAPACITOR.accuracy).all()


@pytest.mark.slow
def test_flat_fabric_has_the_capacitance_of_coplanar_strips():
    from scipy.special import ellipk

    found = measured([np.pi])
    net, fabric = pure(STRIPE, PERIODIC, PERIODS, ridges="G")
    # Strips of two cells, two cells apart.
    modulus = 2 / (2 + 2 * 2)
    exact = ellipk(1 - modulus**2) / ellipk(modulus**2)
    length = float(cell_of(fabric)[0]) * net.shape.cells_x
    assert found.capacitance[0] == pytest.approx(VACUUM_PERMITTIVITY * length * exact, rel=4e-3)


@pytest.mark.slow
@pytest.mark.nightly
def test_the_stated_error_is_no_less_than_the_true_one():
    angles = [1.0, 2.0]
    rough, fine = measured(angles), measured(angles, accuracy=3e-3)
    assert (fine.error < rough.error).all()
    assert (np.abs(rough.capacitance / fine.capacitance - 1) <= rough.error).all()


@pytest.mark.slow
def test_a_tightly_closed_ridge_has_a_status_and_no_number():
    found = measured([0.01, 0.03, 1.0])
    assert (found.status[:2] == CapacitorStatus.touching).all()
    assert found.status[2] == CapacitorStatus.measured
    assert np.isnan(found.capacitance[:2]).all()
    assert (found.gap[:2] < CAPACITOR.clearance).all()


@pytest.mark.slow
def test_insulated_electrodes_may_touch():
    """Strips at 1.1° are nearly plates at the distance of the dielectric, far from their ends."""
    found = measured([0.01, 0.03, 1.0], dielectric_thickness=0.1)
    assert (found.status == CapacitorStatus.measured).all()
    assert (np.diff(found.capacitance) < 0).all()
    assert found.capacitance[2] < measured([1.0]).capacitance[0]
    net, fabric = pure(STRIPE, PERIODIC, PERIODS, ridges="G")
    across, along = (float(side) for side in cell_of(fabric))
    plates = VACUUM_PERMITTIVITY * across * net.shape.cells_x * along / 0.1
    assert found.capacitance[0] == pytest.approx(plates, rel=0.4)


@pytest.mark.slow
@pytest.mark.nightly
@pytest.mark.parametrize("options", [PERIODIC, CLAMPED])
def test_a_grounded_plane_adds_capacitance_and_shields(options):
    alone = measured([1.0], options)
    near, far = (measured([1.0], options, ground="plane", ground_distance=d) for d in (0.3, 300.0))
    assert near.capacitance[0] > alone.capacitance[0]
    assert near.mutual[0] < far.mutual[0] <= far.capacitance[0] * (1 + 1e-9)
    assert far.capacitance[0] == pytest.approx(alone.capacitance[0], rel=2e-3)


@pytest.mark.slow
def test_a_fold_past_half_a_turn_has_a_status_and_no_number():
    found = measured([-0.2, 1.0])
    assert found.status[0] == CapacitorStatus.folded_through
    assert np.isnan(found.capacitance[0])


@pytest.mark.slow
@pytest.mark.nightly
def test_unresolved_capacitances_are_reported():
    found = measured([0.25], clearance=1e-6, accuracy=1e-5)
    assert found.status[0] == CapacitorStatus.unresolved
    assert np.isnan(found.capacitance[0])
    assert found.error[0] > 1e-5


@pytest.mark.slow
def test_a_state_is_measured_alike_alone_and_among_others():
    alone = [measured([angle]).capacitance[0] for angle in (0.8, 1.6)]
    np.testing.assert_allclose(measured([0.8, 1.6]).capacitance, alone, rtol=1e-5)


@pytest.mark.slow
def test_electrodes_drawn_cell_by_cell_are_those_laid_along_ridges():
    mask = tuple(8 * letter for letter in ".BB..AA.")
    drawn = measured([1.0], layout=replace(RIDGES, mask=mask))
    assert drawn.capacitance == pytest.approx(measured([1.0]).capacitance, rel=1e-6)
