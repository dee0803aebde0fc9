"""The condensed stiffness: closed forms, rolled-up cells, tensile tests, symmetries, statuses."""

from functools import cache

import numpy as np
import pytest

from knitlab.export.plates.plate_stiffness import in_plane
from knitlab.model.fabric import Configuration, flat_sheet
from knitlab.model.settings import ModelOptions, PlainKnit, Sheet
from knitlab.solvers.equilibrium.tensile_test import stretch
from knitlab.solvers.loads.off_axis import OffAxis
from knitlab.solvers.plate_condensation import PlateSolver, PlateStatus
from tests.export.plates.bent_cell import BentCell
from tests.fabrics import (
    FINE,
    PERIODIC,
    SHEET,
    assemble_fabric,
    cell_of,
    checkerboard,
    equations,
    patch_map,
    patterned,
    pure,
    relaxed,
    shaken,
    stretched,
    stripe,
)
from tests.solvers.equilibrium.test_pure_stripes import across_the_ridges, along_the_ridges

FLAT = ModelOptions(boundary="periodic")
ANGLE = np.deg2rad(35)
OBLIQUE = OffAxis(angle=35.0)
PLAIN = PlainKnit(1.0, 0.6, 0.02, 0.05)
SWAPPED = [1, 0, 2, 4, 3, 5]
"""The order of strain and curvature with x and y exchanged."""


def plate_of(net, fabric, state):
    return PlateSolver(net.shape, len(state.lengths) == 3).response(fabric, state)[0]


def plain_sheet():
    return assemble_fabric(
        patch_map(["P"], 1), stripe("rib", 4), stripe("garter", 8), SHEET, FLAT, PLAIN
    )


@cache
def checkered_states(z_max: float = 6.0) -> tuple:
    """A small checkerboard, and its states: relaxed, pulled by 10 %, and by 10 % at an angle."""
    net, fabric = patterned(4, checkerboard(1), FLAT, Sheet(z_max=z_max, k_wall=100.0))
    states = [
        *stretched(net, fabric, [0.0, 0.1], FINE).states,
        stretch(equations(net, fabric), [0.0, 0.1], FINE, load=OBLIQUE).states[-1],
    ]
    return net, fabric, *(state.configuration for state in states)


@pytest.mark.slow
def test_plain_knit_has_the_stiffness_of_its_springs_and_hinges():
    net, fabric = plain_sheet()
    plate = plate_of(net, fabric, flat_sheet(net, fabric))
    a, b = cell_of(fabric)
    along, up = PLAIN.plain_stretch_weft * b / a, PLAIN.plain_stretch_warp * a / b
    diagonals = 2 * min(along, up) / (a * a + b * b)
    membrane = np.array(
        [
            [along * a**2 + diagonals * a**4, diagonals * a**2 * b**2, 0],
            [diagonals * a**2 * b**2, up * b**2 + diagonals * b**4, 0],
            [0, 0, diagonals * a**2 * b**2],
        ]
    ) / (a * b)
    wanted = np.zeros((6, 6))
    wanted[:3, :3] = membrane
    wanted[3, 3], wanted[4, 4] = PLAIN.plain_bend_weft, PLAIN.plain_bend_warp
    np.testing.assert_allclose(plate.stiffness, wanted, atol=1e-12)
    # Cells twist at no cost, as only their diagonals count for a fold.
    assert plate.status is PlateStatus.singular
    np.testing.assert_allclose(plate.forces, 0, atol=1e-15)


def test_a_pure_stripe_stretches_and_bends_as_its_zigzag():
    of = stripe("rib", 4)
    net, fabric = pure(of, PERIODIC)
    plate = plate_of(net, fabric, relaxed(net, fabric, FINE).configuration)
    compliance = np.linalg.inv(plate.stiffness[:3, :3])
    cell = float(cell_of(fabric)[0])
    h = 1e-4

    def slopes(curve):
        (up, pull), (down, push) = curve(of, h), curve(of, -h)
        return (up - down) / 2 / h, (pull - push) / 2 / h

    height, pull = slopes(across_the_ridges)
    assert 1 / compliance[0, 0] == pytest.approx(pull / cell, rel=1e-5)
    assert compliance[0, 1] / compliance[0, 0] == pytest.approx(height, rel=1e-4)
    length, force = slopes(along_the_ridges)
    column = cell * np.sin(of.theta_0 / 2)
    assert 1 / compliance[1, 1] == pytest.approx(force / column, rel=1e-5)
    assert compliance[0, 1] / compliance[1, 1] == pytest.approx(length, rel=1e-4)
    # About the ridges its four hinges in a period turn alike.
    assert plate.stiffness[3, 3] == pytest.approx(of.k_t * of.period / 4 / cell, rel=1e-8)


def second_differences(cell, strain, direction, curvature, h=3e-4):
    """First and second derivative of the relaxed energy along a deformation, of fourth order."""
    energies = [cell.relaxed(x * h * strain, direction, x * h * curvature) for x in range(-2, 3)]
    return (
        np.dot([1, -8, 0, 8, -1], energies) / (12 * h),
        np.dot([-1, 16, -30, 16, -1], energies) / (12 * h * h),
    )


