"""The barrier: closed forms of two plies, finite differences, and periodic fabric cut anywhere."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from knitlab.model.contact_layers import NEAR, contact_layers
from knitlab.model.fabric import Configuration
from knitlab.model.network import MeshShape
from knitlab.model.settings import CONTACT_RANGE
from knitlab.solvers.equilibrium.contact_barrier import Barrier

CELL, THICKNESS, PRESSURE = 0.4, 0.1, 2.0
GAPS = st.floats(THICKNESS * 1.02, THICKNESS * (1 + CONTACT_RANGE) * 0.99)


def barrier_on(shape):
    return Barrier(shape, contact_layers(THICKNESS, PRESSURE, (CELL, CELL)))


def two_plies(gap, rows=6, columns=5):
    """A strip whose upper half lies above its lower half, joined by one upright row of cells."""
    shape = MeshShape(2 * rows + 1, columns, periodic=False)
    row, column = np.mgrid[: shape.nodes_y, : shape.nodes_x]
    upper = row > rows
    y = np.where(upper, 2 * rows + 1 - row, row)
    nodes = np.stack([column * CELL, y * CELL, upper * gap], axis=-1)
    return shape, Configuration(nodes.astype(float), np.zeros(2)).flattened()


def logarithmic(gap):
    """The barrier of squared distances, and its derivative by the gap."""
    excess = gap**2 - THICKNESS**2
    largest = (THICKNESS * (1 + CONTACT_RANGE)) ** 2 - THICKNESS**2
    value = -((excess - largest) ** 2) * np.log(excess / largest)
    slope = -2 * (excess - largest) * np.log(excess / largest) - (excess - largest) ** 2 / excess
    return value, slope * 2 * gap


@given(GAPS, GAPS)
def test_plies_repel_each_other_as_the_logarithmic_barrier_of_their_distance(one, other):
    energies = []
    for gap in (one, other):
        shape, unknowns = two_plies(gap)
        energy, gradient = barrier_on(shape).evaluate(unknowns)
        upper = Configuration.of(gradient, shape).positions[7:]
        value, slope = logarithmic(gap)
        assert upper[..., 2].sum() == pytest.approx(energy * slope / value, rel=1e-9)
        energies.append(energy / value)
    assert energies[0] == pytest.approx(energies[1], rel=1e-9)


def test_plies_further_apart_than_the_range_do_not_feel_each_other():
    shape, unknowns = two_plies(THICKNESS * (1 + CONTACT_RANGE) * 1.001)
    barrier = barrier_on(shape)
    energy, gradient = barrier.evaluate(unknowns)
    assert energy == 0
    assert not gradient.any()
    assert barrier.hessian(unknowns, np.arange(len(unknowns))) is None


def test_energy_is_that_of_the_area_in_contact():
    energies = [
        barrier_on(shape).evaluate(unknowns)[0]
        for shape, unknowns in (
            two_plies(0.11, rows=12, columns=columns) for columns in (8, 16, 24)
        )
    ]
    narrow, middle, wide = energies
    assert wide - middle == pytest.approx(middle - narrow, rel=1e-9)
    assert middle - narrow == pytest.approx(narrow, rel=0.1)


@given(st.floats(0.2, 3.0), st.floats(1.01, 1.2))
def test_a_step_is_shortened_to_the_distance_that_plies_must_keep(drop, above):
    shape, unknowns = two_plies(THICKNESS * above)
    step = np.zeros_like(unknowns)
    Configuration.of(step, shape).positions[7:, :, 2] = -drop * THICKNESS
    part = barrier_on(shape).free_fraction(unknowns, step)
    exact = (above - 1) / drop
    assert part <= min(exact, 1)
    assert part >= 0.4 * min(exact, 1)


def folded_periodic(cells=8, frame=None):
    """Periodic fabric folded so sharply that cells beside a fold are within reach of each other.

    With a ``frame`` its lattice is sheared, and described by the lengths of that frame.
    """
    shape, angle = MeshShape(cells, cells, periodic=True), np.arcsin(1.15 * THICKNESS / CELL)
    row, column = np.mgrid[:cells, :cells]
    along, up = CELL * np.sin(angle / 2), CELL * np.cos(angle / 2)
    zigzag = np.abs((np.arange(cells) + 2) % 8 - 4) * up
    nodes = np.stack([column * along, row * CELL, np.broadcast_to(zigzag, row.shape)], axis=-1)
    nodes += np.random.default_rng(3).normal(size=nodes.shape, scale=1e-3)
    if frame is None:
        return shape, Configuration(nodes, np.array([cells * along, cells * CELL]))
    # Of a frame [a b] and lengths (q, e, s), the vectors of the lattice are [[q, s], [0, e]] [a b].
    lengths = np.array([1.3, 0.8, 0.4])
    lattice = np.array([[lengths[0], lengths[2]], [0.0, lengths[1]]]) @ frame
    gradient = lattice / [cells * along, cells * CELL]
    nodes[..., :2] = nodes[..., :2] @ gradient.T
    return MeshShape(cells, cells, True, frame), Configuration(nodes, lengths)


SIDES = 8 * CELL * np.sin(np.arcsin(1.15 * THICKNESS / CELL) / 2), 8 * CELL
SHEARED = (SIDES[0] / 1.3, 0.04), (0.0, SIDES[1] / 0.8)
"""A frame in which folded fabric is sheared by 0.24, and its courses are not along x."""


@pytest.mark.parametrize("frame", [None, SHEARED])
def test_forces_and_stiffness_are_derivatives_by_nodes_and_lattice_vectors(frame):
    shape, folded = folded_periodic(frame=frame)
    unknowns, barrier = np.asarray(folded.flattened()), barrier_on(shape)
    assert barrier.holds(unknowns)
    energy, gradient = barrier.evaluate(unknowns)
    assert energy > 0
    numbers, step = np.random.default_rng(0), 1e-7
    hessian = barrier.hessian(unknowns, np.arange(len(unknowns)), exact=True).toarray()
    lengths = range(-shape.lengths, 0)
    assert any(gradient[lengths] != 0)
    for place in [*lengths, *numbers.integers(0, len(unknowns), 12)]:
        moved = np.zeros_like(unknowns)
        moved[place] = step
        ahead, behind = (barrier.evaluate(unknowns + sign * moved) for sign in (1, -1))
        assert gradient[place] == pytest.approx(
            (ahead[0] - behind[0]) / (2 * step), rel=1e-4, abs=1e-6 * abs(gradient).max()
        )
        difference = (ahead[1] - behind[1]) / (2 * step)
        np.testing.assert_allclose(hessian[place], difference, atol=1e-4 * abs(hessian).max())


@pytest.mark.parametrize("frame", [None, SHEARED])
def test_energy_does_not_depend_on_where_periodic_fabric_is_cut(frame):
    shape, folded = folded_periodic(frame=frame)
    energy, _ = barrier_on(shape).evaluate(np.asarray(folded.flattened()))
    lengths = folded.lengths
    lattice = np.diag(lengths[:2])
    if frame is not None:
        lattice[0, 1] = lengths[2]
        lattice = lattice @ frame
    for axis, component in ((0, 1), (1, 0)):
        turned = np.roll(folded.positions, -3, axis=axis).copy()
        last = [slice(None), slice(None)]
        last[axis] = slice(-3, None)
        turned[(*last, slice(2))] += lattice[:, component]
        cut = Configuration(turned, folded.lengths)
        again, _ = barrier_on(shape).evaluate(np.asarray(cut.flattened()))
        assert again == pytest.approx(energy, rel=1e-9)


def test_energy_does_not_depend_on_the_axes_that_describe_periodic_fabric():
    shape, folded = folded_periodic()
    energy, _ = barrier_on(shape).evaluate(np.asarray(folded.flattened()))
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    frame = turn @ np.diag(folded.lengths)
    nodes = np.asarray(folded.positions).copy()
    nodes[..., :2] = nodes[..., :2] @ turn.T
    turned = Configuration(nodes, np.array([1.0, 1.0, 0.0]))
    other = barrier_on(shape).on(MeshShape(8, 8, True, tuple(map(tuple, frame.tolist()))))
    assert other.evaluate(np.asarray(turned.flattened()))[0] == pytest.approx(energy, rel=1e-9)


def test_near_parts_only_keep_from_passing_through_each_other():
    shape = MeshShape(1, 2, periodic=False)
    for above, acts in ((2.1, False), (1.8, True)):
        nodes = np.zeros((2, 3, 3))
        nodes[..., 0] = np.array([0, CELL, 0])
        nodes[..., 2] = np.array([0, 0, above * (1 + CONTACT_RANGE) * NEAR * THICKNESS])
        nodes[1, :, 1] = CELL
        energy, _ = barrier_on(shape).evaluate(Configuration(nodes, np.zeros(2)).flattened())
        assert (energy > 0) == acts
