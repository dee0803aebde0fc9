"""One search for an equilibrium: minimisation of the energy by quasi-Newton steps.

Folds move far while the yarn hardly stretches: the energy is a narrow curved valley, in which a
long straight Newton step rises. So one factorisation of K + μ I, which costs about ten gradients,
is the initial inverse Hessian of many L-BFGS steps (Nocedal and Wright, Numerical Optimization,
Alg. 7.4). It is repeated when a step gains less than the average since the last one, its cost
included, and does not halve the force either.
"""

from collections import deque
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.linalg.blas import daxpy
from scipy.optimize import brentq

from knitlab.model.energy import Evaluation, Point
from knitlab.model.fabric import Configuration, Unknowns
from knitlab.model.network import UPRIGHT
from knitlab.solvers.equilibrium.drag import Drag
from knitlab.solvers.equilibrium.settings import Solver
from knitlab.solvers.equilibrium.state import Outcome, State
from knitlab.solvers.equilibrium.stiffness import FreeStiffness
from knitlab.solvers.equilibrium.system import System

NEARLY = 1e3  # force of a search that has nearly ended, over the tolerance
MIN_RAISED_SHIFT = 1e-6
MAX_SHIFT = 1e6
ENERGY_ROUND_OFF = 1e-13  # relative change of energy below which the force decides instead
MAX_WALL_CHANGES = 50  # nodes that come to a wall or leave it, above which an update costs too much
MAX_ACTIVE_SETS = 10

Vector = Float[np.ndarray, " free"]


@dataclass(frozen=True, eq=False)
class SearchRules:
    """Rules of a search."""

    free: FreeStiffness
    settings: Solver
    floor: float = -np.inf  # stop below it: the state sought has more energy [N mm]
    convexified: bool = True  # rather than raise μ
    exact: bool = False  # double precision from the start
    drag: Drag | None = None


