"""A search for an equilibrium: its rules, its current configuration, and its cost."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int

from knitlab.equilibrium.settings import SolverSettings
from knitlab.equilibrium.state import Outcome, State
from knitlab.equilibrium.stiffness import FreeStiffness, free_stiffness
from knitlab.equilibrium.system import System
from knitlab.equilibrium.viscous import Drag
from knitlab.equilibrium.walls import Walls
from knitlab.fabric.configuration import Configuration
from knitlab.fabric.energy import Evaluation, Point
from knitlab.fabric.fabric import Fabric
from knitlab.fabric.network import MeshShape

if TYPE_CHECKING:
    from knitlab.fabric.barrier import Barrier

FIRST_SHIFT = 1e-4
"""Initial μ of a search that raises μ [N/mm]."""
NEARLY = 1e3
"""Force of a search that has nearly ended, over the tolerance."""
NEARLY_AT_MOST = 1e-3
"""Largest force of a search that has nearly ended [N]; subdomains and intermediate states, whose
tolerance is larger, may be far from any minimum."""


@dataclass(frozen=True, eq=False)
class SearchRules:
    """Rules of a search.

    Attributes:
        free: the free unknowns and the sparsity of their stiffness.
        step_length: longest change of the vector between neighbouring nodes in a step [mm].
        walls: the walls that the fabric lies between.
        settings: tolerance and limits.
        floor: energy below which the search stops, because the state sought has more [N mm].
        convexified: whether to convexify the stiffness rather than raise μ.
        contact: contact of the fabric with itself, if any.
        exact: whether to factorise in double precision from the start.
        drag: drag of a viscous step, if it is one.
    """

    free: FreeStiffness
    step_length: float
    walls: Walls
    settings: SolverSettings
    floor: float = -np.inf
    convexified: bool = True
    contact: "Barrier | None" = None
    exact: bool = False
    drag: Drag | None = None

    @classmethod
    def of(
        cls,
        shape: MeshShape,
        free: Int[np.ndarray, " free"],
        fabric: Fabric,
        settings: SolverSettings,
        floor: float = -np.inf,
        convexified: bool = True,
        contact: "Barrier | None" = None,
    ) -> "SearchRules":
        """Rules for a fabric; no step is longer than ``settings.step_limit`` of a grid cell."""
        longest = settings.step_limit * float(fabric.cell_sides.min())
        of_free, walls = free_stiffness(shape, free), Walls.of(fabric)
        return cls(of_free, longest, walls, settings, floor, convexified, contact)

    def up_to(self, iterations: int) -> "SearchRules":
        """The same, with another limit of iterations."""
        return replace(self, settings=replace(self.settings, max_iterations=iterations))

    def free_part(
        self, unknowns: Float[np.ndarray, " unknown"], step: Float[np.ndarray, " free"]
    ) -> float:
        """Part of a step that contact allows, at most 1."""
        if self.contact is None:
            return 1.0
        return self.contact.free_part(unknowns, self._of_all(step))

    def lowest_part(
        self, at: Point, step: Float[np.ndarray, " free"], slope: float, curvature: float
    ) -> float:
        """The fraction of a step, at most 1, with the least energy between the walls.

        Args:
            at: configuration before the step, and the stage.
            step: the step [mm].
            slope: first derivative of the energy along the step [N mm].
            curvature: second derivative of the energy along the step [N mm].
        """
        now, rise = (
            Configuration.of(unknowns, self.free.shape).positions[..., 2]
            for unknowns in (at.unknowns, self._of_all(step))
        )
        part = float(at.stage.wall)
        return self.walls.lowest(np.ravel(now), np.ravel(rise), slope, curvature, part)

    def longest_part(self, step: Float[np.ndarray, " free"]) -> float:
        """The fraction of a step that has the largest allowed length; above 1 for shorter steps."""
        return self.step_length / _longest_change(self.free.shape, self._of_all(step))

    def _of_all(self, step: Float[np.ndarray, " free"]) -> Float[np.ndarray, " unknown"]:
        """A step of all unknowns, which the held ones do not take."""
        whole = np.zeros(self.free.shape.unknowns)
        whole[self.free.places] = step
        return whole


class Search:
    """Current configuration of a search, its energy and forces, and the cost so far.

    Args:
        system: the equations of the fabric.
        at: configuration to start from, and the stage; its held unknowns stay fixed.
        rules: rules of the search.

    Attributes:
        exact: whether the stiffness is factorised in double precision.
    """

    def __init__(self, system: System, at: Point, rules: SearchRules) -> None:
        self.system, self.rules, self.places = system, rules, rules.free.places
        self.iterations, self.factorisations, self.exact = 0, 0, rules.exact
        self.begin(at, self.evaluated(at))

    def evaluated(self, at: Point) -> Evaluation:
        """Energy and gradient of a configuration, contact and drag included."""
        evaluation, contact, drag = self.system.evaluate(at), self.rules.contact, self.rules.drag
        if drag is not None:
            evaluation = drag.added(evaluation, at.unknowns)
        if contact is None or not np.isfinite(at.unknowns).all():
            return evaluation
        return contact.added(evaluation, at.unknowns)

    def factorise(self) -> bool:
        """Factorise the assembled stiffness plus μ; whether it is positive definite."""
        rules, contact = self.rules, None
        if rules.contact is not None:
            contact = rules.contact.hessian(self.at.unknowns, self.places)
        shift = self.shift + (rules.drag.stiffness if rules.drag is not None else 0.0)
        self.factorisations += 1
        return self.system.factorise(shift, rules.convexified, contact, self.exact)

    def begin(self, at: Point, evaluation: Evaluation) -> None:
        """Start, or restart, from a configuration; the cost so far is kept."""
        self.move(at, evaluation)
        self.shift = self.steepest_shift if self.rules.convexified else FIRST_SHIFT

    @property
    def steepest_shift(self) -> float:
        """μ with which the largest force moves a node by the step limit [N/mm].

        A step with a larger μ is shorter than the limit even along the softest modes.
        """
        return self.force / self.rules.step_length

    def move(self, at: Point, evaluation: Evaluation) -> None:
        """Continue from another configuration, given its energy and gradient."""
        self.at, self.evaluation = at, evaluation
        self.energy = float(evaluation.energy.total)
        self.gradient: Float[np.ndarray, " free"] = np.asarray(evaluation.gradient)[self.places]
        self.force = float(np.abs(self.gradient).max())

    def end(self) -> Outcome | None:
        """The outcome if the search ends at the current configuration, else None."""
        if self.force <= self.rules.settings.tolerance:
            return Outcome.converged
        if self.energy < self.rules.floor:
            return Outcome.left_branch
        if self.iterations >= self.rules.settings.max_iterations:
            return Outcome.iteration_limit
        return None if np.isfinite(self.force) else Outcome.stalled

    @property
    def nearly_ended(self) -> bool:
        """Whether so little force is left that the stiffness must be positive definite."""
        return self.force <= min(NEARLY * self.rules.settings.tolerance, NEARLY_AT_MOST)

    def state(self, outcome: Outcome) -> State:
        """The current state."""
        return State(
            shape=self.rules.free.shape,
            unknowns=self.at.unknowns,
            energy=self.evaluation.energy,
            gradient=np.asarray(self.evaluation.gradient),
            outcome=outcome,
            residual=self.force,
            iterations=self.iterations,
            factorisations=self.factorisations,
        )


def _longest_change(shape: MeshShape, step: Float[np.ndarray, " unknown"]) -> float:
    """Longest change, in a step, of the vector from a node to its neighbour [mm].

    A part of the sheet may move or rotate far as a rigid body; only relative motion of neighbouring
    nodes must be limited.
    """
    move = Configuration.of(step, shape)
    nodes, (along_x, along_y) = np.asarray(move.positions), np.asarray(move.lengths)
    changes = [np.diff(nodes, axis=0), np.diff(nodes, axis=1)]
    if shape.periodic:
        changes.append(nodes[0] - nodes[-1] + np.array([0.0, along_y, 0.0]))
        changes.append(nodes[:, 0] - nodes[:, -1] + np.array([along_x, 0.0, 0.0]))
    longest = max(np.einsum("...c,...c->...", change, change).max() for change in changes)
    return max(float(longest), np.finfo(float).tiny) ** 0.5
