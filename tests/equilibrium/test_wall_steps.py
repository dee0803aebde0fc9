"""Steps between the walls end in the minimum of the quadratic energy with walls."""

import numpy as np
import pytest

from knitlab.equilibrium import wall_steps
from knitlab.equilibrium.equilibrium import find_equilibrium
from knitlab.equilibrium.equilibrium_search import Search, SearchRules
from knitlab.equilibrium.loading import all_free, tensile
from knitlab.equilibrium.relaxation import relax
from knitlab.equilibrium.settings import SolverSettings
from knitlab.equilibrium.wall_steps import step_between_walls
from knitlab.fabric.element_chunks import ChunkedFabric
from knitlab.fabric.energy import COMPLETE, Point
from knitlab.fabric.settings import Sheet
from tests.fabrics import CLAMPED, DEFAULT, checkerboard, equations, patterned

Z_MAX = 1.5
"""Narrow walls, which a relaxed sample touches in several places."""
STRAINS = 0.01, 0.015, 0.02, 0.03, 0.04, 0.06
LONG = SolverSettings(step_limit=1e3)


@pytest.fixture(scope="module")
def squeezed():
    net, fabric = patterned(4, checkerboard(2), CLAMPED, Sheet(z_max=Z_MAX, k_wall=100.0))
    return net, fabric, relax(equations(net, fabric), DEFAULT)


def displaced(state, distance, seed):
    return state.unknowns + distance * np.random.default_rng(seed).normal(size=len(state.unknowns))


def stepped(squeezed, unknowns, shift, settings=LONG):
    """The search, its step between the walls, and a solve after it, of a stiffness plus a shift."""
    net, fabric, _ = squeezed
    rules = SearchRules.of(net.shape, all_free(net.shape), fabric, settings)
    system = equations(net, fabric)
    search = Search(system, Point(unknowns), rules)
    system.assemble(search.at, rules.free)
    assert system.factorise(shift, convexified=False, exact=True)
    return search, step_between_walls(search), system.solve(search.gradient)


def stiffness(squeezed, unknowns, shift):
    """The stiffness of the free unknowns plus a shift, as a dense matrix."""
    net, fabric, _ = squeezed
    free = SearchRules.of(net.shape, all_free(net.shape), fabric, LONG).free
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
    search, found, _ = stepped(squeezed, unknowns, shift)
    heights = search.rules.free.heights
    z, rise = unknowns[search.places[heights]], found.step[heights]
    before, after = np.abs(z) > Z_MAX, np.abs(z + rise) > Z_MAX
    assert ((after & ~before).sum(), (before & ~after).sum()) == (arrive, leave)
    # The quadratic model without walls, and these as they are after the step.
    model, k_wall = stiffness(squeezed, unknowns, shift), float(fabric.k_wall)
    force = search.gradient + model @ found.step
    force[heights] += k_wall * (depth(z + rise) - depth(z) - before * rise)
    assert np.abs(force).max() < 1e-9 * np.abs(search.gradient).max()
    assert found.curvature == pytest.approx(found.step @ model @ found.step, rel=1e-9)


@pytest.mark.parametrize(("limit", "value"), [("MOST_CHANGES", 3), ("MOST_ACTIVE_SETS", 1)])
def test_a_step_that_does_not_settle_ignores_nodes_that_come_to_a_wall(
    squeezed, monkeypatch, limit, value
):
    monkeypatch.setattr(wall_steps, limit, value)
    unknowns = displaced(squeezed[2], 0.003, 0)
    search, found, solved = stepped(squeezed, unknowns, 0.1)
    newton = np.linalg.solve(stiffness(squeezed, unknowns, 0.1), -search.gradient)
    np.testing.assert_allclose(found.step, newton, rtol=0, atol=1e-9 * np.abs(newton).max())
    assert found.curvature == pytest.approx(-search.gradient @ newton, rel=1e-9)
    # Nothing of the attempt is left in the factorised stiffness.
    np.testing.assert_allclose(solved, -newton, rtol=0, atol=1e-9 * np.abs(newton).max())


def test_only_the_part_of_a_step_within_the_step_limit_meets_walls(squeezed):
    """A step of a thousandth of its length brings no further node to a wall."""
    unknowns = displaced(squeezed[2], 0.003, 0)
    search, whole, _ = stepped(squeezed, unknowns, 0.1)
    cell = float(squeezed[1].cell_sides.min())
    limit = 1e-3 / search.rules.longest_part(whole.step) * LONG.step_limit
    search, found, _ = stepped(squeezed, unknowns, 0.1, SolverSettings(step_limit=limit))
    assert search.rules.step_length == pytest.approx(limit * cell)
    newton = np.linalg.solve(stiffness(squeezed, unknowns, 0.1), -search.gradient)
    np.testing.assert_allclose(found.step, newton, rtol=0, atol=1e-9 * np.abs(newton).max())


def test_searches_reach_the_same_states_with_fewer_factorisations(squeezed, monkeypatch):
    net, fabric, relaxed = squeezed
    loading = tensile(net.shape, relaxed.configuration)
    rules = SearchRules.of(net.shape, loading.free, fabric, DEFAULT)

    def states():
        starts = [loading.ahead([(0.0, relaxed.unknowns)], strain) for strain in STRAINS]
        return [find_equilibrium(equations(net, fabric), Point(at), rules) for at in starts]

    predicted = states()
    monkeypatch.setattr(wall_steps, "MOST_CHANGES", 0)
    unpredicted = states()
    assert all(state.converged for state in (*predicted, *unpredicted))
    for one, other in zip(predicted, unpredicted, strict=True):
        assert float(one.energy.total) == pytest.approx(float(other.energy.total), rel=1e-7)
    # Each search by itself may need one more, by chance.
    needed, without = (
        sum(state.factorisations for state in found) for found in (predicted, unpredicted)
    )
    assert needed < without
