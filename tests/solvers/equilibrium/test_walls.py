"""Steps between walls: to the minimum of a quadratic energy, and the lowest part of a step."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from knitlab.model.energy import COMPLETE, Point
from knitlab.model.settings import Sheet
from knitlab.solvers.element_chunks import ChunkedFabric
from knitlab.solvers.equilibrium.equilibrium import find_equilibrium
from knitlab.solvers.equilibrium.search import (
    Search,
    SearchRules,
    lowest_fraction,
    step_between_walls,
)
from knitlab.solvers.equilibrium.settings import Solver
from knitlab.solvers.equilibrium.stiffness import free_stiffness
from knitlab.solvers.equilibrium.tensile_test import relax
from knitlab.solvers.loads.loading import all_free, loading_of
from tests.fabrics import CLAMPED, DEFAULT, checkerboard, equations, patterned, unchecked

Z_MAX = 1.5
"""Narrow walls, which a relaxed sample touches in several places."""
STRAINS = 0.01, 0.015, 0.02, 0.03, 0.04, 0.06
LONG = unchecked(Solver(), step_limit=1e3)


@pytest.fixture(scope="module")
def squeezed():
    net, fabric = patterned(4, checkerboard(2), CLAMPED, Sheet(z_max=Z_MAX, k_wall=100.0))
    return net, fabric, relax(equations(net, fabric), DEFAULT)


def displaced(state, distance, seed):
    return state.unknowns + distance * np.random.default_rng(seed).normal(size=len(state.unknowns))


def stepped(squeezed, unknowns, shift, settings=LONG):
    """The search, its step between the walls, and a solve after it, of a stiffness plus a shift."""
    net, fabric, _ = squeezed
    rules = SearchRules(free_stiffness(net.shape, all_free(net.shape)), settings)
    system = equations(net, fabric)
    search = Search(system, Point(unknowns), rules)
    system.assemble(search.at, rules.free)
    assert system.factorise(shift, convexified=False, exact=True)
    return search, step_between_walls(search), system.solve(search.gradient)


def stiffness(squeezed, unknowns, shift):
    """The stiffness of the free unknowns plus a shift, as a dense matrix."""
    net, fabric, _ = squeezed
    free = free_stiffness(net.shape, all_free(net.shape))
    hessians = ChunkedFabric(net.shape, fabric).element_hessians(COMPLETE, unknowns)
    lower = free.lower(free.shifted(free.entries(hessians), shift)).toarray()
    return lower + np.tril(lower, -1).T


def depth(z):
    return z - np.clip(z, -Z_MAX, Z_MAX)


@pytest.mark.parametrize(
    ("distance", "shift", "seed", "arrive", "leave"),
    [(0.003, 0.1, 0, 10, 0), (0.003, 0.1, 2, 8, 0), (0.03, 1.0, 2, 1, 1), (0.1, 10.0, 0, 0, 3)],
)
def test_no_force_is_left_in_the_model_after_the_step(
    squeezed, distance, shift, seed, arrive, leave
):
    fabric, unknowns = squeezed[1], displaced(squeezed[2], distance, seed)
    search, (step, curvature), _ = stepped(squeezed, unknowns, shift)
    heights = search.rules.free.heights
    z, rise = unknowns[search.dofs[heights]], step[heights]
    before, after = np.abs(z) > Z_MAX, np.abs(z + rise) > Z_MAX
    assert ((after & ~before).sum(), (before & ~after).sum()) == (arrive, leave)
    # The quadratic model without walls, and these as they are after the step.
    model, k_wall = stiffness(squeezed, unknowns, shift), float(fabric.k_wall)
    force = search.gradient + model @ step
    force[heights] += k_wall * (depth(z + rise) - depth(z) - before * rise)
    assert np.abs(force).max() < 1e-9 * np.abs(search.gradient).max()
    assert curvature == pytest.approx(step @ model @ step, rel=1e-9)


@pytest.mark.slow
def test_searches_reach_the_same_states_with_fewer_factorisations(squeezed, monkeypatch):
    net, fabric, relaxed = squeezed
    loading = loading_of(net.shape, relaxed.configuration)
    rules = SearchRules(free_stiffness(net.shape, loading.free), DEFAULT)

    def states():
        starts = [loading.ahead([(0.0, relaxed.unknowns)], strain) for strain in STRAINS]
        return [find_equilibrium(equations(net, fabric), Point(at), rules) for at in starts]

    predicted = states()
    monkeypatch.setattr("knitlab.solvers.equilibrium.search.MAX_WALL_CHANGES", 0)
    unpredicted = states()
    assert all(state.converged for state in (*predicted, *unpredicted))
    for one, other in zip(predicted, unpredicted, strict=True):
        assert float(one.energy.total) == pytest.approx(float(other.energy.total), rel=1e-7)
    # Each search by itself may need one more, by chance.
    needed, without = (
        sum(state.factorisations for state in found) for found in (predicted, unpredicted)
    )
    assert needed < without


HALF_GAP, STIFFNESS = 6.0, 100.0
"""Half the gap between the walls, and their stiffness."""
FRACTIONS = np.linspace(0.0, 1.0, 10_001)


def modelled(z, dz, slope, curvature, part=1.0):
    """Energy along a step: a quadratic with the penalty of the walls on its own."""
    touched = np.abs(z) > HALF_GAP
    stiffness = part * STIFFNESS
    depth = np.where(touched, z - np.sign(z) * HALF_GAP, 0.0)
    along = FRACTIONS[:, None] * dz
    excess = np.maximum(np.abs(z + along) - HALF_GAP, 0.0)
    walls = stiffness / 2 * (excess**2).sum(axis=1)
    own_slope = slope - stiffness * depth @ dz
    own_curvature = curvature - stiffness * (dz[touched] ** 2).sum()
    return own_slope * FRACTIONS + own_curvature / 2 * FRACTIONS**2 + walls


@given(
    seed=st.integers(0, 2**32 - 1),
    nodes=st.integers(1, 30),
    length=st.floats(1e-3, 30.0),
    part=st.sampled_from([1.0, 1e-3]),
)
def test_the_fraction_has_the_least_energy(seed, nodes, length, part):
    random = np.random.default_rng(seed)
    z, dz = random.uniform(-6.01, 6.01, nodes), length * random.normal(size=nodes)
    touched = np.abs(z) > HALF_GAP
    fabric = random.uniform(0.01, 10.0)
    curvature = fabric + part * STIFFNESS * float((dz[touched] ** 2).sum())
    # A Newton step: without further contact the whole step has the least energy.
    fraction = lowest_fraction(z, dz, -curvature, curvature, HALF_GAP, part * STIFFNESS)
    energies = modelled(z, dz, -curvature, curvature, part)
    assert fraction == pytest.approx(FRACTIONS[np.argmin(energies)], abs=4e-4, rel=4e-3)
