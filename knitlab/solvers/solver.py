"""Solvers as generators of requests, independent of the executor that answers them.

A solver yields a request and is sent the answer. It does not use a device itself, so that the same
solver runs alone on a CPU or together with others in a batch on an accelerator
(:mod:`knitlab.solvers.executor`).
"""

from collections.abc import Generator
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int
from pydantic import NonNegativeFloat, PositiveFloat, PositiveInt

from knitlab.elasticity.evaluation import COMPLETE, Stage
from knitlab.elasticity.stiffness import FreeStiffness
from knitlab.model.setting_types import Fraction, Unit

Result = TypeVar("Result")


@dataclass(frozen=True)
class Evaluate:
    """Request for energy and gradient, answered by an ``Evaluation`` of NumPy arrays."""

    unknowns: Float[np.ndarray, " unknown"]
    stage: Stage = field(default=COMPLETE)


@dataclass(frozen=True)
class Assemble:
    """Request to assemble the stiffness of the free unknowns; it has no answer."""

    unknowns: Float[np.ndarray, " unknown"]
    free: FreeStiffness
    stage: Stage = field(default=COMPLETE)


@dataclass(frozen=True)
class Factorise:
    """Request to factorise the assembled stiffness plus a shift, answered by whether it succeeded.

    Attributes:
        shift: added to the diagonal [N/mm].
        convexified: whether to factorise a nearby positive definite matrix instead of failing.
        contact: Hessian of the contact, if any is active, to be added; it may couple any two
            unknowns. The matrix is not convexified then, and factorised in double precision: the
            long steps that convexity allows would end at the next collision [N/mm].
        exact: whether in double precision. Single precision takes half the time and memory, and is
            enough for a search, whose forces are those of the exact energy.
    """

    shift: float
    convexified: bool
    contact: sp.csc_array | None = None
    exact: bool = False


@dataclass(frozen=True)
class Solve:
    """Request for K⁻¹ times a vector with the last factorisation, answered by that product."""

    right: Float[np.ndarray, " free"]


@dataclass(frozen=True)
class ChangeDiagonal:
    """Request to change the diagonal of the factorised stiffness for the next solves.

    It replaces earlier changes, and is answered by whether the stiffness is positive definite
    then; if not, or if the executor cannot change it, the stiffness is as it was factorised.

    Attributes:
        places: indices among the free unknowns.
        changes: what is added at each, not 0 [N/mm].
    """

    places: Int[np.ndarray, " changed"]
    changes: Float[np.ndarray, " changed"]


@dataclass(frozen=True)
class SolveSubdomains:
    """Request to solve the subdomains of a sample to low accuracy, one after another.

    It is answered by the resulting state of the sample, and by the number of iterations, each
    weighted by the subdomain's share of the unknowns.

    Attributes:
        at: configuration to start from, and the stage.
        free: the free unknowns of the sample.
        step_length: longest change of the vector between neighbouring nodes in a step [mm].
        settings: settings for each subdomain.
        force_part: fraction of the largest force in the sample that is accepted in a subdomain, if
            it exceeds the tolerance.
    """

    at: Evaluate
    free: FreeStiffness
    step_length: float
    settings: "SolverSettings"
    force_part: float = 0.0


Start = Literal["dynamics", "flat", "periodic"]
Request = Evaluate | Assemble | Factorise | ChangeDiagonal | Solve | SolveSubdomains
Solver = Generator[Request, Any, Result]


@dataclass(frozen=True)
class SolverSettings:
    """Settings of the search for equilibria.

    Attributes:
        tolerance: largest residual force on any free unknown [N].
        max_iterations: largest number of steps of a search.
        step_limit: longest change of the vector between two neighbouring nodes in a step, as a
            fraction of the shorter side of a grid cell; keeps hinges from passing ±π.
        smallest_shift: smallest shift, which also regularises the modes that cost no energy
            [N/mm].
        start: how a clamped sample relaxes: ``dynamics``, the whole flat sheet by damped dynamics,
            then to equilibrium; ``flat``, the whole flat sheet by minimisation; ``periodic``, from
            a tiling of relaxed periodic fabric. Periodic fabric always starts flat, and so does a
            sample with contact in place of ``dynamics``.
        ramp_steps: number of equal steps in which relaxation raises the rest fold angles.
        soft_wall: fraction of the wall stiffness at which relaxation begins, raised tenfold from
            stage to stage; 1 for hard walls from the start.
        waypoint_force: residual force accepted between these steps, as a fraction of the largest
            force of a fold, k_t × fold angle / cell.
        path_step: step of applied strain from one equilibrium to the next; up to four times as long
            where few iterations suffice.
        smallest_step: fraction of a strain step down to which it is halved if the search fails or
            the fabric leaves its branch.
        branch_limit: difference between the change of energy in a strain step and the work done in
            it, as a fraction of that work, or of the work done in ``path_step`` if that is less,
            above which the fabric has left its branch.
        drag: c ε̇, damping of a node times the rate of the applied strain [N/mm]; with 0 the test is
            quasi-static and every state an equilibrium.
    """

    tolerance: Annotated[PositiveFloat, Unit("N")] = 1e-8
    max_iterations: PositiveInt = 4000
    step_limit: Fraction = 0.3
    smallest_shift: Annotated[PositiveFloat, Unit("N/mm")] = 1e-9
    start: Start = "dynamics"
    ramp_steps: PositiveInt = 1
    soft_wall: Fraction = 1e-3
    waypoint_force: Fraction = 1e-3
    path_step: Fraction = 0.01
    smallest_step: Fraction = 1 / 8
    branch_limit: PositiveFloat = 0.05
    drag: Annotated[NonNegativeFloat, Unit("N/mm")] = 0.0
