"""Damped Lagrangian dynamics, M ü + c u̇ + ∇V = 0, by ``diffrax.Tsit5`` (paper, Sec. "3D model").

One program is compiled for each mesh shape and integrates a batch of fabrics in one call; each
fabric has its own step size and end time, independent of the others.
"""

from collections.abc import Callable
from dataclasses import fields
from functools import lru_cache, partial
from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from knitlab.mechanics.dynamics_settings import DynamicsSettings
from knitlab.model.configuration import Configuration
from knitlab.model.energy import Energy, energy
from knitlab.model.fabric import Fabric
from knitlab.model.inertia import Inertia, drag, kinetic_energy, lagrangian, moved_mass
from knitlab.model.network import MeshShape, Network, network


class Motion(eqx.Module):
    """Configuration and velocity of a fabric.

    Attributes:
        unknowns: configuration, flattened [mm].
        velocity: velocity of the unknowns [mm/ms].
        dissipated: work done against the drag since the start [N mm].
        supplied: work done on the held unknowns since the start [N mm].
    """

    unknowns: Float[Array, "*batch unknown"]
    velocity: Float[Array, "*batch unknown"]
    dissipated: Float[Array, "*batch"]
    supplied: Float[Array, "*batch"]


class PrescribedMotion(eqx.Module):
    """Free unknowns, and the prescribed motion of the held ones from one strain to the next.

    The strain goes from ``before`` to ``after`` within ``ramp_time``, starting and ending with rate
    0, and then stays constant.

    Attributes:
        free: which unknowns are free.
        reference: unknowns at zero applied strain [mm].
        direction: displacement of each unknown per unit of applied strain, if held [mm].
        before, after: applied strains.
        ramp_time: duration of the change [ms].
        ended: whether the test of this fabric has ended; it then only fills its place in the
            batch.
    """

    free: Bool[Array, "*batch unknown"]
    reference: Float[Array, "*batch unknown"]
    direction: Float[Array, "*batch unknown"]
    before: Float[Array, "*batch"]
    after: Float[Array, "*batch"]
    ramp_time: Float[Array, "*batch"]
    ended: Bool[Array, "*batch"]

    def strain(self, time: Float[Array, ""]) -> Float[Array, ""]:
        """Applied strain at a time of one fabric."""
        part = jnp.where(
            self.ramp_time > 0, time / jnp.where(self.ramp_time > 0, self.ramp_time, 1), 1
        )
        part = jnp.clip(part, 0, 1)
        return self.before + (self.after - self.before) * part**2 * (3 - 2 * part)

    def holding(self, time: Float[Array, ""], motion: Motion) -> Motion:
        """The motion with positions and velocities of the held unknowns as prescribed."""
        strain, rate = jax.jvp(self.strain, (time,), (jnp.ones_like(time),))
        placed = self.reference + strain * self.direction
        return eqx.tree_at(
            lambda moving: (moving.unknowns, moving.velocity),
            motion,
            (
                jnp.where(self.free, motion.unknowns, placed),
                jnp.where(self.free, motion.velocity, rate * self.direction),
            ),
        )


PEAK_OF_SMOOTH_RAMP = 1.5
"""Largest over mean rate of the ramp."""


def forces(
    net: Network, fabric: Fabric, inertia: Inertia, motion: Motion
) -> tuple[Float[Array, " unknown"], Float[Array, " unknown"]]:
    """Elastic force ∂L/∂u and drag −c u̇ on every unknown [N]."""
    configuration, velocity = (
        Configuration.of(vector, net.shape) for vector in (motion.unknowns, motion.velocity)
    )
    elastic = jax.grad(lagrangian, argnums=3)(net, fabric, inertia, configuration, velocity)
    viscous = jnp.asarray(drag(net, inertia, velocity).flattened())
    return elastic.flattened(), -viscous


def largest_force(
    net: Network, fabric: Fabric, inertia: Inertia, drive: PrescribedMotion, motion: Motion
) -> Float[Array, ""]:
    """Largest elastic force or drag on a free node or length, which vanishes at rest [N].

    Forces on nodes are taken by magnitude, which does not depend on orientation.
    """
    pair = jnp.stack(forces(net, fabric, inertia, motion))
    left = Configuration.of(jnp.where(drive.free, pair, 0.0), net.shape)
    on_nodes = jnp.linalg.norm(left.positions, axis=-1)
    return jnp.maximum(on_nodes.max(), jnp.abs(left.lengths).max())


