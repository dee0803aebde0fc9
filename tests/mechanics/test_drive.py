import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from knitlab.mechanics.drive import run_all
from knitlab.mechanics.solver import SolverSettings
from knitlab.mechanics.tension import stretch
from tests.fabrics import ENDLESS, checkered, stretched

STRAINS = [0.0, 0.05, 0.1]


def in_one_batch(net, fabrics):
    tests = [stretch(net, fabric, STRAINS, SolverSettings()) for fabric in fabrics]
    return run_all(net.shape, fabrics, tests)


def test_a_batch_gives_what_its_fabrics_give_alone():
    net, four = checkered(4, 1, ENDLESS)
    _, eight = checkered(8, 1, ENDLESS)
    for fabric, together in zip((four, eight), in_one_batch(net, [four, eight]), strict=True):
        alone = stretched(net, fabric, STRAINS)
        for state, other in zip(alone.states, together.states, strict=True):
            assert float(state.energy.total) == pytest.approx(float(other.energy.total), rel=1e-9)
            assert np.allclose(state.configuration[-2:], other.configuration[-2:], rtol=1e-6)


def test_a_poisoned_fabric_disturbs_no_neighbour():
    net, sound = checkered(4, 1, ENDLESS)
    poisoned = eqx.tree_at(lambda f: f.rest_length, sound, sound.rest_length.at[3].set(jnp.nan))
    first, broken, last = in_one_batch(net, [sound, poisoned, sound])
    assert all(state.converged for state in first.states)
    assert first.states[-1].residual == last.states[-1].residual
    assert not broken.states[0].converged
    assert broken.loading is None
