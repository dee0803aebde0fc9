"""The paper's method: damped dynamics by ``diffrax.Tsit5`` until nothing moves.

Motions are cut into pieces, each from where and how fast the last ended, so that the watch can be
looked at between them. A load step starts as for the other methods, from rest; no time is spent on
pulling slowly, which spares the dynamics the better part of what knitlab's own tensile test by
dynamics takes.
"""

from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool

from benchmarks.solver.problem import Free, Problem, Search, Unknowns
from benchmarks.solver.watch import GivenUp, Watch
from knitlab.mechanics.dynamics import Motion, PrescribedMotion, batch_integrator
from knitlab.mechanics.dynamics_settings import DynamicsSettings
from knitlab.mechanics.loading import all_free
from knitlab.solvers.batch import stacked

PIECE = 0.25
"""Length of a piece of motion [ms]."""
WIDER = 100.0
"""By how much tolerances of a time step may be wider than the shipped ones on one unit cell, as
only the end matters here: that saves half of the steps. In larger samples nodes press on the wall,
and its stiffness bounds the steps; where these may err more, such nodes go on trembling: in 3 × 2
cells with forces of 1e-3 N, or of 3e-6 N if ten times as wide, so that they never come to rest."""
STAGES = 6
"""Evaluations of a step of Tsit5, whose last is the first of the next."""


def dynamics(settings: DynamicsSettings, damping: float, wider: float = 1.0) -> Search:
    """Damped dynamics from rest, with a viscous damping of the nodes [g/ms].

    Args:
        settings: of the dynamics.
        damping: of a node.
        wider: by how much tolerances of a time step are wider than the shipped ones.
    """
    settings = replace(
        settings,
        duration=PIECE,
        relative_tolerance=wider * settings.relative_tolerance,
        absolute_tolerance=wider * settings.absolute_tolerance,
    )

    def search(problem: Problem, start: Unknowns, free: Free, watch: Watch) -> Unknowns:
        if problem.inertia is None:
            raise ValueError("the dynamics need a mass; pose the problem with method=dynamics")
        inertia = eqx.tree_at(lambda i: i.damping, problem.inertia, jnp.asarray(damping))
        integrate = batch_integrator(
            problem.shape, replace(settings, steady_force=problem.tolerance)
        )
        zero = jnp.zeros(1)
        at, drive = jnp.asarray(start), _held(start, problem.which(free))
        motion = Motion(at[None], jnp.zeros_like(at)[None], zero, zero)
        numbers = stacked([problem.fabric]), stacked([inertia]), stacked([drive])
        kept = jnp.array([[0.0, PIECE]]), jnp.array([[0.0]])
        while True:
            piece = integrate(*numbers, motion, *kept)
            motion = piece.end
            residual = float(np.abs(np.asarray(piece.gradient[0])[free]).max())
            watch.sees(residual, STAGES * int(piece.steps[0]))
            if piece.steady[0]:
                return np.asarray(motion.unknowns[0])
            if not piece.successful[0]:
                raise GivenUp("the dynamics diverged")

    return search


def prepare(settings: DynamicsSettings, problem: Problem) -> None:
    """Compile its program: one look at a fabric on which any force may be left."""
    once = replace(problem, tolerance=np.inf)
    dynamics(settings, 1.0)(once, problem.flat, all_free(problem.shape), Watch(np.inf))


def _held(start: Unknowns, free: Bool[np.ndarray, " unknown"]) -> PrescribedMotion:
    """What is not free stays where it is."""
    zero, at = jnp.asarray(0.0), jnp.asarray(start)
    return PrescribedMotion(
        free=jnp.asarray(free),
        reference=at,
        direction=jnp.zeros_like(at),
        before=zero,
        after=zero,
        ramp_time=zero,
        ended=jnp.asarray(False),
    )
