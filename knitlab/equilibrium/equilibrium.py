"""Equilibrium: minimisation by quasi-Newton steps with occasional factorisations of the stiffness.

Folds move far while the yarn hardly stretches, so that the energy is a narrow curved valley, and a
long straight Newton step would raise it. A factorisation costs about ten gradients and solves. So
one factorisation of K + μ I is the initial inverse Hessian of many L-BFGS steps (Nocedal and
Wright, Numerical Optimization, Alg. 7.4), which learn the curvature of the valley. The stiffness is
refactorised when a step gains less than the average since the last factorisation, including its
cost, and does not halve the force either, as steps near the minimum may. The first step predicts
which nodes will touch the walls (:mod:`knitlab.equilibrium.wall_steps`); later ones keep these.
"""

from collections import deque
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.linalg.blas import daxpy

from knitlab.equilibrium.equilibrium_search import Search, SearchRules
from knitlab.equilibrium.state import Outcome, State
from knitlab.equilibrium.system import System
from knitlab.equilibrium.wall_steps import step_between_walls
from knitlab.fabric.energy import Point

LEAST_RAISED_SHIFT = 1e-6
LARGEST_SHIFT = 1e6


@dataclass(frozen=True)
class RefactorisationPolicy:
    """When a search refactorises the stiffness.

    Attributes:
        cost: cost of a factorisation, in quasi-Newton steps.
        most_steps: largest number of quasi-Newton steps with one factorisation, all of which the
            L-BFGS memory holds.
        patience: consecutive poor steps after which the stiffness is factorised again.
    """

    cost: int
    most_steps: int
    patience: int


CONVEXIFIED = RefactorisationPolicy(cost=8, most_steps=30, patience=2)
RAISED = RefactorisationPolicy(cost=16, most_steps=60, patience=3)
"""If μ is raised, a factorisation costs twice as much, as several attempts may fail first."""
SMALL_PART = 0.1
"""Part of a step below which μ is too small: the softest modes move as far as the step limit
allows, and all others hardly."""
BACKTRACKS = 5
SUFFICIENT_DECREASE = 1e-4
LEAST_CURVATURE = 1e-8
# Below this relative change the energy is round-off and the force decides instead.
ENERGY_ROUND_OFF = 1e-13
PROGRESS_ROUND_OFF = 1e-10

Vector = Float[np.ndarray, " free"]


def find_equilibrium(system: System, start: Point, rules: SearchRules) -> State:
    """Minimise the energy over the free unknowns until the forces on them vanish.

    Every step lowers the energy, so that the fabric is followed through snaps to a nearby minimum.
    If K + μ I is not positive definite, it is either convexified, which is fast and takes large
    steps, or μ is raised until it is, which stays in the valley of the initial configuration, as a
    slow motion would. A convexified search begins with a μ that keeps its steps near the step
    limit, as a trust region would. μ decreases while steps succeed; once it is negligible and the
    forces are small, convergence is that of Newton's method. Only the forces of the result are
    tested: a path that leads exactly into a saddle point would end there.

    Args:
        system: the equations of the fabric.
        start: configuration to start from, and the stage; its held unknowns stay fixed.
        rules: rules of the search.
    """
    search = Search(system, start, rules)
    return search.state(minimise(search))


def minimise(search: Search) -> Outcome:
    """Continue a search to its end."""
    while True:
        outcome = minimise_with_one_factorisation(search)
        if outcome is not None:
            return outcome


def minimise_with_one_factorisation(search: Search) -> Outcome | None:
    """Continue a search for as long as one factorisation is useful.

    Factorisations that fail, or allow no step that lowers the energy, are repeated with another μ;
    if the search has nearly ended, first in double precision, which it then keeps.

    Returns:
        The outcome of the search; ``None`` if it has not ended.
    """
    rules, smallest = search.rules, search.rules.settings.smallest_shift
    while (outcome := search.end()) is None:
        search.system.assemble(search.at, rules.free)
        raised = False
        while not search.factorise():
            if search.nearly_ended and not search.exact:
                search.exact = True
                continue
            search.shift, raised = max(10 * search.shift, LEAST_RAISED_SHIFT), True
            if search.shift > LARGEST_SHIFT:
                return Outcome.stalled
        descent = _descend(search)
        if not (descent.steps or search.exact) and (search.nearly_ended or descent.below_round_off):
            search.exact = True
            continue
        if descent.below_round_off and not descent.steps and search.shift <= smallest:
            return Outcome.stalled
        if descent.shortened:
            longest = max(search.steepest_shift, search.shift)
            search.shift = min(max(10 * search.shift, LEAST_RAISED_SHIFT), longest)
        elif descent.below_round_off or not (descent.blocked or raised):
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
    """Result of the steps with one factorisation.

    Attributes:
        steps: quasi-Newton steps taken.
        blocked: whether no fraction of the next step lowered the energy.
        below_round_off: whether the expected decrease was below round-off: then the step is not
            too long, but the shift is too large for the force to fall.
        shortened: whether the step limit shortened most steps of a convexified stiffness to a
            small part, so that only its softest modes moved.
    """

    steps: int
    blocked: bool = False
    below_round_off: bool = False
    shortened: bool = False