class Search:
    """Current configuration of a search, its energy and forces, and the cost so far.

    ``step_length`` is the longest change of the vector between neighbouring nodes in a step [mm],
    ``limit`` the number of iterations at which the search ends, and ``shift`` μ [N/mm].
    """

    def __init__(self, system: System, at: Point, rules: SearchRules) -> None:
        self.system = system
        self.rules = rules
        self.dofs = rules.free.dofs
        fabric = system.fabric
        settings = rules.settings
        self.step_length = settings.step_limit * float(fabric.cell_sides.min())
        self.z_max = float(fabric.z_max)
        self._k_wall = float(fabric.k_wall)
        self.limit = settings.max_iterations
        self.exact = rules.exact
        self.iterations = self.factorisations = 0
        self.begin(at, system.evaluate(at, rules.drag))

    def begin(self, at: Point, evaluation: Evaluation) -> None:
        """Start, or restart, from a configuration; the cost so far is kept."""
        self.move(at, evaluation)
        self.shift = self.steepest_shift if self.rules.convexified else 1e-4

    def move(self, at: Point, evaluation: Evaluation) -> None:
        """Continue from another configuration, given its energy and gradient."""
        self.at = at
        self.evaluation = evaluation
        self.energy = float(evaluation.energy.total)
        self.gradient: Vector = np.asarray(evaluation.gradient)[self.dofs]
        self.force = float(np.abs(self.gradient).max())

    def end(self) -> Outcome | None:
        """The outcome if the search ends at the current configuration, else None."""
        if self.force <= self.rules.settings.tolerance:
            return Outcome.converged
        if self.energy < self.rules.floor:
            return Outcome.left_branch
        if self.iterations >= self.limit:
            return Outcome.iteration_limit
        return None if np.isfinite(self.force) else Outcome.stalled

    @property
    def nearly_ended(self) -> bool:
        """Whether so little force is left that the stiffness must be positive definite."""
        return self.force <= min(NEARLY * self.rules.settings.tolerance, 1e-3)

    @property
    def steepest_shift(self) -> float:
        """μ with which the largest force moves a node by the step limit [N/mm]."""
        return self.force / self.step_length

    @property
    def heights(self) -> Vector:
        """Heights of the free nodes [mm]."""
        return self.at.unknowns[self.dofs[self.rules.free.heights]]

    @property
    def wall_stiffness(self) -> float:
        """Stiffness of the walls at the current stage [N/mm]."""
        return self._k_wall * float(self.at.stage.wall)

    def whole_step(self, step: Vector) -> Unknowns:
        """A step of all unknowns, which the held ones do not take."""
        whole = np.zeros(self.rules.free.shape.unknowns)
        whole[self.dofs] = step
        return whole

    def longest_fraction(self, step: Vector) -> float:
        """The fraction of a step with the largest allowed relative motion of neighbouring nodes."""
        shape = self.rules.free.shape
        move = Configuration.of(self.whole_step(step), shape)
        nodes = np.asarray(move.positions)
        lengths = np.asarray(move.lengths)
        changes = [np.diff(nodes, axis=0), np.diff(nodes, axis=1)]
        if shape.spans is not None:
            # Nodes without fabric stay.
            there = shape.nodes_of_fabric
            changes[0][~(there[1:] & there[:-1])] = 0.0
            changes[1][~(there[:, 1:] & there[:, :-1])] = 0.0
        if shape.periodic:
            by_shear = lengths[2] if len(lengths) > 2 else 0.0
            images = np.array([[lengths[0], by_shear], [0.0, lengths[1]], [0.0, 0.0]])
            courses, wales = (images @ np.array(shape.frame or UPRIGHT)).T
            changes.append(nodes[0] - nodes[-1] + wales)
            changes.append(nodes[:, 0] - nodes[:, -1] + courses)
        longest = max(np.einsum("...c,...c->...", change, change).max() for change in changes)
        return self.step_length / max(float(longest), np.finfo(float).tiny) ** 0.5

    def state(self, outcome: Outcome) -> State:
        """The current state."""
        energy = self.evaluation.energy
        gradient = np.asarray(self.evaluation.gradient)
        shape = self.rules.free.shape
        cost = (self.iterations, self.factorisations)
        return State(shape, self.at.unknowns, energy, gradient, outcome, self.force, *cost)


def minimise(search: Search, one_factorisation: bool = False) -> Outcome:
    """Minimise the energy over the free unknowns until the forces on them vanish.

    Every step lowers the energy. If K + μ I is not positive definite, it is either convexified,
    which takes large steps, or μ is raised, which stays in the valley of the initial configuration
    as a slow motion would. μ decreases while steps succeed; in the end convergence is that of
    Newton's method.

    Factorisations that fail, or allow no step that lowers the energy, are repeated with another μ;
    near the end first in double precision. With ``one_factorisation`` the search ends, as at its
    limit of iterations, when that is no longer useful.
    """
    rules = search.rules
    system = search.system
    smallest = rules.settings.smallest_shift
    while (outcome := search.end()) is None:
        system.assemble(search.at, rules.free)
        drag = 0.0 if rules.drag is None else rules.drag.stiffness
        raised = False
        while True:
            search.factorisations += 1
            if system.factorise(search.shift + drag, rules.convexified, search.exact):
                break
            if search.nearly_ended and not search.exact:
                search.exact = True
                continue
            search.shift = max(10 * search.shift, MIN_RAISED_SHIFT)
            raised = True
            if search.shift > MAX_SHIFT:
                return Outcome.stalled
        descent = _descend(search)
        if not (descent.steps or search.exact) and (search.nearly_ended or descent.below_round_off):
            search.exact = True
            continue
        if descent.below_round_off and not descent.steps and search.shift <= smallest:
            return Outcome.stalled
        if descent.shortened:
            longest = max(search.steepest_shift, search.shift)
            search.shift = min(max(10 * search.shift, MIN_RAISED_SHIFT), longest)
        elif descent.below_round_off or not (descent.blocked or raised):
            search.shift = max(0.1 * search.shift, smallest)
        elif not descent.steps:
            search.shift = max(10 * search.shift, MIN_RAISED_SHIFT)
        elif descent.blocked:
            search.shift *= 2
        if search.shift > MAX_SHIFT:
            return Outcome.stalled
        if descent.steps and one_factorisation and search.end() is None:
            return Outcome.iteration_limit
    return outcome