def equations_of_motion(
    net: Network,
    fabric: Fabric,
    inertia: Inertia,
    drive: PrescribedMotion,
    time: Array,
    motion: Motion,
) -> Motion:
    """Time derivative of a motion (paper, equations of motion)."""
    moving = drive.holding(time, motion)
    elastic, viscous = forces(net, fabric, inertia, moving)
    acceleration = (elastic + viscous) / moved_mass(net.shape, inertia).flattened()
    return Motion(
        unknowns=jnp.where(drive.free, moving.velocity, 0.0),
        velocity=jnp.where(drive.free, acceleration, 0.0),
        dissipated=-jnp.sum(jnp.where(drive.free, viscous * moving.velocity, 0.0)),
        supplied=-jnp.sum(jnp.where(drive.free, 0.0, elastic * moving.velocity)),
    )


class Energies(eqx.Module):
    """Energies of a motion at one time; kinetic + potential + dissipated − supplied is constant.

    Attributes:
        kinetic: T of the free unknowns [N mm].
        potential: V [N mm].
        dissipated, supplied: as in :class:`Motion` [N mm].
    """

    kinetic: Float[Array, "*batch"]
    potential: Float[Array, "*batch"]
    dissipated: Float[Array, "*batch"]
    supplied: Float[Array, "*batch"]


class Trajectory(eqx.Module):
    """The recorded motion of a fabric; times after its end are infinite.

    Attributes:
        end: the motion at its end.
        end_time: time of the end [ms].
        energy: elastic energy at the end, in its parts.
        gradient: ∂V/∂(unknowns) at the end [N].
        force_left: largest elastic force or drag on a free node or length at the end [N].
        time: times of ``energies`` [ms].
        energies: recorded energies.
        snapshot_time: times of ``snapshots`` [ms].
        snapshots: recorded unknowns [mm].
        steps: time steps tried.
        successful, steady, step_limit: why diffrax ended: at the last time, at rest, or at the
            largest number of steps; if none of these, the step size vanished.
    """

    end: Motion
    end_time: Float[Array, "*batch"]
    energy: Energy
    gradient: Float[Array, "*batch unknown"]
    force_left: Float[Array, "*batch"]
    time: Float[Array, "*batch time"]
    energies: Energies
    snapshot_time: Float[Array, "*batch snapshot"]
    snapshots: Float[Array, "*batch snapshot unknown"]
    steps: Int[Array, "*batch"]
    successful: Bool[Array, "*batch"]
    steady: Bool[Array, "*batch"]
    step_limit: Bool[Array, "*batch"]


SMALLEST_STEP = 1e-9
"""Time step below which a motion counts as diverged [ms]."""


class IntegratorNumbers(eqx.Module):
    """The numeric settings, which JAX traces, so that changing one does not recompile."""

    steady_force: Float[Array, ""]
    relative_tolerance: Float[Array, ""]
    absolute_tolerance: Float[Array, ""]
    time_step: Float[Array, ""]
    settling_time: Float[Array, ""]

    @classmethod
    def of(cls, settings: DynamicsSettings) -> "IntegratorNumbers":
        """The numeric settings of some settings."""
        return cls(*(jnp.asarray(getattr(settings, field.name)) for field in fields(cls)))