def check_by_rolled_up_cells(state_number, z_max, trials):
    net, fabric, *states = checkered_states(z_max)
    state, random = states[state_number], np.random.default_rng(state_number)
    plate, cell = plate_of(net, fabric, state), BentCell(net.shape, fabric, state)
    assert plate.status is PlateStatus.ok
    for _ in range(trials):
        angle, curvature = random.uniform(0, np.pi), random.normal()
        strain, direction = random.normal(size=3), np.array([np.cos(angle), np.sin(angle)])
        x, y = direction
        deformation = np.concatenate([strain, curvature * np.array([x * x, y * y, 2 * x * y])])
        first, second = second_differences(cell, strain, direction, curvature)
        assert first == pytest.approx(plate.forces @ deformation, rel=1e-6, abs=1e-9)
        assert second == pytest.approx(deformation @ plate.stiffness @ deformation, rel=1e-5)


@pytest.mark.slow
@pytest.mark.nightly
@pytest.mark.parametrize(
    ("state", "z_max"),
    [
        (0, 6.0),
        (1, 6.0),
        (2, 6.0),
        (0, 0.2),
        (1, 0.2),
    ],
)
def test_it_is_also_relaxed_or_stretched_and_between_walls(state, z_max):
    _, fabric, *states = checkered_states(z_max)
    touched = np.abs(states[state].positions[..., 2]).max() > float(fabric.z_max)
    assert touched == (z_max < 1)
    check_by_rolled_up_cells(state, z_max, 4)


def test_tangents_are_those_of_the_tensile_test():
    net, fabric, *_ = checkered_states()
    test = stretched(net, fabric, [0.0, 0.0995, 0.1, 0.1005], FINE)
    before, state, after = (each.configuration.lengths for each in test.states[1:])
    plate = plate_of(net, fabric, test.states[2].configuration)
    compliance = np.linalg.inv(plate.stiffness[:3, :3])
    force = [test.loading.reaction_force(each.gradient) for each in test.states[1:]]
    assert plate.forces[1] == pytest.approx(force[1] / state[0], rel=1e-8)
    np.testing.assert_allclose(plate.forces[[0, 2]], 0, atol=1e-9)
    strain = (after - before) / state
    assert -compliance[0, 1] / compliance[1, 1] == pytest.approx(-strain[0] / strain[1], rel=1e-5)
    # Nominal stress over nominal strain is that of Green and Lagrange plus the force itself.
    tangent = (force[2] - force[0]) / strain[1] / state[0]
    assert 1 / compliance[1, 1] + plate.forces[1] == pytest.approx(tangent, rel=1e-5)


def test_a_pull_at_an_angle_stores_the_energy_of_the_modulus_along_it():
    net, fabric, *_ = checkered_states()
    strain = 1e-4
    strains = [0.0, strain, 2 * strain]
    start, *ends = stretch(equations(net, fabric), strains, FINE, load=OBLIQUE).states
    modulus, ratio = in_plane(plate_of(net, fabric, start.configuration).stiffness[:3, :3], ANGLE)
    one, two = (float(end.energy.total) - float(start.energy.total) for end in ends)
    area = np.prod(start.configuration.lengths[:2])
    # Without the part of third order.
    assert modulus == pytest.approx(2 * (8 * one - two) / 4 / strain**2 / area, rel=1e-5)
    (length_x, length_y, _), (x, y, shear) = (
        state.configuration.lengths for state in (start, ends[0])
    )
    gradient = np.array([[x / length_x, shear / length_y], [0, y / length_y]])
    green = (gradient.T @ gradient - np.eye(2)) / 2
    along, across = (
        np.array([np.cos(angle), np.sin(angle)]) for angle in (ANGLE, ANGLE + np.pi / 2)
    )
    assert ratio == pytest.approx(-(across @ green @ across) / (along @ green @ along), rel=1e-2)


def transposed(state: Configuration) -> Configuration:
    """The mirror image of a state in the plane x = y."""
    return Configuration(
        state.positions.swapaxes(0, 1)[..., [1, 0, 2]].copy(), state.lengths[::-1].copy()
    )


def test_a_design_with_its_axes_exchanged_has_its_stiffness_exchanged():
    net, fabric, _, state, _ = checkered_states()
    other_net, other = assemble_fabric(
        patch_map(["RG", "GR"], 1), stripe("garter", 8), stripe("rib", 4), SHEET, FLAT
    )
    plate, exchanged = plate_of(net, fabric, state), plate_of(other_net, other, transposed(state))
    assert exchanged.status is plate.status is PlateStatus.ok
    order = np.ix_(SWAPPED, SWAPPED)
    np.testing.assert_allclose(exchanged.stiffness, plate.stiffness[order], atol=1e-9)
    np.testing.assert_allclose(exchanged.forces, plate.forces[SWAPPED], atol=1e-9)


def test_a_shape_out_of_balance_has_no_stiffness():
    net, fabric, state, *_ = checkered_states()
    plate = plate_of(net, fabric, shaken(state, 1e-3))
    assert plate.status is PlateStatus.not_converged
    assert np.isnan(plate.stiffness).all()


def test_a_sheet_about_to_buckle_has_no_stiffness():
    net, fabric = plain_sheet()
    flat = flat_sheet(net, fabric)
    shorter = Configuration(flat.positions * np.array([0.9, 0.9, 1]), flat.lengths * 0.9)
    assert plate_of(net, fabric, shorter).status is PlateStatus.unstable
