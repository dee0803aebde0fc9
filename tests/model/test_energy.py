import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from knitlab.model.energy import energy
from knitlab.model.fabric import Configuration, flat_sheet
from knitlab.model.settings import ModelOptions
from tests.fabrics import ALL_STRIPES, CLAMPED, PERIODIC, cell_of, checkered, pure, shaken


def zigzag(net, fabric, of):
    """The relaxed pure stripe in closed form: facets of two cells, folded to θ0."""
    y, x = np.mgrid[: net.shape.nodes_y, : net.shape.nodes_x]
    along = x if of.knit == "rib" else y
    other = y if of.knit == "rib" else x
    cell = float(cell_of(fabric)[0])
    # Line 2 of an open run is its first mountain, line 0 of a periodic one a valley before it.
    height = cell * np.cos(of.theta_0 / 2) * (2 - np.abs((along % 4) - 2))
    across, straight = cell * np.sin(of.theta_0 / 2) * along, cell * other
    in_plane = (across, straight) if of.knit == "rib" else (straight, across)
    nodes = np.stack([*in_plane, height], axis=-1)
    contracted = np.array([of.contraction, 1.0]) if of.knit == "rib" else [1.0, of.contraction]
    lengths = cell * np.array([net.shape.cells_x, net.shape.cells_y]) * contracted
    return Configuration(nodes, lengths)


@pytest.mark.slow
@pytest.mark.parametrize("options", [PERIODIC, CLAMPED], ids=["periodic", "clamped"])
@pytest.mark.parametrize("of", ALL_STRIPES, ids=lambda of: f"{of.knit} {of.n}")
def test_the_folded_zigzag_costs_no_energy(of, options):
    net, fabric = pure(of, options, periods=2)
    parts = energy(net, fabric, zigzag(net, fabric, of))
    assert float(parts.total) == pytest.approx(0, abs=1e-25)


@pytest.mark.slow
@pytest.mark.parametrize("boundary", ["clamped", "periodic"])
@pytest.mark.parametrize("stiffness", ["per_edge", "per_length"])
@pytest.mark.parametrize("angle", ["whole_normals", "across_edge"])
def test_gradient_is_the_slope_of_the_energy(boundary, stiffness, angle):
    options = ModelOptions(boundary=boundary, hinge_stiffness=stiffness, fold_angle=angle)
    net, fabric = checkered(4, 1, options)
    at = shaken(flat_sheet(net, fabric), 0.1).flattened()
    toward = np.random.default_rng(1).normal(size=at.shape)
    total = jax.jit(lambda q: energy(net, fabric, Configuration.of(q, net.shape)).total)
    step = 1e-5
    slope = (total(at + step * toward) - total(at - step * toward)) / (2 * step)
    assert float(jax.grad(total)(at) @ toward) == pytest.approx(float(slope), rel=1e-7)


@pytest.mark.slow
@settings(max_examples=20)
@given(
    st.lists(st.floats(-3, 3), min_size=3, max_size=3),
    st.lists(st.floats(-5, 5), min_size=3, max_size=3),
)
def test_rigid_motion_changes_no_energy(turn, shift):
    net, fabric = checkered(6, 1, CLAMPED)
    at = shaken(flat_sheet(net, fabric), 0.2)
    moved = Rotation.from_rotvec(turn).apply(np.array(at.positions).reshape(-1, 3)) + shift
    shifted = Configuration(moved.reshape(at.positions.shape), at.lengths)
    before, after = energy(net, fabric, at), energy(net, fabric, shifted)
    assert float(after.stretch) == pytest.approx(float(before.stretch), rel=1e-10)
    assert float(after.fold) == pytest.approx(float(before.fold), rel=1e-10)


def test_the_energy_of_periodic_fabric_does_not_depend_on_translation_or_origin():
    net, fabric = checkered(4, 1, PERIODIC)
    at = shaken(flat_sheet(net, fabric), 0.1)
    slid = Configuration(at.positions + np.array([0.7, -1.3, 0]), at.lengths)
    assert float(energy(net, fabric, slid).total) == pytest.approx(
        float(energy(net, fabric, at).total), rel=1e-12
    )
    # One column of nodes is counted in the next period instead of this one.
    cut = jnp.roll(at.positions, -1, axis=1).at[:, -1, 0].add(at.lengths[0])
    springs_only = energy(net, fabric, Configuration(cut, at.lengths)).stretch
    assert float(springs_only) == pytest.approx(float(energy(net, fabric, at).stretch), rel=1e-12)


def test_the_wall_acts_beyond_z_max_on_both_sides():
    net, fabric = checkered(4, 1, CLAMPED)
    flat = flat_sheet(net, fabric).positions
    for z, beyond in ((5.9, 0.0), (6.2, 0.2), (-6.2, 0.2)):
        shifted = Configuration(flat + np.array([0.0, 0.0, z]), np.zeros(2))
        expected = 0.5 * 100 * beyond**2 * net.shape.nodes
        assert float(energy(net, fabric, shifted).wall) == pytest.approx(expected)
