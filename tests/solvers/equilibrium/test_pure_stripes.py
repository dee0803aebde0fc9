"""Pure stripes against closed forms and an independent solution with three unknowns."""

from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import root

from knitlab.model.pure_stripe import PureStripe, tension_across, tension_along
from knitlab.model.spring_curve import SpringCurve
from knitlab.model.zigzag import zigzag
from tests.fabrics import (
    CLAMPED,
    DEFAULT,
    DISTINCT_STRIPES,
    FINE,
    PERIODIC,
    SHEET,
    assemble_fabric,
    cell_of,
    compiled_tension,
    patch_map,
    pure,
    relaxed,
    stretched,
    stripe,
)

LONG_STEPS = replace(DEFAULT, path_step=0.05)
FINEST = replace(FINE, tolerance=1e-13)
"""Sheets whose ridges bend freely: 6e-13 N leave 2e-8 of a clamped garter 16's width."""
STRAINS = [0.0, 0.05, 0.3, 0.8, 1.3, 1.7, 2.0]


def cell_forces(of, length, height, diagonals=1.0):
    """∂e/∂length and ∂e/∂height of one grid cell of a pure stripe [N]."""
    cell = of.period / 4 / np.sin(of.theta_0 / 2)
    diagonal = np.hypot(length, height)
    pull = 2 * diagonals * of.k_s * (diagonal - np.sqrt(2) * cell) / diagonal
    return (of.k_s * (length - cell) + pull * length, of.k_s * (height - cell) + pull * height)


def across_the_ridges(of, strain, diagonals=1.0):
    """(row height over cell, force on a row) when the period is prescribed: θ, ℓ, h balance."""
    cell = of.period / 4 / np.sin(of.theta_0 / 2)
    period = of.period * (1 + strain)

    def imbalance(unknowns):
        theta, height = unknowns
        length = period / (4 * np.sin(theta / 2))
        along, other = cell_forces(of, length, height, diagonals)
        turn = -along * length / (2 * np.tan(theta / 2)) + of.k_t * (theta - of.theta_0) / 2
        return turn, other

    flat = min(0.999, (1 + strain) * np.sin(of.theta_0 / 2))
    found = root(imbalance, (2 * np.arcsin(flat), cell), tol=1e-14)
    theta, height = found.x
    assert np.abs(imbalance(found.x)).max() < 1e-11
    along, _ = cell_forces(of, period / (4 * np.sin(theta / 2)), height, diagonals)
    return height / cell, along / np.sin(theta / 2)


def along_the_ridges(of, strain):
    """(cell length over flat, force on a column) when the row height is prescribed."""
    cell = of.period / 4 / np.sin(of.theta_0 / 2)
    height = cell * (1 + strain)
    found = root(lambda x: cell_forces(of, x[0], height)[0], [cell], tol=1e-14)
    return found.x[0] / cell, cell_forces(of, found.x[0], height)[1]


@pytest.mark.slow
@pytest.mark.parametrize("options", [PERIODIC, CLAMPED], ids=["periodic", "clamped"])
@DISTINCT_STRIPES
def test_a_pure_stripe_relaxes_to_the_sine_of_half_its_rest_angle(of, options):
    net, fabric = pure(of, options)
    state = relaxed(net, fabric, FINEST)
    assert state.converged
    assert float(state.energy.total) == pytest.approx(0, abs=1e-15)
    cells, cell = 4, float(cell_of(fabric)[0])
    if options is PERIODIC:
        lengths = state.configuration.lengths / (cells * cell)
        across, straight = lengths if of.knit == "rib" else lengths[::-1]
    else:
        nodes = state.configuration.positions
        if of.knit == "garter":
            nodes = nodes.swapaxes(0, 1)
        # The first fold of an open sample is at line 2, so that its ends are at equal height.
        across = np.linalg.norm(nodes[0, 4] - nodes[0, 0]) / (cells * cell)
        straight = np.linalg.norm(nodes[4, 0] - nodes[0, 0]) / (cells * cell)
    assert across == pytest.approx(of.contraction, rel=1e-8)
    assert straight == pytest.approx(1, rel=1e-8)


@pytest.mark.slow
@DISTINCT_STRIPES
def test_tension_across_the_ridges_is_that_of_three_unknowns(of):
    net, fabric = pure(of, PERIODIC, ridges="G")
    test = stretched(net, fabric, STRAINS, FINE)
    assert len(test.states) == len(STRAINS)
    for strain, state in zip(STRAINS[1:], test.states[1:], strict=True):
        width, force = across_the_ridges(of, strain)
        assert state.configuration.lengths[0] / (4 * cell_of(fabric)[0]) == pytest.approx(
            width, rel=1e-6
        )
        assert test.loading.reaction_force(state.gradient) == pytest.approx(4 * force, rel=1e-6)