@dataclass(frozen=True)
class _Descent:
    """Result of the quasi-Newton steps with one factorisation.

    It was ``blocked`` if no fraction of the next step lowered the energy, and ``below_round_off``
    if the expected decrease was: then the shift is too large for the force to fall. It was
    ``shortened`` if the step limit left only a small fraction of most steps of a convexified
    stiffness, so that only its softest modes moved: then μ is too small.
    """

    steps: int
    blocked: bool = False
    below_round_off: bool = False
    shortened: bool = False


def _descend(search: Search) -> _Descent:
    rules = search.rules
    # Cost of a factorisation in steps, most steps with one, which the L-BFGS memory holds, and
    # consecutive poor steps after which the stiffness is factorised again. If μ is raised, a
    # factorisation costs twice as much, as several attempts may fail first.
    cost, most_steps, patience = (8, 30, 2) if rules.convexified else (16, 60, 3)
    memory: deque[tuple[Vector, Vector, float]] = deque(maxlen=most_steps)
    highest = search.energy
    steps = 0
    poor = 0
    shortened = 0
    while steps < most_steps and search.iterations < search.limit:
        if steps:
            direction = _direction(search, memory)
            curvature = -float(search.gradient @ direction)
        else:
            direction, curvature = step_between_walls(search)
        slope = float(search.gradient @ direction)
        if not slope < 0:
            return _Descent(steps, blocked=True)
        fraction = min(1.0, search.longest_fraction(direction))
        shortened += fraction < 0.1
        free = 1.0
        if search.system.contact is not None:
            step = search.whole_step(direction * fraction)
            free = search.system.contact.free_fraction(search.at.unknowns, step)
        fraction *= free
        before = search.energy, search.gradient, search.force
        step = direction * fraction
        slope = slope * fraction
        curvature = curvature * fraction**2
        walls = search.z_max, search.wall_stiffness
        rise = step[rules.free.heights]
        length = lowest_fraction(search.heights, rise, slope, curvature, *walls)
        length = _line_search(search, step, slope, length)
        if not length:
            noise = ENERGY_ROUND_OFF * abs(search.energy)
            return _Descent(steps, blocked=True, below_round_off=-slope < noise)
        steps += 1
        # Contact that has come within reach is in the forces, but not in the factorisation.
        if search.end() is not None or free < 1:
            break
        step = step * length
        change = search.gradient - before[1]
        curvature = float(step @ change)
        if curvature > 1e-8 * np.sqrt((step @ step) * (change @ change)):
            memory.append((step, change, curvature))
        total = highest - search.energy
        is_poor = search.force > 0.5 * before[2]
        if total > 1e-10 * abs(search.energy):  # else the energy gained is round-off
            is_poor &= before[0] - search.energy < total / (cost + steps)
        poor = poor + 1 if is_poor else 0
        if poor == patience:
            break
    return _Descent(steps, shortened=rules.convexified and shortened > steps / 2)


def _direction(search: Search, memory: deque[tuple[Vector, Vector, float]]) -> Vector:
    """The L-BFGS direction, with the factorised stiffness as the initial Hessian."""
    direction = -search.gradient
    weights = list[float]()
    for step, change, curvature in reversed(memory):
        weights.append(float(step @ direction) / curvature)
        direction = daxpy(change, direction, a=-weights[-1])
    direction = search.system.solve(direction)
    for (step, change, curvature), weight in zip(memory, reversed(weights), strict=True):
        direction = daxpy(step, direction, a=weight - float(change @ direction) / curvature)
    return direction


