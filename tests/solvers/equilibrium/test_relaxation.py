"""Relaxation: its start from periodic fabric, its cost, and active walls."""

import jax
import numpy as np
import pytest

from knitlab.model.energy import energy
from knitlab.solvers.equilibrium.tensile_test import relax, tiled
from tests.fabrics import CLAMPED, DEFAULT, PERIODIC, checkered, equations, relaxed

REACH = 2
"""Number of lines of nodes over which the edge of a sample affects forces."""


def fabric_layout(n_stripe, periods, unit_cells):
    """A sample of relaxed periodic fabric."""
    cell_net, cell = checkered(n_stripe, periods, PERIODIC)
    net, fabric = checkered(n_stripe, periods, CLAMPED, unit_cells)
    state = relaxed(cell_net, cell)
    return net, fabric, tiled(net, fabric, cell_net, state.configuration), state


@pytest.mark.slow
def test_a_sample_tiled_with_periodic_fabric_is_in_equilibrium_except_at_its_edges():
    net, fabric, start, cell = fabric_layout(4, 1, (3, 2))
    forces = jax.grad(lambda at: energy(net, fabric, at).total)(start).positions
    inner = forces[REACH:-REACH, REACH:-REACH]
    assert np.abs(inner).max() <= 10 * cell.residual
    assert np.abs(forces).max() > 1e-3


@pytest.mark.slow
def test_flat_and_periodic_starts_reach_the_same_state():
    net, fabric, start, _ = fabric_layout(4, 2, (2, 2))
    laid = relax(equations(net, fabric), DEFAULT, start)
    flat = relaxed(net, fabric)
    assert laid.converged
    assert flat.converged
    assert float(laid.energy.total) == pytest.approx(float(flat.energy.total), rel=1e-8)
