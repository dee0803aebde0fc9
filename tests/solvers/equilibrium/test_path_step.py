"""Step length along a path: targets are reached, limits kept, and drag keeps it constant."""

import itertools
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from knitlab.solvers.equilibrium.settings import Solver
from knitlab.solvers.equilibrium.strain_path import EASY, HARD, MAX_STEP, PathStep

SETTINGS = Solver(path_step=0.01)
FIRST = PathStep(SETTINGS, SETTINGS.path_step)
ITERATIONS = st.lists(st.integers(1, 60), min_size=400, max_size=400)


def walked(step: PathStep, strain: float, target: float, iterations: list[int]) -> list[float]:
    """Strains of a path whose steps all succeed after the given numbers of iterations."""
    passed = [strain]
    for taken in iterations:
        ahead = step.towards(passed[-1], target)
        step = step.after(ahead - passed[-1], taken)
        passed.append(ahead)
        if ahead == target:
            return passed
    raise AssertionError(f"{target} was not reached from {strain}: {passed[-1]}")


@given(strain=st.floats(0, 0.5), target=st.floats(0, 0.5), iterations=ITERATIONS)
def test_every_target_is_reached_in_steps_within_the_limits(strain, target, iterations):
    passed = walked(FIRST, strain, target, iterations)
    steps = [abs(after - before) for before, after in itertools.pairwise(passed)]
    assert max(steps) <= MAX_STEP * SETTINGS.path_step * (1 + 1e-6)
    assert passed == sorted(passed, reverse=target < strain)


def test_steps_grow_while_few_iterations_suffice_and_shrink_after_many():
    easy = walked(FIRST, 0.0, 0.15, [EASY] * 10)
    assert easy == pytest.approx([0.0, 0.01, 0.03, 0.07, 0.11, 0.15])
    hard = FIRST.after(0.04, HARD + 1)
    assert hard.length == pytest.approx(0.02)
    assert hard.after(0.02, HARD + 1).length == pytest.approx(0.01)
    assert hard.after(0.01, HARD + 1).length == pytest.approx(0.01)


def test_a_step_that_fails_is_halved_down_to_the_smallest_and_then_grows_again():
    step, taken = FIRST, 0.01
    while taken > step.smallest(1.0):
        step = step.after_failure(taken)
        taken = step.towards(0.0, 1.0)
    assert taken == pytest.approx(SETTINGS.smallest_step * SETTINGS.path_step, rel=0.01)
    assert step.after(taken, HARD).length == pytest.approx(2 * taken)


@given(iterations=ITERATIONS)
def test_with_drag_the_step_is_the_time_step_and_remains_constant(iterations):
    step = PathStep(replace(SETTINGS, drag=0.1), SETTINGS.path_step)
    passed = walked(step, 0.0, 0.2, iterations)
    assert len(passed) == 21
