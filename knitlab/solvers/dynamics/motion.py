"""Damped motion of fabrics, M ü + c u̇ + ∇V = 0 (paper, equations of motion of Sec. "3D model").

Fabrics of one mesh shape move in one vmapped program, each with its own time step and end. Those
that have arrived stand still: a result does not depend on its batch.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float, Int
from scipy.sparse.linalg import LinearOperator, eigsh

from knitlab.model.energy import Energy
from knitlab.solvers.dynamics.contact_forces import Workspace, contact_forces
from knitlab.solvers.dynamics.contact_lists import ContactLists
from knitlab.solvers.dynamics.contact_pairs import PairFinder
from knitlab.solvers.dynamics.contact_potential import Contact
from knitlab.solvers.dynamics.grid import GridFabric, Shape
from knitlab.solvers.dynamics.settings import Dynamics

FIRST_ITERATIONS = 40  # iterations for the highest frequency of a fabric, the first time
HALVINGS = 12
"""Times that an unstable step is halved before the motion counts as diverged. Where a cell is
crushed to a line its hinges are stiff for a moment, which a step of 1/300 was seen to pass."""
ROUND_OFF = 1e-15  # energy that a flat sheet at rest may seem to gain [N mm]

OfCases = Float[np.ndarray, " case"]


class Body(eqx.Module):
    """A fabric with what makes it move."""

    fabric: GridFabric
    inverse: Shape  # 1/m of every coordinate and length, 0 if held, which keeps its velocity [1/g]
    damping: Float[Array, "*batch"]  # c of a node [g/ms]
    nodes_of_lengths: Float[Array, "*batch 2"]  # that L_x and L_y move
    contact: Contact | None = None  # with itself; None if it may pass through itself

    def energy_and_gradient(self, shape: Shape) -> tuple[Energy, Shape]:
        """Elastic energy in its parts [N mm], and its derivative, minus the force [N]."""
        energy = self.fabric.energy(shape)
        gradient = self.fabric.gradient(shape)
        if self.contact is None:
            return energy, gradient
        stored, by_nodes, by_lengths = self.contact.energy_and_gradient(*shape)
        touching = Shape(by_nodes, by_lengths)
        return replace(energy, contact=stored), jax.tree.map(jnp.add, gradient, touching)

    @property
    def damping_rate(self) -> Shape:
        """c/m of every coordinate and of the lengths [1/ms]."""
        of_nodes, of_lengths = self.inverse
        x, y, z = (self.damping * inverse for inverse in of_nodes)
        return Shape((x, y, z), self.damping * self.nodes_of_lengths * of_lengths)


class Motion(eqx.Module):
    """Configuration and velocity of a fabric, or of a batch, and the work done so far."""

    shape: Shape  # [mm]
    velocity: Shape  # [mm/ms]
    dissipated: Float[Array, "*batch"]  # work done against the drag and in collisions [N mm]
    supplied: Float[Array, "*batch"]  # work done on what is held [N mm]
    contact_work: Float[Array, "*batch"]  # work done by contact [N mm]

    @classmethod
    def at_rest(cls, shape: Shape) -> "Motion":
        """The beginning of a motion without velocity, or those of a batch."""
        still = jax.tree.map(lambda leaf: jnp.asarray(np.zeros(leaf.shape)), shape)
        none = jnp.asarray(np.zeros(shape.lengths.shape[:-1]))
        return cls(shape, still, none, none, none)


class Observed(eqx.Module):
    """Energies and forces of a motion at one time."""

    energy: Energy  # elastic [N mm]
    kinetic: Float[Array, ""]  # of what is free [N mm]
    gradient: Shape  # of the energy, minus the elastic force [N]
    force: Float[Array, ""]  # largest elastic force on a free node or length [N]
    drag: Float[Array, ""]  # largest drag on one [N]


def observed(body: Body, motion: Motion) -> Observed:
    """Energies and forces of a motion."""
    energy, gradient = body.energy_and_gradient(motion.shape)
    velocity = motion.velocity
    of_lengths = body.inverse.lengths

    def largest(vector: Shape, factor: Float[Array, "2"] | float) -> Float[Array, ""]:
        return jnp.maximum(
            jnp.sqrt(jnp.max(sum(_free_squares(body, vector)))),
            jnp.max(jnp.where(of_lengths > 0, jnp.abs(vector.lengths * factor), 0.0)),
        )

    def doubled_energy(inverse: Array, rate: Array) -> Array:
        mass = jnp.where(inverse > 0, 1 / jnp.where(inverse > 0, inverse, 1.0), 0.0)
        return jnp.sum(mass * rate**2)

    doubled = jax.tree.leaves(jax.tree.map(doubled_energy, body.inverse, velocity))
    return Observed(
        energy=energy,
        kinetic=0.5 * jnp.sum(jnp.stack(doubled)),
        gradient=gradient,
        force=largest(gradient, 1.0),
        drag=body.damping * largest(velocity, body.nodes_of_lengths),
    )


def driving_power(body: Body, gradient: Shape, velocity: Shape) -> Float[Array, ""]:
    """Power of the forces that move lengths, the top row or the last column [N mm/ms]."""

    def power(inverse: Array, force: Array, rate: Array, where: Any = ...) -> Float[Array, ""]:
        held = jnp.broadcast_to(inverse, force.shape)[where] == 0
        return jnp.sum(jnp.where(held, force[where] * rate[where], 0.0))

    if body.fabric.periodic:
        return power(body.inverse.lengths, gradient.lengths, velocity.lengths)
    nodes = zip(body.inverse.positions, gradient.positions, velocity.positions, strict=True)
    x, y, _ = nodes
    return power(*y, np.s_[-1]) + power(*x, np.s_[-1]) + power(*x, np.s_[:-1, -1])


def loss(body: Body, velocity: Shape) -> Float[Array, ""]:
    """Power of the drag, Σ c u̇² over what is free [N mm/ms]."""
    lengths = jnp.where(body.inverse.lengths > 0, body.nodes_of_lengths, 0.0)
    nodes = jnp.sum(sum(_free_squares(body, velocity)))
    return body.damping * (nodes + jnp.sum(lengths * velocity.lengths**2))


def _free_squares(body: Body, vector: Shape) -> list[Float[Array, "row column"]]:
    of_nodes = zip(body.inverse.positions, vector.positions, strict=True)
    return [jnp.where(inverse > 0, component**2, 0.0) for inverse, component in of_nodes]


def weighted_stiffness(body: Body, motion: Motion, vector: Shape) -> Shape:
    """M^(−1/2) K M^(−1/2) applied to a vector, without walls and contact [1/ms²]."""
    weighted = partial(jax.tree.map, lambda each, inverse: jnp.sqrt(inverse) * each)
    direction = weighted(vector, body.inverse)

    def gradient_at(length: Float[Array, ""]) -> Shape:
        shape = jax.tree.map(lambda at, by: at + length * by, motion.shape, direction)
        return body.fabric.gradient(shape, walls=False)

    # A forward derivative of the gradient takes six times as long as two gradients.
    size = jnp.stack([jnp.max(jnp.abs(leaf)) for leaf in jax.tree.leaves(direction)])
    length = 1e-6 / jnp.max(size)  # a central difference over as many mm
    ahead = gradient_at(length)
    behind = gradient_at(-length)
    image = jax.tree.map(lambda one, two: (one - two) / (2 * length), ahead, behind)
    return weighted(image, body.inverse)


def highest_frequency(
    body: Body, motion: Motion, mode: Shape, iterations: Int[Array, ""]
) -> tuple[Float[Array, ""], Shape]:
    """Square of the highest frequency [1/ms²] and its mode, by power iteration from near it."""

    def norm(vector: Shape) -> Float[Array, ""]:
        return jnp.sqrt(sum(jnp.sum(leaf**2) for leaf in jax.tree.leaves(vector)))

    def power_step(_: Any, last: tuple[Array, Shape]) -> tuple[Array, Shape]:
        image = weighted_stiffness(body, motion, last[1])
        size = norm(image)
        return size, jax.tree.map(lambda leaf: leaf / size, image)

    begin = jax.tree.map(lambda leaf: leaf / norm(mode), mode)
    return jax.lax.fori_loop(0, iterations, power_step, (jnp.zeros(()), begin))


def leapfrog(
    body: Body, motion: Motion, step: Array, count: Int[Array, ""], longest: Int[Array, ""]
) -> Motion:
    """Move a fabric by a number of equal steps [ms] of the leapfrog; by none if the step is 0.

    Drag and walls are diagonal and are integrated implicitly, contact partly so: a wall, or a pair
    in contact, acts with the force at the place to which the step leads. States at rest are those
    of the explicit scheme, and the stiffest parts do not limit the time step. ``longest`` is the
    largest number of steps in the batch; the fabric stands still after its own.
    """
    contact = body.contact
    stiffness = body.fabric.k_wall
    z_max = body.fabric.z_max
    half = jax.tree.map(lambda rate: step * rate / 2, body.damping_rate)
    whole = jax.tree.map(lambda inverse: step * inverse, body.inverse)

    def velocity_after(
        motion: Motion, before: Array, after: Array, workspace: Workspace | None
    ) -> tuple[Motion, Array, Workspace | None]:
        """Motion after a kick, the power of what is driven, and memory for the next kick.

        The kick is of ``before`` half steps up to now, and of ``after`` from now on.
        """
        force = body.fabric.gradient(motion.shape, walls=False)
        part = (before + after) / 2
        drift = after * step
        kept = jax.tree.map(lambda h: (1 - after * h) / (1 + before * h), half)
        push = jax.tree.map(
            lambda inverse, h: step * part * inverse / (1 + before * h), body.inverse, half
        )
        velocity = jax.tree.map(
            lambda kept, old, by, acting: kept * old - by * acting,
            *(kept, motion.velocity, push, force),
        )
        work = motion.contact_work
        if contact is not None and workspace is not None:
            free = jax.tree.map(lambda v, by, f: v - by * f, motion.velocity, whole, force)
            held, workspace = contact_forces(contact, motion.shape, free, whole, step, workspace)
            velocity = jax.tree.map(lambda v, by, f: v + by * f, velocity, push, held)
            force = jax.tree.map(jnp.subtract, force, held)
        (x, y, z) = velocity.positions
        (_, _, by) = push.positions
        ahead = motion.shape.positions[2] + drift * z
        beyond = ahead - jnp.clip(ahead, -z_max, z_max)
        z = z - by * stiffness / (1 + drift * by * stiffness) * beyond
        velocity = Shape((x, y, z), velocity.lengths)
        if contact is not None:
            doubled = jax.tree.map(jnp.add, motion.velocity, velocity)
            powers = jax.tree.map(lambda acting, rate: jnp.sum(acting * rate) / 2, held, doubled)
            work = work + step * part * sum(jax.tree.leaves(powers))
        moved = replace(motion, velocity=velocity, contact_work=work)
        return moved, driving_power(body, force, velocity), workspace

    def leapfrog_step(
        number: Any, moving: tuple[Motion, Array, Workspace | None]
    ) -> tuple[Motion, Array, Workspace | None]:
        """A drift and a kick, but at first half a kick alone, and half a kick at the end."""
        motion, power, workspace = moving
        first = number == 0
        active = number <= count
        last = number == count
        taken = jnp.where(active & ~first, step, 0.0)
        drifted = replace(
            motion,
            shape=jax.tree.map(lambda at, v: at + taken * v, motion.shape, motion.velocity),
            dissipated=motion.dissipated + taken * loss(body, motion.velocity),
            supplied=motion.supplied + taken / 2 * power,
        )
        before = jnp.where(first, 0.0, 1.0)
        after = jnp.where(last, 0.0, 1.0)
        moved, power, workspace = velocity_after(drifted, before, after, workspace)
        moved = replace(moved, supplied=moved.supplied + taken / 2 * power)
        moved = jax.tree.map(lambda new, old: jnp.where(active, new, old), moved, drifted)
        return moved, power, workspace

    workspace = None if contact is None else Workspace.of(contact)
    moved, _, _ = jax.lax.fori_loop(
        0, longest + 1, leapfrog_step, (motion, jnp.zeros(()), workspace)
    )
    return moved


def runge_kutta(
    body: Body, motion: Motion, duration: Float[Array, ""], tolerances: tuple[float, float]
) -> tuple[Motion, Int[Array, ""], Bool[Array, ""]]:
    """Move by ``diffrax.Tsit5``; returns motion, steps tried, and whether the end was reached."""
    import diffrax  # half as long to import as JAX, and the leapfrog does without

    def derivative(_: Any, motion: Motion, __: Any) -> Motion:
        _, force = body.energy_and_gradient(motion.shape)
        velocity = motion.velocity
        acceleration = jax.tree.map(
            lambda inverse, acting, rate, along: -(inverse * acting) - rate * along,
            *(body.inverse, force, body.damping_rate, velocity),
        )
        power = loss(body, velocity), driving_power(body, force, velocity)
        return Motion(velocity, acceleration, *power, jnp.zeros_like(motion.contact_work))

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


def _for_batch(function: Callable[..., Any], shared: int = 0) -> Callable[..., Any]:
    """A function of a body compiled for a batch of bodies; the last arguments may be shared."""

    @jax.jit
    def compiled(body: Body, *arguments: Any) -> Any:
        last = len(arguments) - shared
        if len(body.damping) == 1:
            # Without a batch, chunks of pairs that do not touch can be left out.
            alone = [jax.tree.map(lambda leaf: leaf[0], each) for each in arguments[:last]]
            only = jax.tree.map(lambda leaf: leaf[0] if jnp.ndim(leaf) else leaf, body)
            found = function(only, *alone, *arguments[last:])
            return jax.tree.map(lambda leaf: jnp.asarray(leaf)[None], found)
        own: Any = jax.tree.map(lambda _: 0, body)
        if body.contact is not None:
            own = eqx.tree_at(lambda axes: axes.contact.chunks, own, None)
        axes = [0] * last + [None] * shared
        return jax.vmap(function, in_axes=(own, *axes))(body, *arguments)

    return compiled


_observe = _for_batch(observed)
_leap = _for_batch(leapfrog, shared=1)
_highest_frequencies = _for_batch(highest_frequency)
_runge_kutta = _for_batch(runge_kutta, shared=1)


@dataclass(frozen=True, eq=False)
class Moving:
    """A batch of fabrics in motion; arrays have one entry for each along their first axis."""

    body: Body
    motion: Motion
    seen: Observed  # energies and forces of the motions
    mode: Shape  # of highest frequency, from which the next search for it begins
    time: OfCases  # since the beginning [ms]
    steps: Int[np.ndarray, " case"]
    kinetic_peak: OfCases  # largest since the last record [N mm]
    largest: OfCases  # mechanical energy seen [N mm]
    resting: Bool[np.ndarray, " case"]
    diverged: Bool[np.ndarray, " case"]  # unstable at the smallest step
    touching: ContactLists | None = None  # if the fabrics can touch themselves
    development: "Development | None" = None  # of the folds, if they are not there at once

    @classmethod
    def from_rest(
        cls, bodies: Sequence[Body], shapes: Sequence[Shape], finders: Sequence[PairFinder] = ()
    ) -> "Moving":
        """Fabrics at rest, of one mesh shape; ``finders`` of what touches if they have contact."""
        # In NumPy, for which nothing is compiled.
        stack = partial(jax.tree.map, lambda *leaves: jnp.asarray(np.stack(leaves)))
        body = stack(*bodies)
        shape = stack(*shapes)
        touching = None
        if finders:
            touching = ContactLists.at(finders, shape)
            body = replace(body, contact=touching.contact)
        motion = Motion.at_rest(shape)
        seen = _observe(body, motion)
        random = np.random.default_rng(0)
        mode = jax.tree.map(
            lambda leaf: jnp.asarray(
                np.broadcast_to(random.normal(size=leaf.shape[1:]), leaf.shape)
            ),
            shape,
        )
        none = np.zeros(len(bodies))
        no = none.astype(bool)
        energy = np.asarray(seen.energy.total)
        steps = none.astype(int)
        return cls(body, motion, seen, mode, none, steps, none, energy, no, no, touching)


def advance(moving: Moving, until: OfCases, settings: Dynamics, to_rest: bool = False) -> Moving:
    """Move a batch until given times [ms], or until each is at rest by ``rest_force``."""
    rest = settings.rest_force if to_rest else -1.0
    moving = replace(moving, resting=np.zeros_like(moving.diverged))
    fraction = np.full(len(until), settings.step_safety)
    most = np.full(len(until), 32)
    while True:
        still = np.maximum(np.asarray(moving.seen.force), np.asarray(moving.seen.drag)) <= rest
        if moving.development is not None:
            still &= moving.time >= moving.development.until
        moving = replace(moving, resting=moving.resting | still)
        going = (moving.time < until) & ~moving.resting & ~moving.diverged
        if not going.any():
            return moving
        left = np.where(going, until - moving.time, 0.0)
        moving = _developed(moving)
        if settings.integrator == "tsit5":
            moving = _runge_kutta_batch(moving, left, settings)
        else:
            moving, fraction, most = _leapfrog_batch(
                moving, left, fraction, settings.step_safety, most
            )
        moving = replace(
            moving,
            kinetic_peak=np.maximum(moving.kinetic_peak, np.asarray(moving.seen.kinetic)),
            largest=np.maximum(moving.largest, _mechanical_energy(moving.seen)),
        )


class Development(NamedTuple):
    """The growth of rest angles from flat."""

    until: OfCases  # [ms]
    rest: tuple[Float[Array, "case row column"], ...]  # angles at its end, by hinges [rad]


def developing(moving: Moving, duration: OfCases) -> Moving:
    """A batch at its beginning, with rest angles that grow evenly from flat in some time [ms]."""
    rest = tuple(hinges.rest for hinges in moving.body.fabric.hinges)
    return _developed(replace(moving, development=Development(duration, rest)))


def _developed(moving: Moving) -> Moving:
    """The batch with the rest angles of its time; the work of their change is supplied."""
    if moving.development is None:
        return moving
    until, rest = moving.development
    part = jnp.asarray(np.minimum(moving.time / until, 1.0)).reshape(-1, 1, 1)
    hinges = tuple(
        eqx.tree_at(lambda each: each.rest, own, part * full)
        for own, full in zip(moving.body.fabric.hinges, rest, strict=True)
    )
    body = eqx.tree_at(lambda body: body.fabric.hinges, moving.body, hinges)
    seen = _observe(body, moving.motion)
    work = seen.energy.total - moving.seen.energy.total
    motion = replace(moving.motion, supplied=moving.motion.supplied + work)
    development = None if (moving.time >= until).all() else moving.development
    return replace(moving, body=body, seen=seen, motion=motion, development=development)


def largest_step(moving: Moving) -> OfCases:
    """Largest stable time step of every fabric without walls and contact, 2/ω, to 1e-4 [ms]."""
    batch = replace(moving.body, contact=None), moving.motion, moving.mode

    def highest_square(case: int) -> float:
        body, motion, mode = jax.tree.map(lambda leaf: leaf[case : case + 1], batch)
        begin, unraveled = ravel_pytree(mode)

        def image(vector: Float[np.ndarray, " unknown"]) -> Float[np.ndarray, " unknown"]:
            # One power iteration, whose program is there.
            size, found = _highest_frequencies(
                body, motion, unraveled(jnp.asarray(vector)), np.array([1])
            )
            return np.asarray(size * np.linalg.norm(vector)) * np.asarray(ravel_pytree(found)[0])

        operator = LinearOperator((len(begin), len(begin)), matvec=image, dtype=float)
        start = np.asarray(begin)
        return eigsh(operator, 1, which="LA", v0=start, tol=1e-3, return_eigenvectors=False)[0]

    return 2 / np.sqrt([highest_square(case) for case in range(len(moving.time))])


def _leapfrog_batch(
    moving: Moving, left: OfCases, fraction: OfCases, safety: float, most: Int[np.ndarray, " case"]
) -> tuple[Moving, OfCases, Int[np.ndarray, " case"]]:
    """Equal steps at a ``fraction`` of the stability limit, as many as lists of pairs allow."""
    iterations = np.where(moving.steps > 0, 4, FIRST_ITERATIONS)
    bare = replace(moving.body, contact=None)
    square, mode = _highest_frequencies(bare, moving.motion, moving.mode, iterations)
    step = fraction * 2 / np.sqrt(np.asarray(square))
    whole = np.maximum(np.ceil(left / step), 1.0)
    step = left / whole
    # After some steps step size, energy and forces are looked at again, and folds developed.
    some = 256 if moving.development is None else 64
    count = np.where(left > 0, np.minimum(whole, some), 0).astype(int)
    if moving.touching is not None:
        touching, count = moving.touching.covering(
            moving.motion.shape, moving.motion.velocity, step, np.minimum(count, most)
        )
        body = replace(moving.body, contact=touching.contact)
        moving = replace(moving, touching=touching, body=body)
    motion = _leap(moving.body, moving.motion, step, count, count.max())
    seen = _observe(moving.body, motion)
    supplied = np.asarray(motion.supplied - moving.motion.supplied)
    # A step was unstable if the energy grew by more than this fraction of the largest.
    grown = 0.02 * np.maximum(moving.largest, np.abs(supplied)) + ROUND_OFF
    stable = _mechanical_energy(seen) - supplied <= _mechanical_energy(moving.seen) + grown
    done = stable
    if moving.touching is not None:
        # What contact has not given back of its work is lost in collisions.
        stored = np.asarray(seen.energy.contact) - np.asarray(moving.seen.energy.contact)
        lost = -(stored + np.asarray(motion.contact_work - moving.motion.contact_work))
        motion = replace(motion, dissipated=motion.dissipated + lost)
        touching, missed = moving.touching.missed(motion.shape)
        done = stable & ~missed
        touching = replace(touching, now=np.where(done, touching.now, moving.touching.now))
        moving = replace(moving, touching=touching)
        stable = done | (stable & (count > 1))
        most = np.where(done, np.minimum(2 * count, 256), np.maximum(count // 2, 1))
    count = np.where(done, count, 0)
    fraction = np.where(stable, np.minimum(2 * fraction, safety), fraction / 2)
    moving = replace(
        moving,
        motion=_select_cases(done, motion, moving.motion),
        seen=_select_cases(done, seen, moving.seen),
        mode=_select_cases(left > 0, mode, moving.mode),
        time=np.where(count == whole, moving.time + left, moving.time + count * step),
        steps=moving.steps + count,
        diverged=moving.diverged | (fraction < safety * 0.5**HALVINGS),
    )
    return moving, fraction, most


def _runge_kutta_batch(moving: Moving, left: OfCases, settings: Dynamics) -> Moving:
    tolerances = settings.relative_tolerance, settings.absolute_tolerance
    # Every millisecond the fabric is looked at, whether it is at rest.
    taken = np.minimum(left, 1.0)
    motion, steps, reached = _runge_kutta(moving.body, moving.motion, taken, tolerances)
    ok = np.asarray(reached) | (left == 0)
    motion = _select_cases(ok, motion, moving.motion)
    return replace(
        moving,
        motion=motion,
        seen=_observe(moving.body, motion),
        time=moving.time + np.where(ok, taken, 0.0),
        steps=moving.steps + np.where(left > 0, np.asarray(steps), 0),
        diverged=moving.diverged | ~ok,
    )


def _mechanical_energy(seen: Observed) -> OfCases:
    return np.asarray(seen.kinetic) + np.asarray(seen.energy.total)


def _select_cases(which: Bool[np.ndarray, " case"], new: Any, old: Any) -> Any:
    if which.all():
        return new
    return jax.tree.map(
        lambda one, other: jnp.where(which.reshape(-1, *[1] * (one.ndim - 1)), one, other), new, old
    )
