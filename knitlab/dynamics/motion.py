"""Damped motion of fabrics, M ü + c u̇ + ∇V = 0 (paper, equations of motion of Sec. "3D model").

Fabrics of one mesh shape move in one vmapped program. Each has its own time step and its own end.
Within a batch, those that have arrived stand still: a result does not depend on its batch.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from knitlab.dynamics.body import Body, Motion, Observed, driving_power, loss, observed
from knitlab.dynamics.grid import Shape
from knitlab.dynamics.settings import DynamicsSettings

STEPS_AT_ONCE = 256
"""Time steps after which step size, energy and forces are looked at again."""
FIRST_ITERATIONS, MORE_ITERATIONS = 40, 4
"""Iterations for the highest frequency of a fabric, the first time and from its last mode on."""
DIFFERENCE = 1e-6
"""Displacement by which a product of the Hessian with a vector is a central difference [mm]."""
GROWTH = 0.02
"""Growth of the mechanical energy, over its largest part, above which a step was unstable."""
HALVINGS = 12
"""Times that an unstable step is halved before the motion counts as diverged. Where a cell is
crushed to a line its hinges are stiff for a moment, which a step of 1/300 was seen to pass."""
RUNGE_KUTTA_TIME = 1.0
"""Time after which the Runge–Kutta method looks at the forces again [ms]."""


def highest_frequency(
    body: Body, motion: Motion, mode: Shape, iterations: Int[Array, ""]
) -> tuple[Float[Array, ""], Shape]:
    """Square of the highest frequency, without walls, by power iteration on M⁻¹ K [1/ms²].

    Args:
        body: the fabric.
        motion: its motion.
        mode: a shape to begin with, of any size.
        iterations: products of the Hessian with a vector.

    Returns:
        The square, and the mode, for the next time.
    """

    def weighted(vector: Shape) -> Shape:
        # With M^(−1/2) on both sides the matrix is symmetric, and its Rayleigh quotients are sharp.
        x, y, z = (jnp.sqrt(body.inverse_mass) * part for part in vector.positions)
        return Shape((x, y, z), jnp.sqrt(body.inverse_mass_of_lengths) * vector.lengths)

    def norm(vector: Shape) -> Float[Array, ""]:
        return jnp.sqrt(sum(jnp.sum(leaf**2) for leaf in jax.tree.leaves(vector)))

    def gradient_at(direction: Shape, part: Float[Array, ""]) -> Shape:
        shape = jax.tree.map(lambda at, by: at + part * by, motion.shape, direction)
        return body.fabric.gradient(shape, walls=False)

    def again(_: Any, last: tuple[Array, Shape]) -> tuple[Array, Shape]:
        direction = weighted(last[1])
        # A forward derivative of the gradient takes six times as long as two gradients.
        size = jnp.stack([jnp.max(jnp.abs(leaf)) for leaf in jax.tree.leaves(direction)])
        part = DIFFERENCE / jnp.max(size)
        ahead, behind = gradient_at(direction, part), gradient_at(direction, -part)
        image = weighted(jax.tree.map(lambda one, two: (one - two) / (2 * part), ahead, behind))
        size = norm(image)
        return size, jax.tree.map(lambda leaf: leaf / size, image)

    begin = jax.tree.map(lambda leaf: leaf / norm(mode), mode)
    return jax.lax.fori_loop(0, iterations, again, (jnp.zeros(()), begin))


def leapfrog(
    body: Body,
    motion: Motion,
    step: Float[Array, ""],
    count: Int[Array, ""],
    longest: Int[Array, ""],
) -> Motion:
    """Move a fabric by a number of equal steps of the leapfrog.

    Drag and walls are taken implicitly, which costs nothing: both act on every coordinate alone. A
    wall acts with the force at the height that the step leads to. States at rest are those of the
    explicit scheme, and the walls, by far the stiffest part, do not limit the time step.

    Args:
        body: the fabric.
        motion: its motion.
        step: time step, 0 to stand still [ms].
        count: number of steps.
        longest: largest number of steps in the batch; the fabric stands still after its own.
    """
    rate, rate_of_lengths = body.damping_rate
    half, half_of_lengths = step * rate / 2, step * rate_of_lengths / 2
    stiffness, z_max = body.fabric.k_wall, body.fabric.z_max
    gradient = partial(body.fabric.gradient, walls=False)

    def kicked(
        motion: Motion,
        force: Shape,
        before: Float[Array, ""],
        after: Float[Array, ""],
        drift: Float[Array, ""],
    ) -> Shape:
        # Velocity after a kick of ``before`` half steps up to now, and ``after`` from now on, with
        # the walls as they act after a drift.
        kept = (1 - after * half) / (1 + before * half)
        push = step * (before + after) / 2 * body.inverse_mass / (1 + before * half)
        kept_of_lengths = (1 - after * half_of_lengths) / (1 + before * half_of_lengths)
        push_of_lengths = (step * (before + after) / 2 * body.inverse_mass_of_lengths) / (
            1 + before * half_of_lengths
        )
        x, y, z = (
            kept * velocity - push * by
            for velocity, by in zip(motion.velocity.positions, force.positions, strict=True)
        )
        ahead = motion.shape.positions[2] + drift * z
        beyond = ahead - jnp.clip(ahead, -z_max, z_max)
        z = z - push * stiffness / (1 + drift * push * stiffness) * beyond
        lengths = kept_of_lengths * motion.velocity.lengths - push_of_lengths * force.lengths
        return Shape((x, y, z), lengths)

    def once(number: Any, moving: tuple[Motion, Float[Array, ""]]) -> tuple[Motion, Any]:
        motion, power = moving
        active, last = number < count, number == count - 1
        taken = jnp.where(active, step, 0.0)
        shape = jax.tree.map(lambda at, rate: at + taken * rate, motion.shape, motion.velocity)
        force = gradient(shape)
        moved = Motion(
            shape,
            motion.velocity,
            motion.dissipated + taken * loss(body, motion.velocity),
            motion.supplied + taken / 2 * power,
        )
        whole = jnp.where(last, 0.0, 1.0)
        velocity = jax.tree.map(
            lambda new, old: jnp.where(active, new, old),
            kicked(moved, force, jnp.ones(()), whole, whole * step),
            motion.velocity,
        )
        power = driving_power(body, force, velocity)
        supplied = moved.supplied + taken / 2 * power
        return Motion(shape, velocity, moved.dissipated, supplied), power

    force = gradient(motion.shape)
    first = kicked(motion, force, jnp.zeros(()), jnp.ones(()), step)
    begin = Motion(motion.shape, first, motion.dissipated, motion.supplied)
    power = driving_power(body, force, first)
    moved, _ = jax.lax.fori_loop(0, longest, once, (begin, power))
    return moved


def runge_kutta(
    body: Body, motion: Motion, duration: Float[Array, ""], tolerances: tuple[float, float]
) -> tuple[Motion, Int[Array, ""], Bool[Array, ""]]:
    """Move a fabric by ``diffrax.Tsit5``, the paper's integrator, with adaptive steps.

    Args:
        body: the fabric.
        motion: its motion.
        duration: time [ms].
        tolerances: relative and absolute error of a step.

    Returns:
        The motion, the steps tried, and whether the end was reached.
    """
    import diffrax  # half as long to import as JAX, and the leapfrog does without

    def derivative(_: Any, motion: Motion, __: Any) -> Motion:
        force, velocity = body.fabric.gradient(motion.shape), motion.velocity
        push, (rate, rate_of_lengths) = body.per_mass(force), body.damping_rate
        x, y, z = (
            -by - rate * along for by, along in zip(push.positions, velocity.positions, strict=True)
        )
        return Motion(
            shape=velocity,
            velocity=Shape((x, y, z), -push.lengths - rate_of_lengths * velocity.lengths),
            dissipated=loss(body, velocity),
            supplied=driving_power(body, force, velocity),
        )

    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(derivative),
        diffrax.Tsit5(),
        t0=0.0,
        t1=duration,
        dt0=None,
        y0=motion,
        stepsize_controller=diffrax.PIDController(rtol=tolerances[0], atol=tolerances[1]),
        max_steps=1_000_000,
        adjoint=diffrax.ForwardMode(),
        throw=False,
    )
    end = jax.tree.map(lambda leaf: leaf[-1], solution.ys)
    reached = solution.result == diffrax.RESULTS.successful
    return end, solution.stats["num_steps"], reached


@lru_cache(maxsize=1)
def _programs() -> tuple[Callable[..., Any], ...]:
    """Compiled for a batch; JAX keeps a program for each mesh shape and size of batch."""
    return (
        jax.jit(jax.vmap(observed)),
        jax.jit(jax.vmap(leapfrog, in_axes=(0, 0, 0, 0, None))),
        jax.jit(jax.vmap(highest_frequency)),
        jax.jit(jax.vmap(runge_kutta, in_axes=(0, 0, 0, None))),
    )


@dataclass(frozen=True, eq=False)
class Moving:
    """A batch of fabrics in motion; arrays have one entry for each along their first axis.

    Attributes:
        body: the fabrics.
        motion: their motions.
        seen: energies and forces of these.
        mode: their shapes of highest frequency, from which the next search for it begins.
        time: since the beginning [ms].
        steps: time steps taken.
        kinetic_peak: largest kinetic energy seen since the last record [N mm].
        largest: largest mechanical energy seen [N mm].
        resting: which came to rest.
        diverged: which became unstable at the smallest step; they stay as they last were.
    """

    body: Body
    motion: Motion
    seen: Observed
    mode: Shape
    time: Float[np.ndarray, " case"]
    steps: Int[np.ndarray, " case"]
    kinetic_peak: Float[np.ndarray, " case"]
    largest: Float[np.ndarray, " case"]
    resting: Bool[np.ndarray, " case"]
    diverged: Bool[np.ndarray, " case"]

    @classmethod
    def from_rest(cls, bodies: Sequence[Body], shapes: Sequence[Shape]) -> "Moving":
        """Fabrics at rest, of one mesh shape."""
        stack = partial(jax.tree.map, lambda *leaves: jnp.stack(leaves))
        body, shape = stack(*bodies), stack(*shapes)
        motion = jax.vmap(Motion.at_rest)(shape)
        seen = _programs()[0](body, motion)
        random = np.random.default_rng(0)
        mode = jax.tree.map(
            lambda leaf: jnp.broadcast_to(random.normal(size=leaf.shape[1:]), leaf.shape), shape
        )
        none = np.zeros(len(bodies), dtype=bool)
        return cls(
            body=body,
            motion=motion,
            seen=seen,
            mode=mode,
            time=np.zeros(len(bodies)),
            steps=np.zeros(len(bodies), dtype=int),
            kinetic_peak=np.zeros(len(bodies)),
            largest=np.asarray(seen.energy.total),
            resting=none,
            diverged=none,
        )


def advance(
    moving: Moving,
    until: Float[np.ndarray, " case"],
    settings: DynamicsSettings,
    to_rest: bool = False,
) -> Moving:
    """Move a batch until given times.

    Args:
        moving: the batch.
        until: time of each fabric at which it stops [ms].
        settings: settings of the dynamics.
        to_rest: whether a fabric also stops when it is at rest, by ``settings.rest_force``.
    """
    rest = settings.rest_force if to_rest else -1.0
    moving = replace(moving, resting=np.zeros_like(moving.diverged))
    part = np.full(len(until), settings.step_safety)
    while True:
        still = np.maximum(np.asarray(moving.seen.force), np.asarray(moving.seen.drag)) <= rest
        moving = replace(moving, resting=moving.resting | still)
        going = (moving.time < until) & ~moving.resting & ~moving.diverged
        if not going.any():
            return moving
        left = np.where(going, until - moving.time, 0.0)
        if settings.integrator == "tsit5":
            moving = _by_runge_kutta(moving, left, settings)
        else:
            moving, part = _by_leapfrog(moving, left, part, settings.step_safety)


def largest_step(moving: Moving) -> Float[np.ndarray, " case"]:
    """Largest stable time step of the leapfrog as every fabric is now, 2/ω [ms]."""
    _, _, frequency, _ = _programs()
    iterations = np.full(len(moving.time), FIRST_ITERATIONS)
    square, _ = frequency(moving.body, moving.motion, moving.mode, iterations)
    return 2 / np.sqrt(np.asarray(square))


def _by_leapfrog(
    moving: Moving,
    left: Float[np.ndarray, " case"],
    part: Float[np.ndarray, " case"],
    largest_part: float,
) -> tuple[Moving, Float[np.ndarray, " case"]]:
    """A number of equal steps of those that have time left; unstable ones are undone.

    Args:
        moving: the batch.
        left: time that each has left, 0 where it stands still [ms].
        part: part of the stability limit that a step of each has.
        largest_part: the part that it has where nothing was unstable.

    Returns:
        The batch, and the part of the stability limit that a step of each is to have from now on.
    """
    observe, leap, frequency, _ = _programs()
    iterations = np.where(moving.steps > 0, MORE_ITERATIONS, FIRST_ITERATIONS)
    square, mode = frequency(moving.body, moving.motion, moving.mode, iterations)
    mode = jax.tree.map(partial(_chosen, left > 0), mode, moving.mode)
    step = part * 2 / np.sqrt(np.asarray(square))
    whole = np.maximum(np.ceil(left / step), 1.0)
    step = left / whole
    count = np.where(left > 0, np.minimum(whole, STEPS_AT_ONCE), 0).astype(int)
    motion = leap(moving.body, moving.motion, step, count, count.max())
    seen = observe(moving.body, motion)
    supplied = np.asarray(motion.supplied - moving.motion.supplied)
    before, after = (_mechanical_energy(its) for its in (moving.seen, seen))
    stable = after - supplied <= before + GROWTH * np.maximum(moving.largest, np.abs(supplied))
    if not stable.all():
        motion, seen = (
            jax.tree.map(partial(_chosen, stable), new, old)
            for new, old in ((motion, moving.motion), (seen, moving.seen))
        )
    count = np.where(stable, count, 0)
    part = np.where(stable, np.minimum(2 * part, largest_part), part / 2)
    moved = replace(
        moving,
        motion=motion,
        seen=seen,
        mode=mode,
        time=np.where(count == whole, moving.time + left, moving.time + count * step),
        steps=moving.steps + count,
        diverged=moving.diverged | (part < largest_part * 0.5**HALVINGS),
    )
    return _with_peaks(moved), part


def _by_runge_kutta(
    moving: Moving, left: Float[np.ndarray, " case"], settings: DynamicsSettings
) -> Moving:
    observe, _, _, solve = _programs()
    tolerances = settings.relative_tolerance, settings.absolute_tolerance
    # At rest is looked for after every part of the time.
    taken = np.minimum(left, RUNGE_KUTTA_TIME)
    motion, steps, reached = solve(moving.body, moving.motion, taken, tolerances)
    ok = np.asarray(reached) | (left == 0)
    if not ok.all():
        motion = jax.tree.map(partial(_chosen, ok), motion, moving.motion)
    moved = replace(
        moving,
        motion=motion,
        seen=observe(moving.body, motion),
        time=moving.time + np.where(ok, taken, 0.0),
        steps=moving.steps + np.where(left > 0, np.asarray(steps), 0),
        diverged=moving.diverged | ~ok,
    )
    return _with_peaks(moved)


def _mechanical_energy(seen: Observed) -> Float[np.ndarray, " case"]:
    return np.asarray(seen.kinetic) + np.asarray(seen.energy.total)


def _with_peaks(moving: Moving) -> Moving:
    return replace(
        moving,
        kinetic_peak=np.maximum(moving.kinetic_peak, np.asarray(moving.seen.kinetic)),
        largest=np.maximum(moving.largest, _mechanical_energy(moving.seen)),
    )


def _chosen(which: Bool[np.ndarray, " case"], new: Array, old: Array) -> Array:
    return jnp.where(which.reshape(-1, *[1] * (new.ndim - 1)), new, old)
