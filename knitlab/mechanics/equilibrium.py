"""Equilibrium: downhill by quasi-Newton steps, with a fresh factorisation when it pays.

A fold moves far while its yarn hardly stretches, so that the energy is a narrow curved valley
and a Newton step, straight as it is, soon climbs its side. A factorisation costs some ten
gradients and solves. So one factorisation of K + μ I serves as the first guess of many
L-BFGS steps (Nocedal and Wright, Numerical Optimization, Alg. 7.4), which learn how the valley
bends, and is made anew as soon as a step gains less than the steps since then have on average,
its cost included, and does not halve the force either, as near rest it well may.
"""

from collections import deque
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.linalg.blas import daxpy

from knitlab.mechanics.equilibrium_search import Search, SearchRules
from knitlab.mechanics.evaluation import Evaluation
from knitlab.mechanics.solver import Assemble, Evaluate, Factorise, Solve, Solver
from knitlab.mechanics.state import Outcome, State

LEAST_RAISED_SHIFT = 1e-6
LARGEST_SHIFT = 1e6


@dataclass(frozen=True)
class RefactorisationPolicy:
    """When a search makes a new factorisation.

    Attributes:
        cost: quasi-Newton steps that cost as much as a new one.
        most_steps: quasi-Newton steps on one, and how many of them are remembered.
        patience: poor steps in a row after which the stiffness is factorised again.
    """

    cost: int
    most_steps: int
    patience: int


CONVEXIFIED = RefactorisationPolicy(cost=8, most_steps=30, patience=2)
RAISED = RefactorisationPolicy(cost=16, most_steps=60, patience=3)
"""Where μ is raised, a factorisation is as good as two: often some fail before one does not."""
BACKTRACKS = 5
SUFFICIENT_DECREASE = 1e-4
LEAST_CURVATURE = 1e-8
# Below this relative change the energy is round-off and the force decides instead.
ENERGY_ROUND_OFF = 1e-13
PROGRESS_ROUND_OFF = 1e-10

Vector = Float[np.ndarray, " free"]


def find_equilibrium(start: Evaluate, rules: SearchRules) -> Solver[State]:
    """Move the free unknowns downhill to a state where no force is left on them.

    Every step goes downhill, so that the fabric is followed through snaps towards a minimum
    nearby. Where K + μ I is not positive definite, either it is convexified, which is quick and
    goes far, or μ is raised until it is, which keeps to the valley that the start lies in as a
    slow motion would. μ falls while steps succeed; where it vanishes and the forces are small,
    convergence is Newton's. The state that is returned is
    tested for its force alone: a path that runs straight into a saddle would end there.

    Args:
        start: configuration to start from, and the stage; its held unknowns stay.
        rules: that the search keeps to.
    """
    search = Search(start, (yield start), rules)
    return search.state((yield from minimise(search)))


def minimise(search: Search) -> Solver[Outcome]:
    """Take a search to its end, factorisation by factorisation."""
    while True:
        outcome = yield from minimise_with_one_factorisation(search)
        if outcome is not None:
            return outcome


def minimise_with_one_factorisation(search: Search) -> Solver[Outcome | None]:
    """Take a search as far as it pays to go on one factorisation.

    Factorisations that fail, or from which no step leads down, are followed by others.

    Returns:
        How the search ended; ``None`` if it goes on.
    """
    rules, smallest = search.rules, search.rules.settings.smallest_shift
    while (outcome := search.end()) is None:
        yield Assemble(search.at.unknowns, rules.free, search.at.stage)
        raised = False
        while True:
            search.factorisations += 1
            if (yield Factorise(search.shift, rules.convexified)):
                break
            search.shift, raised = max(10 * search.shift, LEAST_RAISED_SHIFT), True
            if search.shift > LARGEST_SHIFT:
                return Outcome.stalled
        descent = yield from _descend(search)
        if descent.below_round_off and not descent.steps and search.shift <= smallest:
            return Outcome.stalled
        if descent.below_round_off or not (descent.blocked or raised):
            search.shift = max(0.1 * search.shift, smallest)
        elif not descent.steps:
            search.shift = max(10 * search.shift, LEAST_RAISED_SHIFT)
        elif descent.blocked:
            search.shift *= 2
        if search.shift > LARGEST_SHIFT:
            return Outcome.stalled
        if descent.steps:
            return search.end()
    return outcome


