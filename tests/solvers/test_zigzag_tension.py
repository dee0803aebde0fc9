"""The zigzag stretched by minimising its energy: against its closed form and virtual work."""

import jax.numpy as jnp
import numpy as np
import pytest

from knitlab.model.zigzag import chain_energy, zigzag
from knitlab.solvers.zigzag_tension import pull_chain
from tests.fabrics import DISTINCT_STRIPES, compiled_tension, stripe

STRAINS = np.linspace(0, 2, 21)


@pytest.mark.slow
@DISTINCT_STRIPES
def test_the_minimum_has_the_tension_of_the_closed_form(of):
    states = pull_chain(zigzag(of), 1, STRAINS)
    assert all(state.converged and state.residual <= 1e-12 for state in states)
    force = np.array([state.force for state in states])
    expected = np.asarray(compiled_tension(zigzag(of), jnp.asarray(STRAINS)))
    np.testing.assert_allclose(force, expected, rtol=1e-8, atol=1e-12)


@pytest.mark.slow
def test_every_period_carries_the_same_force():
    chain = zigzag(stripe("rib", 4))
    one, three = (pull_chain(chain, periods, [0.0, 0.7])[-1].force for periods in (1, 3))
    assert three == pytest.approx(one, rel=1e-9)


@pytest.mark.slow
def test_the_reaction_is_the_slope_of_the_energy():
    chain, step = zigzag(stripe("garter", 12)), 1e-5
    before, at, after = pull_chain(chain, 2, [0.8 - step, 0.8, 0.8 + step])
    rise = float(chain_energy(chain, after.nodes) - chain_energy(chain, before.nodes))
    length = 2 * float(chain.period)
    assert at.force == pytest.approx(rise / (2 * step * length), rel=1e-8)
