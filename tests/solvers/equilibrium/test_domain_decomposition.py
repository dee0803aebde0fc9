"""Subdomains of a large sample: each is a part of it, and the whole reaches equilibrium."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from knitlab.model.energy import COMPLETE, Energy, Evaluation, Point
from knitlab.model.threads import ALONE, Threads
from knitlab.solvers.element_chunks import ChunkedFabric
from knitlab.solvers.equilibrium import domain_decomposition, equilibrium, subdomains
from knitlab.solvers.equilibrium.domain_decomposition import SubdomainSolver
from knitlab.solvers.equilibrium.equilibrium import ROUNDS, SubdomainRounds, find_equilibrium
from knitlab.solvers.equilibrium.search import Search, SearchRules, minimise
from knitlab.solvers.equilibrium.state import Outcome, State
from knitlab.solvers.equilibrium.stiffness import free_stiffness
from knitlab.solvers.equilibrium.subdomains import (
    couplings,
    grid_subdomains,
    independent_groups,
    worth_dividing,
)
from knitlab.solvers.equilibrium.system import System
from knitlab.solvers.loads.loading import all_free, free_under
from tests.fabrics import CLAMPED, DEFAULT, PERIODIC, checkered, equations, unchecked


def slow(sample, step_length=0.3, settings=DEFAULT) -> SearchRules:
    """Search rules as in a tensile test."""
    net, fabric, loading = sample
    limit = step_length / float(fabric.cell_sides.min())
    free = free_stiffness(net.shape, loading.free)
    return SearchRules(free, unchecked(settings, step_limit=limit), convexified=False)


def whole_equilibrium(sample, start, rules) -> State:
    """The equilibrium of a sample that is solved as a whole."""
    search = Search(equations(*sample[:2]), start, rules)
    return search.state(minimise(search))


def solved_by_subdomains(system, *args):
    return SubdomainSolver(system).solve(system, *args)


@pytest.mark.slow
@pytest.mark.parametrize("dofs", [all_free, free_under])
def test_forces_on_a_subdomain_equal_those_in_the_whole_sample(small_subdomains, sample, dofs):
    net, fabric, loading = sample
    random = np.random.default_rng(0)
    at = loading.reference + 0.1 * random.normal(size=net.shape.unknowns)
    whole = ChunkedFabric(net.shape, fabric).evaluate(COMPLETE, at)
    free = free_stiffness(net.shape, dofs(net.shape))
    found = list(grid_subdomains(free))
    assert len(found) == 4
    for subdomain in found:
        own = ChunkedFabric(subdomain.free.shape, subdomain.fabric(fabric))
        gradient = np.asarray(own.evaluate(COMPLETE, at[subdomain.dofs]).gradient)
        movable = subdomain.free.dofs
        np.testing.assert_allclose(
            gradient[movable], np.asarray(whole.gradient)[subdomain.dofs[movable]], atol=1e-10
        )


def test_subdomains_move_every_free_unknown_and_no_held_one(small_subdomains, sample):
    net, _, loading = sample
    free = free_stiffness(net.shape, loading.free)
    moved = np.unique(np.concatenate([b.dofs[b.free.dofs] for b in grid_subdomains(free)]))
    np.testing.assert_array_equal(moved, loading.free)


def test_subdomains_are_coupled_if_one_moves_nodes_that_act_on_the_other(small_subdomains, sample):
    net, _, loading = sample
    found = list(grid_subdomains(free_stiffness(net.shape, loading.free)))
    moves = [set(subdomain.dofs[subdomain.free.dofs].tolist()) for subdomain in found]
    feels = [set(subdomain.dofs.tolist()) for subdomain in found]
    expected = [
        [bool(moves[i] & feels[j] or moves[j] & feels[i]) for j in range(len(found))]
        for i in range(len(found))
    ]
    np.testing.assert_array_equal(couplings(found, net.shape.unknowns), expected)


@given(st.integers(1, 12), st.integers(0, 2**32 - 1), st.floats(0, 1))
def test_groups_hold_every_subdomain_once_and_none_that_are_coupled(count, seed, density):
    random = np.random.default_rng(seed)
    meeting = random.random((count, count)) < density
    meeting = meeting | meeting.T | np.eye(count, dtype=bool)
    forces = random.random(count)
    found = list(independent_groups(forces, meeting))
    assert sorted(subdomain for together in found for subdomain in together) == [*range(count)]
    for place, together in enumerate(found):
        assert meeting[np.ix_(together, together)].sum() == len(together)
        waiting = [subdomain for later in found[place:] for subdomain in later]
        assert forces[together[0]] == forces[waiting].max()


@pytest.mark.slow
def test_two_threads_give_the_subdomain_solutions_of_one(small_subdomains, sample, monkeypatch):
    net, fabric, loading = sample
    # Even smaller subdomains, of which some are not coupled.
    monkeypatch.setattr(subdomains, "CELLS", 4)
    monkeypatch.setattr(subdomains, "OVERLAP", 1)
    monkeypatch.setattr(domain_decomposition, "ACCEPTED_FORCE", 0.0)
    free = free_stiffness(net.shape, loading.free)
    start = Point(loading.ahead([(0.0, loading.reference)], 0.05))
    found = list(grid_subdomains(free))
    assert not couplings(found, net.shape.unknowns).all()
    alone, shared = (
        solved_by_subdomains(System(net.shape, fabric, threads), start, free, DEFAULT)
        for threads in (ALONE, Threads(2))
    )
    np.testing.assert_array_equal(shared[0].unknowns, alone[0].unknowns)
    assert shared[1] == alone[1] > 0


def test_subdomain_solutions_lower_the_energy_and_their_cost_is_counted(
    small_subdomains, sample, monkeypatch
):
    monkeypatch.setattr(domain_decomposition, "ACCEPTED_FORCE", 0.0)
    net, fabric, loading = sample
    free = free_stiffness(net.shape, loading.free)
    system = equations(net, fabric)
    start = Point(loading.ahead([(0.0, loading.reference)], 0.05))
    solved, share = solved_by_subdomains(system, start, free, DEFAULT)
    energies = [float(system.evaluate(at).energy.total) for at in (start, solved)]
    assert energies[1] < energies[0]
    assert share > 0
    held = np.setdiff1d(np.arange(net.shape.unknowns), loading.free)
    np.testing.assert_array_equal(solved.unknowns[held], start.unknowns[held])


def test_a_sample_reaches_the_same_state_by_subdomains_and_as_a_whole(
    small_subdomains, sample, monkeypatch
):
    net, fabric, loading = sample
    rules = SearchRules(free_stiffness(net.shape, loading.free), DEFAULT, convexified=False)
    start = Point(loading.ahead([(0.0, loading.reference)], 0.01))

    def found():
        return find_equilibrium(equations(net, fabric), start, rules)

    by_subdomains = found()
    assert by_subdomains.outcome is Outcome.converged
    assert by_subdomains.residual <= DEFAULT.tolerance
    monkeypatch.setattr(subdomains, "MIN_SUBDOMAINS", 10**9)
    as_a_whole = found()
    np.testing.assert_allclose(by_subdomains.unknowns, as_a_whole.unknowns, atol=1e-5)


def test_the_limit_of_iterations_holds_for_subdomains_too(small_subdomains, sample):
    net, fabric, loading = sample
    start = Point(loading.ahead([(0.0, loading.reference)], 0.2))
    few = replace(DEFAULT, max_iterations=5)
    state = find_equilibrium(equations(net, fabric), start, slow(sample, 0.1, few))
    assert state.outcome is Outcome.iteration_limit
    assert state.iterations >= 5


def test_periodic_fabric_and_small_samples_have_no_subdomains():
    assert not worth_dividing(checkered(4, 6, PERIODIC)[0].shape)
    assert not worth_dividing(checkered(4, 2, CLAMPED, unit_cells=(3, 3))[0].shape)
    assert worth_dividing(checkered(4, 2, CLAMPED, unit_cells=(5, 3))[0].shape)


def test_a_search_that_stalls_after_its_subdomains_restarts_without_them(
    small_subdomains, sample, monkeypatch
):
    net, fabric, loading = sample
    start = Point(loading.ahead([(0.0, loading.reference)], 0.1))

    def stalling(search, one_factorisation=False):
        outcome = minimise(search, one_factorisation)
        return Outcome.stalled if one_factorisation else outcome

    monkeypatch.setattr(equilibrium, "minimise", stalling)
    system = equations(net, fabric)
    state = find_equilibrium(system, start, slow(sample), patience=None)
    assert state.outcome is Outcome.converged
    whole = whole_equilibrium(sample, start, slow(sample))
    np.testing.assert_allclose(state.unknowns, whole.unknowns, atol=1e-7)


class FoldedToNothing(SubdomainSolver):
    """Subdomains that collapse to one point, where no hinge has an angle."""

    def solve(self, system, at, *args):
        return replace(at, unknowns=np.zeros_like(at.unknowns)), 1.0


def test_collapsed_subdomains_are_discarded(small_subdomains, sample):
    net, fabric, loading = sample
    start, rules = Point(loading.ahead([(0.0, loading.reference)], 0.01)), slow(sample)
    system = equations(net, fabric)
    system.subdomains = FoldedToNothing(system)
    state = find_equilibrium(system, start, rules)
    assert state.outcome is Outcome.converged
    whole = whole_equilibrium(sample, start, rules)
    np.testing.assert_allclose(state.unknowns, whole.unknowns, atol=1e-7)


def extrapolated(sample, energy, passed, step_length=1e6, waiting=ROUNDS):
    """Position of a node after extrapolation from previous positions, with given energies;
    and how often subdomains are solved."""
    rules = slow(sample, step_length)
    place = rules.free.dofs[0]

    def at(where):
        unknowns = sample[2].reference.copy()
        unknowns[place] = where
        return Point(unknowns)

    def cost(there):
        stretch = np.asarray(energy(there.unknowns[place]))
        return Evaluation(Energy(stretch, np.zeros(()), np.zeros(())), sample[2].reference)

    class Known:
        """A system whose energy is known, and whose subdomains are solved already."""

        solved, fabric = 0, sample[1]

        @property
        def subdomains(self):
            return self

        def evaluate(self, there, drag=None):
            return cost(there)

        def solve(self, system, there, *_):
            self.solved += 1
            return there, 1.0

    system = Known()
    search = Search(system, at(passed[0]), rules)
    by_subdomains = SubdomainRounds(search)
    for where in [passed[0]] * waiting + list(passed):
        search.move(at(where), cost(at(where)))
        by_subdomains.extrapolate()
    assert by_subdomains.cost == system.solved
    return search.at.unknowns[place], system.solved


def test_extrapolation_steps_grow_while_the_energy_falls(sample):
    # Each step is twice as long as the previous one: to 4, 8, 16, and to 32, where energy rises.
    assert extrapolated(sample, lambda x: abs(x - 20.0), (0.0, 1.0, 2.0)) == (16.0, 4)


@given(st.lists(st.floats(-3, 3), min_size=3, max_size=6), st.integers(0, 2**32 - 1))
def test_an_extrapolation_never_raises_the_energy(sample, passed, seed):
    waves = np.random.default_rng(seed).normal(size=(2, 5))

    def energy(x):
        return x**2 + 5 * float(waves[0] @ np.sin(waves[1] * x))

    where, _ = extrapolated(sample, energy, passed)
    assert energy(where) <= energy(passed[-1])
