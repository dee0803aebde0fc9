"""Pure stripes against closed forms and an independent solution with three unknowns."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import root

from knitlab.model.reading import Reading
from knitlab.model.zigzag import tension, zigzag
from tests.fabrics import ALL_STRIPES, CLAMPED, ENDLESS, FINE, pure, relaxed, stretched

NAMES = [f"{of.knit} {of.n}" for of in ALL_STRIPES]
STRAINS = [0.0, 0.05, 0.3, 0.8, 1.3, 1.7, 2.0]


def cell_forces(of, theta, length, height):
    """∂e/∂length and ∂e/∂height of one grid cell of a pure stripe [N]."""
    cell = of.period / 4 / np.sin(of.theta_0 / 2)
    diagonal = np.hypot(length, height)
    pull = 2 * of.k_s * (diagonal - np.sqrt(2) * cell) / diagonal
    return (
        of.k_s * (length - cell) + pull * length,
        of.k_s * (height - cell) + pull * height,
    )


def across_the_ridges(of, strain):
    """(row height over cell, force on a row) when the period is prescribed: θ, ℓ, h balance."""
    cell = of.period / 4 / np.sin(of.theta_0 / 2)
    period = of.period * (1 + strain)

    def imbalance(unknowns):
        theta, height = unknowns
        length = period / (4 * np.sin(theta / 2))
        along, other = cell_forces(of, theta, length, height)
        turn = -along * length / (2 * np.tan(theta / 2)) + of.k_t * (theta - of.theta_0) / 2
        return turn, other

    flat = min(0.999, (1 + strain) * np.sin(of.theta_0 / 2))
    found = root(imbalance, (2 * np.arcsin(flat), cell), tol=1e-14)
    theta, height = found.x
    assert np.abs(imbalance(found.x)).max() < 1e-11
    along, _ = cell_forces(of, theta, period / (4 * np.sin(theta / 2)), height)
    return height / cell, along / np.sin(theta / 2)


def along_the_ridges(of, strain):
    """(cell length over flat, force on a column) when the row height is prescribed."""
    cell = of.period / 4 / np.sin(of.theta_0 / 2)
    height = cell * (1 + strain)
    found = root(lambda x: cell_forces(of, None, x[0], height)[0], [cell], tol=1e-14)
    return found.x[0] / cell, cell_forces(of, None, found.x[0], height)[1]


@pytest.mark.parametrize("reading", [ENDLESS, CLAMPED], ids=["endless", "clamped"])
@pytest.mark.parametrize("of", ALL_STRIPES, ids=NAMES)
def test_a_pure_stripe_relaxes_to_the_sine_of_half_its_rest_angle(of, reading):
    net, fabric = pure(of, reading)
    state = relaxed(net, fabric, FINE)
    assert state.converged
    assert float(state.energy.total) == pytest.approx(0, abs=1e-15)
    cells, cell = 4, float(fabric.cell[0])
    if reading is ENDLESS:
        lengths = state.configuration[-2:] / (cells * cell)
        across, straight = lengths if of.knit == "rib" else lengths[::-1]
    else:
        nodes = state.configuration[:-2].reshape(net.shape.nodes_y, net.shape.nodes_x, 3)
        if of.knit == "garter":
            nodes = nodes.swapaxes(0, 1)
        # An open sample's first fold is at line 2, so its ends lie level: the facets' chords.
        across = np.linalg.norm(nodes[0, 4] - nodes[0, 0]) / (cells * cell)
        straight = np.linalg.norm(nodes[4, 0] - nodes[0, 0]) / (cells * cell)
    assert across == pytest.approx(of.contraction, rel=1e-8)
    assert straight == pytest.approx(1, rel=1e-8)


@pytest.mark.parametrize("of", ALL_STRIPES, ids=NAMES)
def test_tension_across_the_ridges_is_that_of_three_unknowns(of):
    net, fabric = pure(of, ENDLESS, ridges="G")
    test = stretched(net, fabric, STRAINS, FINE)
    assert len(test.states) == len(STRAINS)
    for strain, state in zip(STRAINS[1:], test.states[1:], strict=True):
        width, force = across_the_ridges(of, strain)
        assert state.configuration[-2] / (4 * fabric.cell[0]) == pytest.approx(width, rel=1e-6)
        assert test.loading.reaction_force(state.gradient) == pytest.approx(4 * force, rel=1e-6)


@pytest.mark.parametrize("of", ALL_STRIPES, ids=NAMES)
def test_tension_along_the_ridges_is_that_of_three_unknowns(of):
    net, fabric = pure(of, ENDLESS, ridges="R")
    strains = [0.0, 0.1, 0.2, 0.45]
    test = stretched(net, fabric, strains, FINE)
    for strain, state in zip(strains[1:], test.states[1:], strict=True):
        length, force = along_the_ridges(of, strain)
        width = 4 * float(fabric.cell[0]) * length * of.contraction
        assert state.configuration[-2] == pytest.approx(width, rel=1e-6)
        assert test.loading.reaction_force(state.gradient) == pytest.approx(4 * force, rel=1e-6)


@pytest.mark.parametrize("of", ALL_STRIPES, ids=NAMES)
@pytest.mark.parametrize(("boundary", "periods"), [("periodic", 1), ("clamped", 2)])
def test_the_sheet_is_the_zigzag_within_five_percent_while_it_unfolds(of, boundary, periods):
    reading = Reading(boundary=boundary, fold_phase="stripe_centre")
    net, fabric = pure(of, reading, periods=periods, ridges="G")
    test = stretched(net, fabric, [0.0, 0.1, 0.3])
    assert all(state.converged for state in test.states)
    force = [test.loading.reaction_force(state.gradient) for state in test.states[1:]]
    zigzag_force = tension(zigzag(of), jnp.array([0.1, 0.3]))
    np.testing.assert_allclose(np.array(force) / net.shape.cells_x, zigzag_force, rtol=0.05)
