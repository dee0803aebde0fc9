"""The path of equilibria along the applied strain, followed in steps of suitable size."""

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from knitlab.model.energy import Point, Stage, folds_from_rest
from knitlab.model.fabric import Configuration, Fabric
from knitlab.model.fold_friction import FoldFriction
from knitlab.model.network import network
from knitlab.model.settings import Friction
from knitlab.solvers.equilibrium.drag import Drag
from knitlab.solvers.equilibrium.equilibrium import find_equilibrium
from knitlab.solvers.equilibrium.search import SearchRules
from knitlab.solvers.equilibrium.settings import Solver
from knitlab.solvers.equilibrium.state import Outcome, State
from knitlab.solvers.equilibrium.stiffness import free_stiffness
from knitlab.solvers.equilibrium.subdomains import worth_dividing
from knitlab.solvers.equilibrium.system import System
from knitlab.solvers.loads.loading import Loading

EASY = 4
SMOOTH = 10
HARD = 16
"""Iterations of a step up to which the next one is twice as long, up to which the path is
extrapolated quadratically from it, and above which the next one is half as long."""
MAX_STEP = 4  # largest step along a path that is easy to follow, over ``path_step``
ROUGH = 50  # iterations of a strain step above which the path counts as rough
FRACTIONS_AHEAD = (1.0, 0.5, 0.25, 0.125, 0.0)  # of the way to the extrapolation


def intermediate_settings(settings: Solver, fabric: Fabric) -> Solver:
    """Settings for an intermediate state, solved to ``settings.waypoint_force`` only."""
    moments = np.asarray(fabric.fold_stiffness) * np.abs(fabric.rest_fold)
    near = settings.waypoint_force * float(moments.max() / fabric.cell_sides.min())
    return replace(settings, tolerance=max(settings.tolerance, near))


@dataclass(frozen=True)
class PathStep:
    """Step of strain along a path; it is extrapolated quadratically if that was ``smooth``."""

    settings: Solver
    length: float
    smooth: bool = False

    def towards(self, strain: float, target: float) -> float:
        """The next strain on the way to a target, which is reached in equal steps."""
        steps = _steps(abs(target - strain), self.length)
        return target if steps == 1 else strain + (target - strain) / steps

    def smallest(self, distance: float) -> float:
        """Step on the way over a distance that is not halved again."""
        whole = distance / _steps(distance, self.settings.path_step)
        return self.settings.smallest_step * whole * (1 + 1e-9)

    def after(self, step: float, iterations: int) -> "PathStep":
        """The step after one that stayed on the branch; with drag all are equal, as time steps."""
        length = abs(step)
        doubled = 2 * abs(step)
        if iterations > EASY:
            doubled = min(doubled, self.settings.path_step)
        longer = max(length / 2 if iterations > HARD else self.length, doubled)
        longest = self.settings.path_step * (1 if self.settings.drag else MAX_STEP)
        return replace(self, length=min(longer, longest), smooth=iterations <= SMOOTH)

    def after_failure(self, step: float) -> "PathStep":
        """The step after one that is to be repeated."""
        return replace(self, length=abs(step) / 2, smooth=False)


def _steps(distance: float, longest: float) -> int:
    return max(math.ceil(distance / longest - 1e-9), 1)