def _line_search(search: Search, step: Vector, slope: float, length: float) -> float:
    """Move by the fraction of a step, at most ``length``, that lowers the energy; 0 if none."""
    energy = search.energy
    force = search.force
    noise = ENERGY_ROUND_OFF * abs(energy)
    for _ in range(5):
        unknowns = search.at.unknowns.copy()
        unknowns[search.dofs] += length * step
        trial = replace(search.at, unknowns=unknowns)
        evaluation = search.system.evaluate(trial, search.rules.drag)
        search.iterations += 1
        trial_energy = float(evaluation.energy.total)
        trial_force = float(np.abs(np.asarray(evaluation.gradient)[search.dofs]).max())
        lower = trial_energy <= energy + 1e-4 * length * slope + noise  # sufficient decrease
        if lower and (trial_energy < energy - noise or trial_force <= force):
            search.move(trial, evaluation)
            return length
        if evaluation.energy.contact:
            # The barrier rises only at the very end of a step, which no parabola describes.
            length /= 2
            continue
        excess = trial_energy - energy - length * slope
        lowest = -slope * length**2 / (2 * excess) if excess > 0 else length / 2
        length = min(max(lowest, 0.1 * length), 0.5 * length)
    return 0.0


def step_between_walls(search: Search) -> tuple[Float[np.ndarray, " free"], float]:
    """The step to the minimum between the walls [mm], and the curvature of the energy along it.

    In a Newton step the energy with walls is piecewise quadratic. Its minimum is found by active
    sets: nodes that the step would bring to a wall are added to the factorised stiffness, those
    that it would take off one are removed, by a low-rank update. If many nodes change, or the
    active sets do not settle, it is the Newton step with the walls touched now.
    """
    system = search.system
    z_max = search.z_max
    heights = search.rules.free.heights
    z = search.heights
    gradient = search.gradient
    stiffness = search.wall_stiffness
    touching = active = np.abs(z) > z_max
    step = newton = system.solve(-gradient)
    curvature = newton_curvature = -float(gradient @ newton)
    for _ in range(MAX_ACTIVE_SETS):
        end = z + min(1.0, search.longest_fraction(step)) * step[heights]
        active_after = np.abs(end) > z_max
        if (active_after == active).all():
            return step, curvature
        active = active_after
        changed = np.flatnonzero(active != touching)
        dofs = heights[changed]
        change = np.where(active[changed], stiffness, -stiffness)
        few = len(changed) <= MAX_WALL_CHANGES
        if not (few and system.change_diagonal(dofs, change)):
            break
        # An added wall pushes from z_max on rather than from z, and a removed one no longer.
        wall = np.copysign(z_max, np.where(active, end, z)[changed])
        modified = gradient.copy()
        modified[dofs] += change * (z[changed] - wall)
        step = system.solve(-modified)
        curvature = -float(modified @ step) - float(change @ step[dofs] ** 2)
    system.change_diagonal(heights[:0], np.zeros(0))
    return newton, newton_curvature


def lowest_fraction(
    heights: Float[np.ndarray, " node"],
    rise: Float[np.ndarray, " node"],
    slope: float,
    curvature: float,
    z_max: float,
    stiffness: float,
) -> float:
    """Fraction of a step with the least energy between the walls, at most 1.

    The quadratic model, with a negative ``slope`` and a ``curvature`` [N mm], holds until further
    nodes touch a wall; the wall penalty, known exactly, replaces its part of the model.
    """
    touching = np.maximum(np.abs(heights), np.abs(heights + rise)) > z_max
    z = heights[touching]
    dz = rise[touching]

    def pushed(fraction: float) -> float:
        height = z + fraction * dz
        return stiffness * float((height - np.clip(height, -z_max, z_max)) @ dz)

    now = np.abs(z) > z_max
    first = pushed(0.0)
    second = stiffness * float(dz[now] @ dz[now])

    def derivative(fraction: float) -> float:
        return slope + fraction * (curvature - second) + pushed(fraction) - first

    if derivative(1.0) <= 0:
        return 1.0
    return float(brentq(derivative, 0.0, 1.0, xtol=1e-12, rtol=1e-3))