def _descend(search: Search) -> _Descent:
    """Quasi-Newton steps with one factorisation."""
    rules = search.rules
    policy = CONVEXIFIED if rules.convexified else RAISED
    memory: deque[tuple[Vector, Vector, float]] = deque(maxlen=policy.most_steps)
    highest, steps, poor, shortened = search.energy, 0, 0, 0
    while steps < policy.most_steps and search.iterations < rules.settings.max_iterations:
        if steps:
            direction = _direction(search, memory)
            curvature = -float(search.gradient @ direction)
        else:
            first = step_between_walls(search)
            direction, curvature = first.step, first.curvature
        slope = float(search.gradient @ direction)
        if not slope < 0:
            return _Descent(steps, blocked=True)
        shortening = min(1.0, rules.longest_part(direction))
        shortened += shortening < SMALL_PART
        before = search.energy, search.gradient, search.force
        free = rules.free_part(search.at.unknowns, direction * shortening)
        shortening *= free
        step, slope = direction * shortening, slope * shortening
        length = rules.lowest_part(search.at, step, slope, curvature * shortening**2)
        length = _line_search(search, step, slope, length)
        if not length:
            noise = ENERGY_ROUND_OFF * abs(search.energy)
            return _Descent(steps, blocked=True, below_round_off=-slope < noise)
        steps += 1
        # Contact that has come within reach is in the forces, but not in the factorisation.
        if search.end() is not None or free < 1:
            break
        step, change = step * length, search.gradient - before[1]
        curvature = float(step @ change)
        if curvature > LEAST_CURVATURE * np.sqrt((step @ step) * (change @ change)):
            memory.append((step, change, curvature))
        total, is_poor = highest - search.energy, search.force > 0.5 * before[2]
        if total > PROGRESS_ROUND_OFF * abs(search.energy):
            is_poor &= before[0] - search.energy < total / (policy.cost + steps)
        poor = poor + 1 if is_poor else 0
        if poor == policy.patience:
            break
    return _Descent(steps, shortened=rules.convexified and shortened > steps / 2)


def _direction(search: Search, memory: deque[tuple[Vector, Vector, float]]) -> Vector:
    """The L-BFGS direction, with the factorised stiffness as the initial Hessian."""
    direction, weights = -search.gradient, list[float]()
    for step, change, curvature in reversed(memory):
        weights.append(float(step @ direction) / curvature)
        direction = daxpy(change, direction, a=-weights[-1])
    direction = search.system.solve(direction)
    for (step, change, curvature), weight in zip(memory, reversed(weights), strict=True):
        direction = daxpy(step, direction, a=weight - float(change @ direction) / curvature)
    return direction


def _line_search(search: Search, step: Vector, slope: float, length: float) -> float:
    """Move by the fraction of a step that lowers the energy sufficiently; 0 if none does.

    ``length`` is the largest fraction that is tried.
    """
    energy, force = search.energy, search.force
    noise = ENERGY_ROUND_OFF * abs(energy)
    for _ in range(BACKTRACKS):
        unknowns = search.at.unknowns.copy()
        unknowns[search.places] += length * step
        trial = replace(search.at, unknowns=unknowns)
        evaluation = search.evaluated(trial)
        search.iterations += 1
        trial_energy = float(evaluation.energy.total)
        trial_force = float(np.abs(np.asarray(evaluation.gradient)[search.places]).max())
        lower = trial_energy <= energy + SUFFICIENT_DECREASE * length * slope + noise
        if lower and (trial_energy < energy - noise or trial_force <= force):
            search.move(trial, evaluation)
            return length
        excess = trial_energy - energy - length * slope
        lowest = -slope * length**2 / (2 * excess) if excess > 0 else length / 2
        length = min(max(lowest, 0.1 * length), 0.5 * length)
    return 0.0
