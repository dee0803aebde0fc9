"""FIRE: molecular dynamics that stops whenever it would go uphill.

Bitzek et al., Phys. Rev. Lett. 97, 170201 (2006), in the second version of Guénolé et al., Comput.
Mater. Sci. 175, 109584 (2020): semi-implicit Euler, unit masses, the step back after a turn, and
the parameters that they give. The initial time step is left to choose.
"""

from collections.abc import Callable
from functools import lru_cache, partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from benchmarks.solver.problem import Free, GivenUp, Problem, Search, Unknowns
from knitlab.model.energy import energy
from knitlab.model.fabric import Configuration, Fabric
from knitlab.model.network import MeshShape, network

DELAY = 20
GROWTH, CUT = 1.1, 0.5
FIRST_MIXING, MIXING_DECAY = 0.25, 0.99
LARGEST, SMALLEST = 10.0, 0.02
"""Largest and smallest time step over the initial one."""
MAX_TURNS = 2000
STEPS_AT_A_TIME = 100
"""Steps of one compiled loop."""


class _Motion(eqx.Module):
    position: Float[Array, " unknown"]
    velocity: Float[Array, " unknown"]
    force: Float[Array, " unknown"]
    time_step: Float[Array, ""]
    mixing: Float[Array, ""]
    downhill: Int[Array, ""]
    turns: Int[Array, ""]
    steps: Int[Array, ""]


Force = Callable[[Float[Array, " unknown"]], Float[Array, " unknown"]]


def _step(force: Force, first_step: Array, motion: _Motion) -> _Motion:
    """One step of FIRE 2.0."""
    onward = jnp.vdot(motion.force, motion.velocity) > 0
    downhill = jnp.where(onward, motion.downhill + 1, 0)
    turns = jnp.where(onward, 0, motion.turns + 1)
    grown = onward & (downhill > DELAY)
    longer = jnp.minimum(motion.time_step * GROWTH, LARGEST * first_step)
    shorter = motion.time_step * CUT
    may_cut = ~onward & (motion.steps >= DELAY) & (shorter >= SMALLEST * first_step)
    time_step = jnp.where(grown, longer, jnp.where(may_cut, shorter, motion.time_step))
    less = jnp.where(grown, motion.mixing * MIXING_DECAY, motion.mixing)
    mixing = jnp.where(onward, less, FIRST_MIXING)

    position = motion.position - jnp.where(onward, 0.0, 0.5 * time_step) * motion.velocity
    velocity = jnp.where(onward, motion.velocity, 0.0) + time_step * motion.force
    scale = jnp.linalg.norm(velocity) / jnp.maximum(jnp.linalg.norm(motion.force), 1e-300)
    velocity = (1 - mixing) * velocity + mixing * scale * motion.force
    position = position + time_step * velocity
    return _Motion(
        position, velocity, force(position), time_step, mixing, downhill, turns, motion.steps + 1
    )


@lru_cache(maxsize=4)
def _compiled(shape: MeshShape) -> Callable[..., tuple[_Motion, Array]]:
    net = network(shape)

    @jax.jit
    def some_steps(
        fabric: Fabric,
        free: Bool[Array, " unknown"],
        first_step: Array,
        tolerance: Array,
        motion: _Motion,
    ) -> tuple[_Motion, Array]:
        def force(position: Float[Array, " unknown"]) -> Float[Array, " unknown"]:
            def total(unknowns: Float[Array, " unknown"]) -> Array:
                return energy(net, fabric, Configuration.of(unknowns, shape)).total

            return jnp.where(free, -jax.grad(total)(position), 0.0)

        # The first call has no force yet.
        motion = eqx.tree_at(lambda m: m.force, motion, force(motion.position))
        last = motion.steps + STEPS_AT_A_TIME
        ended = lax.while_loop(
            lambda m: (
                (m.steps < last) & (jnp.abs(m.force).max() > tolerance) & (m.turns < MAX_TURNS)
            ),
            partial(_step, force, first_step),
            motion,
        )
        return ended, jnp.abs(ended.force).max()

    return some_steps


def fire(first_step: float) -> Search:
    """FIRE from rest, with an initial time step in units of √(g mm/N) at unit masses."""

    def search(problem: Problem, start: Unknowns, free: Free) -> Unknowns:
        motion = _at_rest(start, first_step)
        is_free = jnp.asarray(problem.which(free))
        numbers = jnp.asarray(first_step), jnp.asarray(problem.tolerance)
        while True:
            motion, residual = _compiled(problem.shape)(problem.fabric, is_free, *numbers, motion)
            if residual <= problem.tolerance:
                return np.asarray(motion.position)
            if not np.isfinite(residual) or int(motion.turns) >= MAX_TURNS:
                raise GivenUp("FIRE diverged or turned without end")

    return search


def _at_rest(start: Unknowns, first_step: float) -> _Motion:
    zero, none = jnp.zeros(len(start)), jnp.asarray(0)
    numbers = jnp.asarray(first_step), jnp.asarray(FIRST_MIXING)
    return _Motion(jnp.asarray(start), zero, zero, *numbers, none, none, none)
