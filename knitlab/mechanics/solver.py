"""Solvers as generators of requests, independent of what answers them.

A solver yields a request and is sent the answer. It never touches a device itself, so that one
and the same solver runs alone on a processor or beside others in batches on an accelerator
(:mod:`knitlab.mechanics.executor`).
"""

from collections.abc import Generator
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from jaxtyping import Float
from pydantic import NonNegativeFloat, PositiveFloat, PositiveInt

from knitlab.mechanics.evaluation import WHOLE, Stage
from knitlab.mechanics.stiffness import FreeStiffness
from knitlab.model.setting_types import Fraction, Unit

Result = TypeVar("Result")


@dataclass(frozen=True)
class Evaluate:
    """Request for energy and gradient, answered by an ``Evaluation`` of NumPy arrays."""

    unknowns: Float[np.ndarray, " unknown"]
    stage: Stage = field(default=WHOLE)


@dataclass(frozen=True)
class Assemble:
    """Request to assemble the stiffness of the free unknowns; it has no answer."""

    unknowns: Float[np.ndarray, " unknown"]
    free: FreeStiffness
    stage: Stage = field(default=WHOLE)


@dataclass(frozen=True)
class Factorise:
    """Request to factorise the assembled stiffness plus a shift, answered by whether it could be.

    Attributes:
        shift: added to the diagonal [N/mm].
        convexified: whether, if it is not, a matrix nearby that is may be factored instead.
    """

    shift: float
    convexified: bool


@dataclass(frozen=True)
class Solve:
    """Request for K⁻¹ times a vector by the last factorisation, answered by that vector."""

    right: Float[np.ndarray, " free"]


@dataclass(frozen=True)
class SolveSubdomains:
    """Request to solve the subdomains of a sample to a low accuracy, one after the other.

    It is answered by the state of the sample after that, and by the iterations they took, each
    counted as the share of the sample's unknowns that the subdomain has.

    Attributes:
        at: where to start from, and the stage.
        free: the free unknowns of the sample.
        step_length: longest change of the vector between neighbouring nodes in a step [mm].
        settings: for each subdomain.
    """

    at: Evaluate
    free: FreeStiffness
    step_length: float
    settings: "SolverSettings"


Start = Literal["endless", "flat"]
Request = Evaluate | Assemble | Factorise | Solve | SolveSubdomains
Solver = Generator[Request, Any, Result]


@dataclass(frozen=True)
class SolverSettings:
    """How equilibria are searched for.

    Attributes:
        tolerance: largest force left on any free unknown [N].
        max_iterations: steps tried before a search is given up.
        step_limit: longest change of the vector between two neighbouring nodes in a step, as a
            fraction of the shorter side of a grid cell; keeps hinges from being thrown past ±π.
        smallest_shift: floor of the shift, which also steadies the modes that cost no energy
            [N/mm].
        start: where the relaxation of a clamped sample starts from: ``endless``, tiled with
            relaxed periodic fabric, or ``flat``; periodic fabric always starts flat.
        ramp_steps: equal steps in which relaxation raises the rest fold angles.
        soft_wall: fraction of the walls' stiffness that relaxation begins with, to be raised
            tenfold from stage to stage; 1 for hard walls from the start.
        waypoint_force: force that may be left between those steps, as a part of the largest
            that a fold exerts, k_t × fold angle / cell.
        path_step: largest step of applied strain from one equilibrium to the next.
        smallest_step: part of a strain step down to which it is halved where the search fails or
            the fabric leaves its branch.
        branch_limit: energy that a strain step may gain or lose against the work done in it, as a
            part of that work, before the fabric counts as having left its branch.
        drag: c ε̇, damping of a node times the rate at which the applied strain rises [N/mm]; with 0
            the test is so slow that every state is an equilibrium.
    """

    tolerance: Annotated[PositiveFloat, Unit("N")] = 1e-8
    max_iterations: PositiveInt = 4000
    step_limit: Fraction = 0.3
    smallest_shift: Annotated[PositiveFloat, Unit("N/mm")] = 1e-9
    start: Start = "endless"
    ramp_steps: PositiveInt = 1
    soft_wall: Fraction = 1e-3
    waypoint_force: Fraction = 1e-3
    path_step: Fraction = 0.01
    smallest_step: Fraction = 1 / 8
    branch_limit: PositiveFloat = 0.05
    drag: Annotated[NonNegativeFloat, Unit("N/mm")] = 0.0
