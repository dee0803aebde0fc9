"""Fold angles of a sheet with one given fold, up to and beyond half a turn."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from knitlab.model.energy import energy, fold_angles
from knitlab.model.fabric import Configuration, flat_sheet
from knitlab.observables.folds import hinges_past_pi
from tests.fabrics import CLAMPED, pure, stripe

FOLD_LINE = 2


def folded(angle: float) -> tuple:
    """A sheet folded by an angle about its third line of nodes, with unstretched springs."""
    net, fabric = pure(stripe("rib", 4), CLAMPED)
    nodes = np.array(flat_sheet(net, fabric).positions)
    line = nodes[0, FOLD_LINE, 0]
    arm = nodes[:, FOLD_LINE:, 0] - line
    nodes[:, FOLD_LINE:, 0] = line + arm * np.cos(angle)
    nodes[:, FOLD_LINE:, 2] = -arm * np.sin(angle)
    on_line = net.wale & (net.hinge_cells[:, 1] == FOLD_LINE)
    rest = jnp.where(jnp.asarray(on_line), 2.5, 0.0)
    fabric = eqx.tree_at(lambda f: (f.rest_fold, f.z_max), fabric, (rest, jnp.asarray(1e3)))
    return net, fabric, Configuration(nodes, np.zeros(2)), on_line


@pytest.mark.slow
@pytest.mark.parametrize("angle", [0.0, 1.0, 3.0, 3.3, 4.5])
def test_a_fold_is_followed_past_half_a_turn(angle):
    net, fabric, configuration, on_line = folded(angle)
    angles = np.asarray(fold_angles(net, fabric, configuration))
    assert np.allclose(angles, np.where(on_line, angle, 0.0), atol=1e-12)
    exact = 0.5 * float(fabric.fold_stiffness[on_line] @ np.full(on_line.sum(), (angle - 2.5) ** 2))
    assert float(energy(net, fabric, configuration).total) == pytest.approx(exact, abs=1e-12)
    assert int(hinges_past_pi(net, fabric, configuration)) == (
        on_line.sum() if angle > np.pi else 0
    )


@pytest.mark.slow
def test_forces_are_smooth_where_a_fold_passes_half_a_turn():
    def gradient(angle: float) -> np.ndarray:
        net, fabric, configuration, _ = folded(angle)
        total = jax.grad(lambda at: energy(net, fabric, at).total)
        return np.asarray(total(configuration).flattened())

    before, after = gradient(np.pi - 1e-6), gradient(np.pi + 1e-6)
    assert np.abs(before).max() > 1e-3
    assert np.abs(after - before).max() < 1e-5


def test_hinges_without_stiffness_are_not_counted():
    net, fabric, configuration, _ = folded(3.3)
    floppy = eqx.tree_at(lambda f: f.fold_stiffness, fabric, 0 * fabric.fold_stiffness)
    states = Configuration.stacked([configuration, configuration])
    assert hinges_past_pi(net, floppy, states).tolist() == [0, 0]
    assert (np.asarray(hinges_past_pi(net, fabric, states)) > 0).all()
