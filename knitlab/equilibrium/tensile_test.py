"""The simulated tensile test: equilibria at a sequence of applied strains."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from knitlab.equilibrium.domain_decomposition import find_equilibrium_by_subdomains
from knitlab.equilibrium.equilibrium import find_equilibrium
from knitlab.equilibrium.equilibrium_search import SearchRules
from knitlab.equilibrium.loading import Loading, tensile
from knitlab.equilibrium.path_step import PathStep
from knitlab.equilibrium.relaxation import intermediate_settings, relax, relax_near
from knitlab.equilibrium.settings import SolverSettings
from knitlab.equilibrium.state import Outcome, State
from knitlab.equilibrium.subdomains import worth_dividing
from knitlab.equilibrium.system import System
from knitlab.equilibrium.tensile_result import TensileTest
from knitlab.equilibrium.viscous import Drag
from knitlab.fabric.configuration import Configuration
from knitlab.fabric.energy import Point, Stage

if TYPE_CHECKING:
    from knitlab.fabric.barrier import Barrier

KEPT = 3
"""States from which the path is extrapolated."""
ROUGH = 50
"""Iterations of a strain step above which the path counts as rough."""
ROUGH_WALL = 1e-2
"""Fraction of the wall stiffness at which the step after a rough one begins."""
PARTS_AHEAD = (1.0, 0.5, 0.25, 0.125, 0.0)
"""Fractions of the way from an affine stretch of the last state to the extrapolation."""
LEAST_WORK = 1e-6
"""Ratio of work to stored energy of a strain step below which the stored energy is the scale."""


def stretch(
    system: System,
    applied_strain: Sequence[float],
    settings: SolverSettings,
    progress: Callable[[int], None] = lambda done: None,
    start: Configuration | None = None,
    folded: Configuration | None = None,
    unload: bool = False,
    contact: "Barrier | None" = None,
) -> TensileTest:
    """Relax a fabric and run its tensile test.

    The path to a strain is followed in steps of ``settings.path_step``, or up to four times as long
    where that takes few iterations (:mod:`.path_step`). Each step starts from the
    linear extrapolation of the two previous states, or, after few iterations, the quadratic one of
    three; for a sample of many subdomains, from the point of lowest energy on the way there. If the
    previous step took many iterations, the path is rough: the extrapolation is poor, and hard walls
    would obstruct the search for the equilibrium. The search then begins with soft walls and a
    convexified stiffness.

    Along a branch of equilibria the energy grows by the work of the reaction force. If the
    difference exceeds ``settings.branch_limit`` times that work, or times the work of a step of
    ``settings.path_step`` if that is less, the fabric has left its branch. A
    step that does so, or fails, is repeated over half the strain, down to
    ``settings.smallest_step`` of a full one. If it leaves the branch even then, the branch ends
    there: the fabric has snapped, and the state it snapped to is accepted and marked. The
    iterations of all attempts are counted in the state that they lead to. The test ends at the
    first strain that cannot be reached.

    Args:
        system: the equations of the fabric.
        applied_strain: strains, ascending from 0, which is the relaxed shape.
        settings: settings of the equilibrium solver.
        progress: called with the number of finished states.
        start: configuration to start the relaxation from; the flat sheet by default.
        folded: in place of it, a configuration nearly in equilibrium, whose equilibrium is found
            without a detour.
        unload: whether to unload a fabric that reached the last strain through all strains.
        contact: contact of the fabric with itself, if any.
    """
    if folded is None:
        relaxed = relax(system, settings, start, contact)
    else:
        relaxed = relax_near(system, settings, folded, contact)
    progress(1)
    if not relaxed.converged:
        return TensileTest(None, [relaxed])
    loading = tensile(system.shape, relaxed.configuration)
    path = _Path(system, loading, [(applied_strain[0], relaxed)], settings, contact)
    states = [relaxed]
    for target in applied_strain[1:]:
        state = path.to(target)
        states.append(state)
        progress(len(states))
        if not state.converged:
            break
    unloaded: list[State] = []
    while unload and states[-1].converged and len(unloaded) < len(states) - 1:
        state = path.to(applied_strain[-2 - len(unloaded)])
        if not state.converged:
            break
        unloaded.append(state)
    return TensileTest(loading, states, unloaded=tuple(unloaded))


@dataclass
class _Path:
    """The most recent states of a test, from which the next one is found."""

    system: System
    loading: Loading
    last: list[tuple[float, State]]
    settings: SolverSettings
    contact: "Barrier | None" = None

    def __post_init__(self) -> None:
        self.step = PathStep.first(self.settings)

    def to(self, target: float) -> State:
        """Follow the path to a larger or smaller strain."""
        spent, snapped = list[State](), False
        smallest = self.step.smallest(abs(target - self.last[-1][0]))
        while True:
            strain = self.step.towards(self.last[-1][0], target)
            taken = strain - self.last[-1][0]
            final = abs(taken) <= smallest
            # If subdomains are solved first, walls rarely obstruct the search for the whole sample.
            many = worth_dividing(self.loading.shape)
            rough = self.last[-1][1].iterations > ROUGH and not many and not self.settings.drag
            state = self._find_fast(strain) if rough else self._find_slowly(strain, final)
            followed = self._on_branch(strain, state)
            if rough and final and not followed:
                spent.append(state)
                state = self._find_slowly(strain, to_the_end=True)
                followed = self._on_branch(strain, state)
            if not state.converged and final:
                return replace(state, snapped=snapped).after(*spent)
            if followed:
                self.last = [*self.last[1 - KEPT :], (strain, state)]
                self.step = self.step.after(taken, state.iterations)
            elif state.converged and final:
                snapped, self.last = True, [(strain, state)]
                self.step = PathStep.first(self.settings)
            else:
                self.step = self.step.after_failure(taken)
            if self.last[-1][0] == target:
                return replace(state, snapped=snapped).after(*spent)
            spent.append(state)

    def _find_slowly(self, strain: float, to_the_end: bool) -> State:
        """Search for the state at a strain in small steps, as a slow motion would reach it.

        With many subdomains each subdomain raises its own μ when it snaps; raising μ of the whole
        sample would slow all others.

        A search that leaves the branch is stopped, unless ``to_the_end``: then it continues to the
        state that the fabric snaps to. With drag there are no branches.
        """
        if self.settings.drag:
            return self._against_drag(strain)
        floor = -math.inf if to_the_end else self._least_energy(strain)
        convexified = worth_dividing(self.loading.shape)
        return self._found(self._ahead(strain), self.settings, floor, convexified)

    def _find_fast(self, strain: float) -> State:
        """Search for the state at a strain on a rough path."""
        floor, start = self._least_energy(strain), self._ahead(strain)
        soft = self._found(
            replace(start, stage=Stage(wall=ROUGH_WALL)),
            intermediate_settings(self.settings, self.system.fabric),
            floor,
            convexified=True,
        )
        if soft.outcome is Outcome.left_branch:
            return soft
        state = self._found(Point(soft.unknowns), self.settings, floor, convexified=True)
        return state.after(soft)

    def _against_drag(self, strain: float) -> State:
        """The state at a strain that is reached at a finite rate, by a viscous step.

        Its energy and gradient are those of the fabric; its residual includes the drag.
        """
        before_strain, before = self.last[-1]
        free, settings, system = self.loading.free, self.settings, self.system
        step = settings.drag / abs(strain - before_strain)
        rules = SearchRules.of(system.shape, free, system.fabric, settings)
        rules = replace(rules, drag=Drag(free, before.unknowns, step))
        state = find_equilibrium(system, self._ahead(strain), rules)
        elastic = system.evaluate(Point(state.unknowns))
        return replace(state, energy=elastic.energy, gradient=np.asarray(elastic.gradient))

    def _ahead(self, strain: float) -> Point:
        """Extrapolation of the path to a strain.

        If wrinkles across many subdomains have moved, the extrapolation penetrates the walls, and
        the search from there would crush cells. Then the point of lowest energy on the line from
        the last state to the extrapolation is used.
        """
        used = self.last if self.step.smooth else self.last[-2:]
        passed = [(before, state.unknowns) for before, state in used]
        far = self.loading.ahead(passed, strain)
        near = self.loading.ahead(passed[-1:], strain)
        if self.contact is not None:
            return Point(self._reachable(near, far))
        if len(passed) == 1 or not worth_dividing(self.loading.shape):
            return Point(far)
        starts = [Point(near + part * (far - near)) for part in PARTS_AHEAD]
        energies = [float(self.system.evaluate(start).energy.total) for start in starts]
        return starts[int(np.argmin(np.nan_to_num(energies, nan=np.inf)))]

    def _reachable(
        self, near: Float[np.ndarray, " unknown"], far: Float[np.ndarray, " unknown"]
    ) -> Float[np.ndarray, " unknown"]:
        """The furthest point on the way from ``near`` to ``far`` that contact lets be reached."""
        before = self.last[-1][1].unknowns
        for part in PARTS_AHEAD:
            start = near + part * (far - near)
            if self.contact is None or self.contact.free_part(before, start - before) == 1:
                return start
        return np.full_like(near, np.nan)

    def _found(
        self, start: Point, settings: SolverSettings, floor: float, convexified: bool
    ) -> State:
        system, free = self.system, self.loading.free
        rules = SearchRules.of(
            system.shape, free, system.fabric, settings, floor, convexified, self.contact
        )
        return find_equilibrium_by_subdomains(system, start, rules)

    def _least_energy(self, strain: float) -> float:
        """Energy below which a state at a strain cannot be on the branch, by extrapolated work."""
        before_strain, before = self.last[-1]
        if len(self.last) == 1:
            return -math.inf
        distance = (strain - before_strain) * self.loading.length
        force = self.loading.reaction_force(before.gradient)
        earlier_strain, earlier = self.last[-2]
        earlier_force = self.loading.reaction_force(earlier.gradient)
        slope = (force - earlier_force) / (before_strain - earlier_strain)
        work = (force + slope * (strain - before_strain) / 2) * distance
        return float(before.energy.total) + work - self._allowed(work, strain)

    def _allowed(self, work: float, strain: float) -> float:
        """Largest difference between the energy and the work of a step on one branch [N mm]."""
        before_strain, before = self.last[-1]
        part = min(1.0, self.settings.path_step / abs(strain - before_strain))
        least = LEAST_WORK * float(before.energy.total)
        return self.settings.branch_limit * max(part * abs(work), least)

    def _on_branch(self, strain: float, state: State) -> bool:
        """Whether a state converged, and its energy grew by the work done."""
        if not state.converged or self.settings.drag:
            return state.converged
        before_strain, before = self.last[-1]
        distance = (strain - before_strain) * self.loading.length
        forces = [self.loading.reaction_force(each.gradient) for each in (before, state)]
        work = sum(forces) / 2 * distance
        gained = float(state.energy.total) - float(before.energy.total)
        return abs(gained - work) <= self._allowed(work, strain)