def integrate(
    net: Network,
    steady_ending: bool,
    max_steps: int,
    settings: IntegratorNumbers,
    fabric: Fabric,
    inertia: Inertia,
    drive: PrescribedMotion,
    start: Motion,
    times: Float[Array, " time"],
    snapshot_times: Float[Array, " snapshot"],
) -> Trajectory:
    """Motion of one fabric from ``start`` at time 0.

    Args:
        net: network of its mesh shape.
        steady_ending: whether the motion ends at rest, rather than after equal steps.
        max_steps: largest number of time steps.
        settings: numeric settings of the integration.
        fabric: the fabric.
        inertia: its mass and drag.
        drive: motion of the held unknowns.
        start: initial motion.
        times: times at which to record the energies, ascending [ms].
        snapshot_times: times at which to record the configuration, ascending [ms].
    """

    def derivative(time: Any, motion: Motion, _: Any) -> Motion:
        return equations_of_motion(net, fabric, inertia, drive, time, motion)

    def over(time: Array, motion: Motion, _: Any, **__: Any) -> Bool[Array, ""]:
        if not steady_ending:
            return drive.ended
        moving = drive.holding(time, motion)
        left = largest_force(net, fabric, inertia, drive, moving)
        return drive.ended | ((time >= drive.ramp_time) & (left <= settings.steady_force))

    def energies(time: Array, motion: Motion, _: Any) -> Energies:
        moving = drive.holding(time, motion)
        free = jnp.where(drive.free, moving.velocity, 0.0)
        return Energies(
            kinetic=kinetic_energy(net, inertia, Configuration.of(free, net.shape)),
            potential=energy(net, fabric, Configuration.of(moving.unknowns, net.shape)).total,
            dissipated=motion.dissipated,
            supplied=motion.supplied,
        )

    def unknowns(time: Array, motion: Motion, _: Any) -> Float[Array, " unknown"]:
        return drive.holding(time, motion).unknowns

    controller: diffrax.AbstractStepSizeController = (
        diffrax.PIDController(
            rtol=settings.relative_tolerance,
            atol=settings.absolute_tolerance,
            dtmin=SMALLEST_STEP,
            force_dtmin=False,
        )
        if steady_ending
        else diffrax.ConstantStepSize()
    )
    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(derivative),
        diffrax.Tsit5(),
        t0=0.0,
        t1=drive.ramp_time + settings.settling_time,
        dt0=settings.time_step,
        y0=start,
        saveat=diffrax.SaveAt(
            subs=(
                diffrax.SubSaveAt(t1=True, fn=lambda time, motion, _: drive.holding(time, motion)),
                diffrax.SubSaveAt(ts=times, fn=energies),
                diffrax.SubSaveAt(ts=snapshot_times, fn=unknowns),
            )
        ),
        stepsize_controller=controller,
        event=diffrax.Event(over),
        max_steps=max_steps,
        adjoint=diffrax.ForwardMode(),
        throw=False,
    )
    (end_time, time, snapshot_time), (ends, kept, snapshots) = solution.ts, solution.ys
    end = jax.tree.map(lambda leaf: leaf[-1], ends)
    elastic, _ = forces(net, fabric, inertia, end)
    return Trajectory(
        end=end,
        end_time=end_time[-1],
        energy=energy(net, fabric, Configuration.of(end.unknowns, net.shape)),
        gradient=-elastic,
        force_left=largest_force(net, fabric, inertia, drive, end),
        time=time,
        energies=kept,
        snapshot_time=snapshot_time,
        snapshots=snapshots,
        steps=solution.stats["num_steps"],
        successful=solution.result == diffrax.RESULTS.successful,
        steady=solution.result == diffrax.RESULTS.event_occurred,
        step_limit=solution.result == diffrax.RESULTS.max_steps_reached,
    )


Integrator = Callable[
    [
        Fabric,
        Inertia,
        PrescribedMotion,
        Motion,
        Float[Array, "case time"],
        Float[Array, "case snapshot"],
    ],
    Trajectory,
]


def batch_integrator(shape: MeshShape, settings: DynamicsSettings) -> Integrator:
    """Compiled :func:`integrate` for a batch: fabrics, motions and times stacked along axis 0."""
    compiled = _compiled(shape, settings.ending == "steady", settings.max_steps)
    return partial(compiled, IntegratorNumbers.of(settings))


@lru_cache(maxsize=8)
def _compiled(shape: MeshShape, steady_ending: bool, max_steps: int) -> Callable[..., Trajectory]:
    def one(settings: IntegratorNumbers, *arguments: Any) -> Trajectory:
        return integrate(network(shape), steady_ending, max_steps, settings, *arguments)

    over_settings_once = (None, *[0] * 6)
    return jax.jit(jax.vmap(one, in_axes=over_settings_once))