@DISTINCT_STRIPES
def test_tension_along_the_ridges_is_that_of_three_unknowns(of):
    net, fabric = pure(of, PERIODIC, ridges="R")
    strains = [0.0, 0.1, 0.2, 0.45]
    test = stretched(net, fabric, strains, FINE)
    for strain, state in zip(strains[1:], test.states[1:], strict=True):
        length, force = along_the_ridges(of, strain)
        width = 4 * float(cell_of(fabric)[0]) * length * of.contraction
        assert state.configuration.lengths[0] == pytest.approx(width, rel=1e-6)
        assert test.loading.reaction_force(state.gradient) == pytest.approx(4 * force, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(
    "choice", [{"cell_size": "flat"}, {"hinge_stiffness": "per_length"}, {"length_scale": 3.0}]
)
def test_model_options_act_on_the_zigzag_as_on_the_sheet(choice):
    of = stripe("garter", 12)
    options = replace(PERIODIC, fold_phase="stripe_centre", **choice)
    test = stretched(*pure(of, options, ridges="G"), [0.0, 0.1])
    (force,) = row_force(pure(of, options)[0], test)
    assert force == pytest.approx(
        float(compiled_tension(zigzag(of, options), jnp.array([0.1]))[0]), rel=0.01
    )
    assert force != pytest.approx(float(compiled_tension(zigzag(of), jnp.array([0.1]))[0]), rel=0.1)


@pytest.mark.slow
@DISTINCT_STRIPES
def test_a_periodic_sheet_without_diagonals_is_the_zigzag(of):
    """First of the two reasons why 3D is stiffer than 2D at large strain."""
    force = [across_the_ridges(of, strain, diagonals=0.0)[1] for strain in STRAINS[1:]]
    np.testing.assert_allclose(
        force, compiled_tension(zigzag(of), jnp.array(STRAINS[1:])), rtol=1e-8
    )
    net, fabric = weakly_braced(of, PERIODIC, 0.01)
    test = stretched(net, fabric, [0.0, 0.3, 1.0, 1.5], LONG_STEPS)
    expected = compiled_tension(zigzag(of), jnp.array([0.3, 1.0, 1.5]))
    np.testing.assert_allclose(row_force(net, test), expected, rtol=0.01)


@pytest.mark.slow
@pytest.mark.nightly
@pytest.mark.parametrize("ridges", ["G", "R"])
@pytest.mark.parametrize(
    "curve", [None, SpringCurve((0.0, 0.1, 0.3), (0.0, 1.0, 6.0))], ids=["linear", "curve"]
)
def test_springs_along_the_ridges_act_as_in_the_sheet_of_three_unknowns(ridges, curve):
    """Their stiffness is over width, so that it is that of a spring of a square cell."""
    of = replace(stripe("rib", 4), stretch_along=0.03, curve_along=curve)
    strains = [0.0, 0.1, 0.3]
    test = stretched(*pure(of, PERIODIC, ridges=ridges), strains, FINE)
    sheet = PureStripe.of(of)
    tension = {"G": tension_across, "R": tension_along}[ridges]
    expected = tension(sheet, jnp.array(strains[1:]))
    found = [test.loading.reaction_force(state.gradient) / 4 for state in test.states[1:]]
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_a_stripe_in_rows_of_another_width_has_the_same_force_over_width():
    """A row of rib is as wide as the garter's cells are high, here 1.5 times as wide as its own."""
    rib = stripe("rib", 4)
    own = float(PureStripe.of(rib).cell)
    rib = replace(rib, row_width=own)
    garter = replace(stripe("garter", 8), period=1.5 * rib.period, theta_0=rib.theta_0)
    options = replace(PERIODIC, cell_size="relaxed")
    net, fabric = assemble_fabric(patch_map(["R"], 1), rib, garter, SHEET, options)
    np.testing.assert_allclose(fabric.stretch_stiffness[net.weft], 1.5 * rib.k_s)
    folds = net.wale & (fabric.rest_fold != 0)
    np.testing.assert_allclose(fabric.fold_stiffness[folds], 1.5 * rib.k_t)


def weakly_braced(of, options, factor):
    """A pure stripe with scaled stiffness of diagonals; without them shear would cost no energy."""
    net, fabric = pure(of, options, ridges="G")
    diagonal = ~(net.weft | net.warp)
    stiffness = fabric.stretch_stiffness * np.where(diagonal, factor, 1.0)
    return net, eqx.tree_at(lambda whole: whole.stretch_stiffness, fabric, stiffness)


def row_force(net, test):
    """Reaction force on one row of the network at every strain but the first [N]."""
    forces = [test.loading.reaction_force(state.gradient) for state in test.states[1:]]
    return np.array(forces) / net.shape.cells_x