@dataclass
class StrainPath:
    """The most recent states of a test, at most three, from which the next one is found."""

    system: System
    loading: Loading
    last: list[tuple[float, State]]
    settings: Solver

    def __post_init__(self) -> None:
        self.step = PathStep(self.settings, self.settings.path_step)
        self.free = free_stiffness(self.system.shape, self.loading.free)
        self.many = worth_dividing(self.system.shape)

    def begin(self, friction: Friction) -> None:
        """Let friction act from the last state on."""
        angle = self._angle(self.last[-1][1])
        fabric = self.system.fabric
        begun = FoldFriction.begun(friction, fabric.fold_stiffness, angle)
        if begun is not None:
            self.system = self.system.with_fabric(replace(fabric, friction=begun))
            self.many = False

    def drift(self, fraction: float) -> State:
        """Let rest angles take on a fraction of the change of their folds, at constant strain."""
        strain, before = self.last[-1]
        if not fraction:
            return before
        fabric = self.system.fabric
        change = fraction * self._angle(before)
        friction = fabric.friction and replace(fabric.friction, slip=fabric.friction.slip - change)
        rest = np.asarray(fabric.rest_fold) + change
        self.system = self.system.with_fabric(replace(fabric, rest_fold=rest, friction=friction))
        start = Point(before.unknowns)
        state = self._found(start, self.settings, -math.inf, convexified=False)
        if state.converged:
            state = self._slipped(state)
            self.last = [(strain, state)]
        return state

    def _angle(self, state: State) -> Float[np.ndarray, " hinge"]:
        shape = self.system.shape
        configuration = Configuration.of(state.unknowns, shape)
        return folds_from_rest(network(shape), self.system.fabric, configuration)

    def _slipped(self, state: State) -> State:
        """The state at the end of a step, after which the friction starts from there."""
        fabric = self.system.fabric
        if fabric.friction is None:
            return state
        after = fabric.friction.slipped(self._angle(state))
        self.system = self.system.with_fabric(replace(fabric, friction=after))
        fold = self.system.evaluate(Point(state.unknowns)).energy.fold
        return replace(state, energy=replace(state.energy, fold=fold))

    def to(self, target: float) -> State:
        """Follow the path to a larger or smaller strain."""
        strains = [strain for strain, _ in self.last[-2:]]
        if len(strains) == 2 and (target - strains[1]) * (strains[1] - strains[0]) < 0:
            # After a reversal the states before it, at the same strains, are no way ahead.
            self.last = self.last[-1:]
        spent = list[State]()
        snapped = False
        smallest = self.step.smallest(abs(target - self.last[-1][0]))
        while True:
            strain = self.step.towards(self.last[-1][0], target)
            taken = strain - self.last[-1][0]
            final = abs(taken) <= smallest
            # If subdomains are solved first, walls rarely obstruct the search for the whole sample.
            rough = self.last[-1][1].iterations > ROUGH and not self.many and not self.settings.drag
            state = self._find_fast(strain) if rough else self._find_slowly(strain, final)
            followed = self._on_branch(strain, state)
            if rough and final and not followed:
                spent.append(state)
                state = self._find_slowly(strain, to_the_end=True)
                followed = self._on_branch(strain, state)
            if not state.converged and final:
                return replace(state, snapped=snapped).after(*spent)
            if followed:
                state = self._slipped(state)
                self.last = [*self.last[-2:], (strain, state)]
                self.step = self.step.after(taken, state.iterations)
            elif state.converged and final:
                state = self._slipped(state)
                snapped = True
                self.last = [(strain, state)]
                self.step = PathStep(self.settings, self.settings.path_step)
            else:
                self.step = self.step.after_failure(taken)
            if self.last[-1][0] == target:
                return replace(state, snapped=snapped).after(*spent)
            spent.append(state)

    def _find_slowly(self, strain: float, to_the_end: bool) -> State:
        """Search for the state at a strain in small steps, as a slow motion would reach it."""
        if self.settings.drag:
            return self._against_drag(strain)
        floor = -math.inf if to_the_end else self._least_energy(strain)
        return self._found(self._ahead(strain), self.settings, floor, convexified=self.many)

    def _find_fast(self, strain: float) -> State:
        floor = self._least_energy(strain)
        start = replace(self._ahead(strain), stage=Stage(wall=1e-2))
        near = intermediate_settings(self.settings, self.system.fabric)
        soft = self._found(start, near, floor, convexified=True)
        if soft.outcome is Outcome.left_branch:
            return soft
        return self._found(Point(soft.unknowns), self.settings, floor, convexified=True).after(soft)

    def _against_drag(self, strain: float) -> State:
        """The state reached by a viscous step; its residual, but not its energy, includes drag."""
        before_strain, before = self.last[-1]
        stiffness = self.settings.drag / abs(strain - before_strain)
        drag = Drag(before.unknowns, stiffness, self.free.dofs)
        rules = SearchRules(self.free, self.settings, drag=drag)
        state = find_equilibrium(self.system, self._ahead(strain), rules)
        elastic = self.system.evaluate(Point(state.unknowns))
        return replace(state, energy=elastic.energy, gradient=np.asarray(elastic.gradient))

    def _found(self, start: Point, settings: Solver, floor: float, convexified: bool) -> State:
        rules = SearchRules(self.free, settings, floor, convexified)
        return find_equilibrium(self.system, start, rules)

    def _ahead(self, strain: float) -> Point:
        """Extrapolation of the path to a strain, or as far on the way there as contact allows."""
        used = self.last if self.step.smooth else self.last[-2:]
        passed = [(before, state.unknowns) for before, state in used]
        far = self.loading.ahead(passed, strain)
        near = self.loading.ahead(passed[-1:], strain)
        contact = self.system.contact
        if contact is None and (len(passed) == 1 or not self.many):
            return Point(far)
        starts = [Point(near + fraction * (far - near)) for fraction in FRACTIONS_AHEAD]
        if contact is not None:
            before = passed[-1][1]
            for start in starts:  # the first that contact lets be reached from the last state
                if contact.free_fraction(before, start.unknowns - before) == 1:
                    return start
            return Point(np.full_like(before, np.nan))
        energies = [float(self.system.evaluate(start).energy.total) for start in starts]
        return starts[int(np.argmin(np.nan_to_num(energies, nan=np.inf)))]

    def _least_energy(self, strain: float) -> float:
        """Energy below which a state at a strain cannot be on the branch, by extrapolated work."""
        before_strain, before = self.last[-1]
        if len(self.last) == 1:
            return -math.inf
        distance = (strain - before_strain) * self.loading.length
        force = float(self.loading.reaction_force(before.gradient))
        earlier_strain, earlier = self.last[-2]
        growth = force - float(self.loading.reaction_force(earlier.gradient))
        slope = growth / (before_strain - earlier_strain)
        work = (force + slope * (strain - before_strain) / 2) * distance
        return float(before.energy.total) + work - self._allowed(work, strain)

    def _allowed(self, work: float, strain: float) -> float:
        """Largest difference between the energy and the work of a step on one branch [N mm]."""
        before_strain, before = self.last[-1]
        fraction = min(1.0, self.settings.path_step / abs(strain - before_strain))
        # If the work is almost 0, the stored energy is the scale.
        least = 1e-6 * float(before.energy.total)
        return self.settings.branch_limit * max(fraction * abs(work), least)

    def _on_branch(self, strain: float, state: State) -> bool:
        if not state.converged or self.settings.drag:
            return state.converged
        before_strain, before = self.last[-1]
        distance = (strain - before_strain) * self.loading.length
        forces = self.loading.reaction_force(before.gradient + state.gradient)
        work = float(forces) / 2 * distance
        gained = float(state.energy.total) - float(before.energy.total)
        lost = work - gained
        if self.system.fabric.friction is None:
            lost = abs(lost)
        # Friction that begins to slip during the step takes more than the mean force says.
        return lost <= self._allowed(work, strain)