@dataclass(frozen=True)
class _Descent:
    """What came of one factorisation.

    Attributes:
        steps: quasi-Newton steps taken.
        blocked: whether no part of the next step helped.
        below_round_off: whether it did not because round-off hid it; then not the step is too
            long, but the shift too large for the force to fall at once.
    """

    steps: int
    blocked: bool = False
    below_round_off: bool = False


def _descend(search: Search) -> Solver[_Descent]:
    """Quasi-Newton steps on one factorisation."""
    rules = search.rules
    policy = CONVEXIFIED if rules.convexified else RAISED
    memory: deque[tuple[Vector, Vector, float]] = deque(maxlen=policy.most_steps)
    highest, steps, poor = search.energy, 0, 0
    while steps < policy.most_steps and search.iterations < rules.settings.max_iterations:
        direction = yield from _direction(search.gradient, memory)
        slope = float(search.gradient @ direction)
        if not slope < 0:
            return _Descent(steps, blocked=True)
        shortening = min(1.0, rules.longest_part(direction))
        before = search.energy, search.gradient, search.force
        length = yield from _line_search(search, direction * shortening, slope * shortening)
        if not length:
            noise = ENERGY_ROUND_OFF * abs(search.energy)
            return _Descent(steps, blocked=True, below_round_off=-slope * shortening < noise)
        steps += 1
        if search.end() is not None:
            break
        step, change = direction * (shortening * length), search.gradient - before[1]
        curvature = float(step @ change)
        if curvature > LEAST_CURVATURE * np.sqrt((step @ step) * (change @ change)):
            memory.append((step, change, curvature))
        total, is_poor = highest - search.energy, search.force > 0.5 * before[2]
        if total > PROGRESS_ROUND_OFF * abs(search.energy):
            is_poor &= before[0] - search.energy < total / (policy.cost + steps)
        poor = poor + 1 if is_poor else 0
        if poor == policy.patience:
            break
    return _Descent(steps)


def _direction(gradient: Vector, memory: deque[tuple[Vector, Vector, float]]) -> Solver[Vector]:
    """The L-BFGS direction, with the factorised stiffness as its first guess."""
    direction, weights = -gradient, list[float]()
    for step, change, curvature in reversed(memory):
        weights.append(float(step @ direction) / curvature)
        direction = daxpy(change, direction, a=-weights[-1])
    direction = yield Solve(direction)
    for (step, change, curvature), weight in zip(memory, reversed(weights), strict=True):
        direction = daxpy(step, direction, a=weight - float(change @ direction) / curvature)
    return direction


def _line_search(search: Search, step: Vector, slope: float) -> Solver[float]:
    """Move by as much of a step as lowers the energy enough; 0 if nothing does."""
    length, energy, force = 1.0, search.energy, search.force
    noise = ENERGY_ROUND_OFF * abs(energy)
    for _ in range(BACKTRACKS):
        unknowns = search.at.unknowns.copy()
        unknowns[search.places] += length * step
        trial = replace(search.at, unknowns=unknowns)
        then: Evaluation = yield trial
        search.iterations += 1
        there = float(then.energy.total)
        calmer = float(np.abs(np.asarray(then.gradient)[search.places]).max()) <= force
        lower = there <= energy + SUFFICIENT_DECREASE * length * slope + noise
        if lower and (there < energy - noise or calmer):
            search.move(trial, then)
            return length
        excess = there - energy - length * slope
        lowest = -slope * length**2 / (2 * excess) if excess > 0 else length / 2
        length = min(max(lowest, 0.1 * length), 0.5 * length)
    return 0.0
