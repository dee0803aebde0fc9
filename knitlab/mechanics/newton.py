"""Equilibrium by regularised Newton: the step (K + μ I) p = −g, with μ kept as small as works.

A solver here is a generator. It yields the configuration that it wants evaluated and is sent
the :class:`~knitlab.mechanics.evaluation.Evaluation`, so that the solvers of many fabrics can run
in step and share one vmapped evaluation (:mod:`knitlab.mechanics.lockstep`).
"""

from collections.abc import Generator
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from jaxtyping import Float

from knitlab.mechanics.evaluation import Evaluation
from knitlab.mechanics.factorisation import factorise
from knitlab.mechanics.state import Outcome, State
from knitlab.mechanics.stiffness import FreeStiffness

Result = TypeVar("Result")


@dataclass(frozen=True)
class Request:
    """A configuration to evaluate, and how much of the rest fold angles acts in it."""

    configuration: Float[np.ndarray, " unknown"]
    fold_fraction: float = 1.0


Solver = Generator[Request, Evaluation, Result]


@dataclass(frozen=True)
class SolverSettings:
    """How equilibria are searched for.

    Attributes:
        tolerance: largest force left on any free unknown [N].
        max_iterations: steps tried before a search is given up.
        step_limit: longest move of any unknown in a step, as a fraction of the shorter side of
            a grid cell; keeps hinges from being thrown past ±π.
        smallest_shift: floor of μ, which also steadies the modes that cost no energy [N/mm].
        ramp_steps: equal steps in which relaxation raises the rest fold angles.
        waypoint_force: force that may be left between those steps, as a part of the largest
            that a fold exerts, k_t × fold angle / cell.
        path_step: largest step of applied strain from one equilibrium to the next.
        smallest_step: part of a strain step down to which a failed one is halved.
    """

    tolerance: float = 1e-8
    max_iterations: int = 500
    step_limit: float = 0.3
    smallest_shift: float = 1e-9
    ramp_steps: int = 10
    waypoint_force: float = 1e-3
    path_step: float = 0.01
    smallest_step: float = 1 / 16


FIRST_SHIFT = 1e-3
LEAST_RAISED_SHIFT = 1e-6
LARGEST_SHIFT = 1e6
# Below this relative change the energy is round-off and the force decides instead.
ENERGY_ROUND_OFF = 1e-12


def find_equilibrium(
    start: Request,
    free: FreeStiffness,
    step_length: float,
    settings: SolverSettings,
) -> Solver[State]:
    """Move the free unknowns downhill to a state where no force is left on them.

    Each step solves (K + μ I) p = −g for a positive definite K + μ I, so that it always goes
    downhill and follows the fabric through snaps towards a minimum nearby. μ shrinks while the
    quadratic model predicts the energy well and grows when it does not (Levenberg–Marquardt);
    where it vanishes the convergence is Newton's. The state that is returned is tested for its
    force alone: a path that runs straight into a saddle would end there.

    Args:
        start: configuration to start from; its held unknowns stay.
        free: the free unknowns and the sparsity of their stiffness.
        step_length: longest move of any unknown in a step [mm].
        settings: tolerance and limits.
    """
    unknowns = free.unknowns
    request, now = start, (yield start)
    shift, iterations, factorisations = FIRST_SHIFT, 0, 0

    def state(outcome: Outcome) -> State:
        residual = float(np.abs(now.gradient[unknowns]).max())
        return State(
            configuration=request.configuration,
            energy=now.energy,
            gradient=np.asarray(now.gradient),
            outcome=outcome,
            residual=residual,
            iterations=iterations,
            factorisations=factorisations,
        )

    while True:
        gradient = now.gradient[unknowns]
        force = np.abs(gradient).max()
        if force <= settings.tolerance:
            return state(Outcome.converged)
        if iterations >= settings.max_iterations:
            return state(Outcome.iteration_limit)

        stiffness = free.matrix(now)
        factors = None
        while factors is None:
            if not shift < LARGEST_SHIFT or not np.isfinite(force):
                return state(Outcome.stalled)
            factorisations += 1
            factors = factorise(free.shifted(stiffness, shift))
            if factors is None:
                shift = max(4 * shift, LEAST_RAISED_SHIFT)

        step = -factors.solve(gradient)
        shortening = min(1.0, step_length / np.abs(step).max())
        step *= shortening
        configuration = request.configuration.copy()
        configuration[unknowns] += step
        trial = replace(request, configuration=configuration)
        then = yield trial
        iterations += 1

        expected = -(gradient @ step + 0.5 * step @ (stiffness @ step))
        gained = now.energy.total - then.energy.total
        blurred = max(abs(gained), abs(expected)) < ENERGY_ROUND_OFF * max(
            1.0, float(now.energy.total)
        )
        agreement = gained / expected if expected > 0 else -1.0
        calmer = np.abs(then.gradient[unknowns]).max() <= force
        if agreement > 1e-4 or (blurred and calmer):
            request, now = trial, then
            if agreement > 0.75 or blurred:
                shift = max(shift * (0.1 if shortening == 1 else 0.3), settings.smallest_shift)
            elif agreement < 0.25:
                shift *= 3
        else:
            shift = max(5 * shift, LEAST_RAISED_SHIFT)
