"""Blocks of a large sample: that each is a true piece of it, and that the whole comes to rest."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from knitlab.linalg.threads import ALONE, Threads
from knitlab.mechanics import domain_decomposition, executor, subdomains
from knitlab.mechanics.batch import run_in_lockstep
from knitlab.mechanics.domain_decomposition import (
    LONGEST_SLIDE,
    SubdomainSolution,
    find_equilibrium_by_subdomains,
    subdomain_settings,
)
from knitlab.mechanics.element_chunks import ChunkedFabric
from knitlab.mechanics.equilibrium import (
    BACKTRACKS,
    find_equilibrium,
    minimise_with_one_factorisation,
)
from knitlab.mechanics.equilibrium_search import Search, SearchRules
from knitlab.mechanics.evaluation import WHOLE, Evaluation
from knitlab.mechanics.executor import Executor, run, run_to_end
from knitlab.mechanics.loading import all_free, free_under_tension
from knitlab.mechanics.solver import Evaluate, Factorise, SolveSubdomains
from knitlab.mechanics.state import Outcome, State
from knitlab.mechanics.stiffness import free_stiffness
from knitlab.mechanics.subdomains import blocks, meet, rounds, worth_dividing
from knitlab.model.energy import Energy
from tests.fabrics import CLAMPED, DEFAULT, PERIODIC, checkered


def slow(sample, step_length=0.3, settings=DEFAULT) -> SearchRules:
    """Rules to pull the sample by, as tension does."""
    net, _, loading = sample
    free = free_stiffness(net.shape, loading.free)
    return SearchRules(free, step_length, settings, convexified=False)


@pytest.mark.parametrize("places", [all_free, free_under_tension])
def test_a_block_feels_the_forces_of_the_whole(small_blocks, sample, places):
    net, fabric, loading = sample
    random = np.random.default_rng(0)
    at = loading.reference + 0.1 * random.normal(size=net.shape.unknowns)
    whole = ChunkedFabric.of(net.shape, fabric).evaluate(WHOLE, at)
    free = free_stiffness(net.shape, places(net.shape))
    found = list(blocks(free))
    assert len(found) == 4
    for block in found:
        own = ChunkedFabric.of(block.free.shape, block.fabric(fabric))
        gradient = np.asarray(own.evaluate(WHOLE, at[block.places]).gradient)
        movable = block.free.places
        np.testing.assert_allclose(
            gradient[movable], np.asarray(whole.gradient)[block.places[movable]], atol=1e-10
        )


def test_a_move_within_a_block_costs_it_what_it_costs_the_whole(small_blocks, sample):
    net, fabric, loading = sample
    block = list(blocks(free_stiffness(net.shape, loading.free)))[1]
    whole = ChunkedFabric.of(net.shape, fabric)
    own = ChunkedFabric.of(block.free.shape, block.fabric(fabric))
    before = loading.reference
    after = before.copy()
    movable = block.places[block.free.places]
    after[movable] += 0.05 * np.random.default_rng(1).normal(size=movable.size)
    costs = [
        float(of.evaluate(WHOLE, after[where]).energy.total)
        - float(of.evaluate(WHOLE, before[where]).energy.total)
        for of, where in ((whole, slice(None)), (own, block.places))
    ]
    assert costs[0] == pytest.approx(costs[1], rel=1e-9)
    assert costs[0] > 0


def test_blocks_leave_no_free_unknown_out_and_move_no_held_one(small_blocks, sample):
    net, _, loading = sample
    free = free_stiffness(net.shape, loading.free)
    moved = np.unique(np.concatenate([b.places[b.free.places] for b in blocks(free)]))
    np.testing.assert_array_equal(moved, loading.free)


def test_blocks_meet_where_one_moves_what_the_other_feels(small_blocks, sample):
    net, _, loading = sample
    found = list(blocks(free_stiffness(net.shape, loading.free)))
    moves = [set(block.places[block.free.places].tolist()) for block in found]
    feels = [set(block.places.tolist()) for block in found]
    expected = [
        [bool(moves[i] & feels[j] or moves[j] & feels[i]) for j in range(len(found))]
        for i in range(len(found))
    ]
    np.testing.assert_array_equal(meet(found, net.shape.unknowns), expected)


@given(st.integers(1, 12), st.integers(0, 2**32 - 1), st.floats(0, 1))
def test_rounds_hold_every_block_once_and_none_that_meet(count, seed, density):
    random = np.random.default_rng(seed)
    meeting = random.random((count, count)) < density
    meeting = meeting | meeting.T | np.eye(count, dtype=bool)
    forces = random.random(count)
    found = list(rounds(forces, meeting))
    assert sorted(block for together in found for block in together) == [*range(count)]
    for place, together in enumerate(found):
        assert meeting[np.ix_(together, together)].sum() == len(together)
        waiting = [block for later in found[place:] for block in later]
        assert forces[together[0]] == forces[waiting].max()


@pytest.mark.slow
def test_two_threads_settle_blocks_as_one_does(small_blocks, sample, monkeypatch):
    net, fabric, loading = sample
    # Smaller blocks yet, of which some do not meet.
    monkeypatch.setattr(subdomains, "CELLS", 4)
    monkeypatch.setattr(subdomains, "OVERLAP", 1)
    free = free_stiffness(net.shape, loading.free)
    start = Evaluate(loading.ahead([(0.0, loading.reference)], 0.05))
    request = SolveSubdomains(start, free, 0.3, subdomain_settings(DEFAULT))
    found = list(blocks(free))
    assert not meet(found, net.shape.unknowns).all()
    alone, shared = (
        Executor(net.shape, fabric, threads=threads).answer(request)
        for threads in (ALONE, Threads(2))
    )
    np.testing.assert_array_equal(shared[0].unknowns, alone[0].unknowns)
    assert shared[1] == alone[1] > 0


def test_settling_lowers_the_energy_and_counts_what_it_cost(small_blocks, sample):
    net, fabric, loading = sample
    free = free_stiffness(net.shape, loading.free)
    executor = Executor(net.shape, fabric)
    start = Evaluate(loading.ahead([(0.0, loading.reference)], 0.05))
    settings = subdomain_settings(DEFAULT)
    longest = DEFAULT.step_limit * float(fabric.cell.min())
    settled, share = executor.answer(SolveSubdomains(start, free, longest, settings))
    energies = [float(executor.answer(at).energy.total) for at in (start, settled)]
    assert energies[1] < energies[0]
    assert share > 0
    held = loading.held
    np.testing.assert_array_equal(settled.unknowns[held], start.unknowns[held])


def test_a_sample_comes_to_the_same_rest_by_blocks_and_as_a_whole(
    small_blocks, sample, monkeypatch
):
    net, fabric, loading = sample
    rules = SearchRules.of(net.shape, loading.free, fabric, DEFAULT, convexified=False)
    start = Evaluate(loading.ahead([(0.0, loading.reference)], 0.01))

    def found():
        return run(net.shape, fabric, find_equilibrium_by_subdomains(start, rules))

    by_blocks = found()
    assert by_blocks.outcome is Outcome.converged
    assert by_blocks.residual <= DEFAULT.tolerance
    monkeypatch.setattr(subdomains, "FEWEST", 10**9)
    as_a_whole = found()
    np.testing.assert_allclose(by_blocks.unknowns, as_a_whole.unknowns, atol=1e-5)


@pytest.mark.slow
def test_in_a_batch_on_the_device_blocks_stay_and_the_whole_comes_to_rest(small_blocks, sample):
    net, fabric, loading = sample
    start = Evaluate(loading.ahead([(0.0, loading.reference)], 0.01))
    (state,) = run_in_lockstep(
        net.shape, [fabric], [find_equilibrium_by_subdomains(start, slow(sample))]
    )
    assert state.outcome is Outcome.converged


def test_the_limit_of_iterations_holds_for_blocks_too(small_blocks, sample):
    net, fabric, loading = sample
    start = Evaluate(loading.ahead([(0.0, loading.reference)], 0.2))
    hasty = replace(DEFAULT, max_iterations=5)
    state = run(net.shape, fabric, find_equilibrium_by_subdomains(start, slow(sample, 0.1, hasty)))
    assert state.outcome is Outcome.iteration_limit
    assert state.iterations >= 5


def test_endless_fabric_and_small_samples_have_no_blocks():
    assert not worth_dividing(checkered(4, 6, PERIODIC)[0].shape)
    assert not worth_dividing(checkered(4, 2, CLAMPED, unit_cells=(3, 3))[0].shape)
    assert worth_dividing(checkered(4, 2, CLAMPED, unit_cells=(5, 3))[0].shape)


def test_where_a_search_stalls_after_its_blocks_the_whole_begins_anew_without_them(
    small_blocks, sample, monkeypatch
):
    net, fabric, loading = sample
    start = Evaluate(loading.ahead([(0.0, loading.reference)], 0.1))

    def stalling(search):
        yield from minimise_with_one_factorisation(search)
        return Outcome.stalled

    monkeypatch.setattr(domain_decomposition, "minimise_with_one_factorisation", stalling)
    solver = find_equilibrium_by_subdomains(start, slow(sample), patience=None)
    state = run(net.shape, fabric, solver)
    assert state.outcome is Outcome.converged
    whole = run(net.shape, fabric, find_equilibrium(start, slow(sample)))
    np.testing.assert_allclose(state.configuration, whole.configuration, atol=1e-7)


class Counting(Executor):
    """A desk that counts what it is asked for."""

    def answer(self, request):
        self.counts[type(request)] += 1
        return super().answer(request)


@pytest.mark.slow
@pytest.mark.parametrize("patience", [None, 3])
def test_what_all_rounds_cost_is_counted(small_blocks, sample, patience):
    net, fabric, loading = sample
    start = Evaluate(loading.ahead([(0.0, loading.reference)], 0.1))
    executor = Counting(net.shape, fabric)
    executor.counts = Counter()
    solver = find_equilibrium_by_subdomains(start, slow(sample), patience=patience)
    state = run_to_end(executor, solver)
    assert state.converged
    assert executor.counts[SolveSubdomains] > 1
    assert state.factorisations == executor.counts[Factorise] > 1


class Noting(Executor):
    """A desk that notes how often the whole was evaluated before its blocks settled."""

    def answer(self, request):
        if isinstance(request, SolveSubdomains):
            self.evaluated.append(0)
        elif isinstance(request, Evaluate):
            self.evaluated[-1] += 1
        return super().answer(request)


@pytest.mark.slow
def test_blocks_settle_again_when_patience_is_at_its_end(small_blocks, sample):
    net, fabric, loading = sample
    start = Evaluate(loading.ahead([(0.0, loading.reference)], 0.1))

    def longest_round(patience):
        executor = Noting(net.shape, fabric)
        executor.evaluated = [0]
        solver = find_equilibrium_by_subdomains(start, slow(sample), patience=patience)
        assert run_to_end(executor, solver).converged
        return max(executor.evaluated)

    # What they settled to is looked at once; the last step may be tried at several lengths.
    assert longest_round(3) <= 3 + BACKTRACKS
    assert longest_round(None) > 3 + BACKTRACKS


class FoldedToNothing(Executor):
    """A desk whose blocks come to a sheet in one point, where no hinge has an angle."""

    def answer(self, request):
        if isinstance(request, SolveSubdomains):
            nowhere = np.zeros_like(request.at.unknowns)
            return replace(request.at, unknowns=nowhere), 1.0
        return super().answer(request)


def test_where_blocks_fold_a_cell_to_nothing_the_whole_goes_on_without_them(small_blocks, sample):
    net, fabric, loading = sample
    start = Evaluate(loading.ahead([(0.0, loading.reference)], 0.01))
    solver = find_equilibrium_by_subdomains(start, slow(sample))
    state = run_to_end(FoldedToNothing(net.shape, fabric), solver)
    assert state.outcome is Outcome.converged
    whole = run(net.shape, fabric, find_equilibrium(start, slow(sample)))
    np.testing.assert_allclose(state.unknowns, whole.unknowns, atol=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("outcome", "residual"), [(Outcome.stalled, 1e-3), (Outcome.iteration_limit, 1e5)]
)
def test_a_block_that_comes_to_no_rest_stays_where_it_was(
    small_blocks, sample, monkeypatch, outcome, residual
):
    net, fabric, loading = sample
    free = free_stiffness(net.shape, loading.free)
    start = Evaluate(loading.ahead([(0.0, loading.reference)], 0.05))

    def stalling(at, *_, **__):
        evaluation = yield at
        nowhere = np.zeros_like(at.unknowns)
        return State(
            rules.free.shape, nowhere, evaluation.energy, evaluation.gradient, outcome, residual, 7
        )

    monkeypatch.setattr(executor, "find_equilibrium", stalling)
    request = SolveSubdomains(start, free, 0.3, subdomain_settings(DEFAULT))
    settled, share = Executor(net.shape, fabric).answer(request)
    np.testing.assert_array_equal(settled.unknowns, start.unknowns)
    assert share > 0


def slid(sample, energy, passed, step_length=1e6, waiting=domain_decomposition.ROUNDS):
    """Where a node comes to that passed some places, at an energy of its own, and may then slide;
    and how often blocks settled."""
    rules = slow(sample, step_length)
    place, settled = rules.free.places[0], 0

    def at(where):
        configuration = sample[2].reference.copy()
        configuration[place] = where
        return Evaluate(configuration)

    def cost(there):
        stretch = np.asarray(energy(there.unknowns[place]))
        return Evaluation(Energy(stretch, np.zeros(()), np.zeros(())), sample[2].reference)

    search = Search(at(passed[0]), cost(at(passed[0])), rules)
    by_blocks = SubdomainSolution(search)
    for where in [passed[0]] * waiting + list(passed):
        search.move(at(where), cost(at(where)))
        sliding, answer = by_blocks.slide(), None
        while True:
            try:
                request = sliding.send(answer)
            except StopIteration:
                break
            settled += isinstance(request, SolveSubdomains)
            answer = (request.at, 1.0) if isinstance(request, SolveSubdomains) else cost(request)
    assert by_blocks.share == settled
    return search.at.unknowns[place], settled


def test_down_a_long_slope_slides_grow_until_one_goes_too_far(sample):
    # On by twice the way before: to 4, 8, 16, and to 32, which is up the other side.
    assert slid(sample, lambda x: abs(x - 20.0), (0.0, 1.0, 2.0)) == (16.0, 4)


def test_no_slide_is_longer_than_a_few_steps(sample):
    where, settled = slid(sample, lambda x: abs(x - 20.0), (0.0, 1.0, 2.0), step_length=0.4)
    assert where == pytest.approx(2.0 + 18 * LONGEST_SLIDE * 0.4)
    assert settled == 19


def test_slides_begin_late(sample):
    def after(rounds):
        return slid(sample, lambda x: abs(x - 20.0), np.arange(float(rounds)), waiting=0)

    assert after(domain_decomposition.ROUNDS) == (domain_decomposition.ROUNDS - 1, 0)
    assert after(domain_decomposition.ROUNDS + 1)[1] > 0


@given(st.floats(0.01, 0.25), st.floats(-5, 5))
def test_where_rounds_converge_fast_nothing_slides(sample, rate, lowest):
    passed = [lowest + rate**n for n in range(4)]
    assert slid(sample, lambda x: (x - lowest) ** 2, passed) == (passed[-1], 0)


@given(st.lists(st.floats(-3, 3), min_size=3, max_size=6), st.integers(0, 2**32 - 1))
def test_a_slide_never_raises_the_energy(sample, passed, seed):
    waves = np.random.default_rng(seed).normal(size=(2, 5))

    def energy(x):
        return x**2 + 5 * float(waves[0] @ np.sin(waves[1] * x))

    where, _ = slid(sample, energy, passed)
    assert energy(where) <= energy(passed[-1])
