"""Relaxation and tensile test by damped dynamics, for a batch of fabrics of one mesh shape."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from knitlab.dynamics.body import Body, Observed
from knitlab.dynamics.grid import GridFabric, Shape
from knitlab.dynamics.motion import Moving, advance, largest_step
from knitlab.dynamics.settings import DynamicsSettings
from knitlab.equilibrium.loading import (
    Loading,
    all_free,
    between_walls,
    free_under_tension,
    rigidly_aligned,
    tensile,
)
from knitlab.equilibrium.state import Outcome, State
from knitlab.equilibrium.tensile_result import History, TensileTest
from knitlab.fabric.configuration import Configuration
from knitlab.fabric.energy import Energy
from knitlab.fabric.fabric import Fabric, flat_sheet
from knitlab.fabric.inertia import Inertia, moved_mass
from knitlab.fabric.network import MeshShape, network

FIRST_RECORD = 0.01
"""Time of the first record of a relaxation after its beginning [ms]."""
RECORDS = 40
"""Records of a relaxation of which no configurations are kept."""

Progress = Callable[[int, float], None]
"""Function of the index in a batch and of the number of finished states, with a fraction."""


def no_progress(case: int, states: float) -> None:
    """Report nothing."""


@dataclass(frozen=True, eq=False)
class MovingFabrics:
    """Fabrics of one mesh shape that move together.

    Attributes:
        shape: the mesh shape.
        fabrics: the fabrics.
        inertias: their masses and drags.
        settings: settings of the dynamics.
    """

    shape: MeshShape
    fabrics: Sequence[Fabric]
    inertias: Sequence[Inertia]
    settings: DynamicsSettings

    def bodies(self, clamped: bool) -> list[Body]:
        """The fabrics as bodies, free or with what a tensile test holds held."""
        return [
            _body(self.shape, fabric, inertia, clamped)
            for fabric, inertia in zip(self.fabrics, self.inertias, strict=True)
        ]


@dataclass(frozen=True, eq=False)
class Relaxed:
    """The end of a relaxation.

    Attributes:
        configuration: its shape, aligned for clamping if the fabric is a sample [mm].
        history: energies on the way.
        strain_rate: rate at which a test by dynamics is to pull it [1/ms].
        steps: time steps.
        outcome: ``converged`` at rest or after the given time, else why not.
    """

    configuration: Configuration
    history: History
    strain_rate: float
    steps: int
    outcome: Outcome


def relax_by_dynamics(
    fabrics: MovingFabrics,
    progress: Progress = no_progress,
    sheets: Sequence[Configuration | None] | None = None,
) -> list[Relaxed]:
    """Release flat sheets at rest and let them fold (paper, Sec. "Relaxation of a pattern").

    A sheet moves until it is at rest, or for a given time, as ``settings.ending`` says. A sample is
    rotated rigidly then, so that the rows that are to be clamped match those of its flat sheet.

    Args:
        fabrics: the fabrics.
        progress: called with the index of a fabric and which part of its relaxation is done.
        sheets: what is released in place of each flat sheet, such as an imperfect one [mm].
    """
    shape, settings = fabrics.shape, fabrics.settings
    flat = [flat_sheet(network(shape), fabric) for fabric in fabrics.fabrics]
    released = [given or sheet for given, sheet in zip(sheets or flat, flat, strict=True)]
    moving = Moving.from_rest(fabrics.bodies(clamped=False), [on_grid(sheet) for sheet in released])
    first_force = np.asarray(moving.seen.force)
    to_rest = settings.ending == "rest"
    stable = largest_step(moving)
    longest = {
        "rest": np.full(len(flat), settings.longest_time),
        "time": np.full(len(flat), settings.relax_time),
        "steps": settings.relax_steps * stable,
    }[settings.ending]
    rate = settings.strain_rate / np.ones(len(flat))
    if settings.ending == "steps":
        rate = settings.step_strain / stable
    # The last is the end, even if it is the only one or if all is over before the first.
    count = settings.snapshots or RECORDS
    times = np.geomspace(longest, np.minimum(FIRST_RECORD, longest), count)[::-1]
    records = [[_Record.of(moving, case)] for case in range(len(flat))]
    for number, time in enumerate(times):
        moving = advance(moving, time, settings, to_rest)
        for case, own in enumerate(records):
            if moving.time[case] > own[-1].time:
                own.append(_Record.of(moving, case))
            progress(case, (number + 1) / (len(times) + 1))
        if (moving.resting | moving.diverged).all():
            break
    found = []
    for case, (sheet, fabric, own) in enumerate(zip(flat, fabrics.fabrics, records, strict=True)):
        if moving.diverged[case]:
            outcome = Outcome.diverged
        elif to_rest and not moving.resting[case]:
            outcome = Outcome.time_limit
        else:
            outcome = Outcome.converged
        folded = own[-1].configuration
        if not shape.periodic:
            aligned = rigidly_aligned(shape, sheet, folded)
            folded = between_walls(aligned, float(fabric.z_max))
        first, left = float(first_force[case]), float(moving.seen.force[case])
        found.append(
            Relaxed(
                configuration=folded,
                history=_history(own, left / first if first else 0.0, settings.snapshots > 0),
                strain_rate=float(rate[case]),
                steps=int(moving.steps[case]),
                outcome=outcome,
            )
        )
    return found


def stretch_by_dynamics(
    fabrics: MovingFabrics,
    applied_strain: Sequence[Sequence[float]],
    progress: Progress = no_progress,
) -> list[TensileTest]:
    """Relax flat sheets, then pull them (paper, Sec. "Kinematics under tension").

    The pull begins from rest: what is left of the motion of the relaxation is taken away, as when
    the test is a simulation of its own. With ``settings.ending = "rest"`` the fabric comes to rest
    at every applied strain; with ``"time"`` it is pulled without a pause, and its states are not
    equilibria.

    Args:
        fabrics: the fabrics.
        applied_strain: strains of each fabric, ascending from 0, of equal number.
        progress: called with the index of a fabric and the number of its finished states.
    """
    shape, settings = fabrics.shape, fabrics.settings
    relaxed = relax_by_dynamics(fabrics, progress)
    loadings = [tensile(shape, its.configuration) for its in relaxed]
    starts = [on_grid(its.configuration) for its in relaxed]
    moving = Moving.from_rest(fabrics.bodies(clamped=True), starts)
    failed = np.array([its.outcome is not Outcome.converged for its in relaxed])
    moving = replace(moving, diverged=failed)
    to_rest = settings.ending == "rest"
    states = [[_relaxed_state(shape, moving, case, its)] for case, its in enumerate(relaxed)]
    strains, rate = np.array(applied_strain), np.array([its.strain_rate for its in relaxed])
    waited = np.zeros(len(relaxed))
    for number in range(1, strains.shape[1]):
        steps, began = moving.steps, moving.time
        moving = replace(_driven(moving, loadings, rate), kinetic_peak=0 * began)
        arrival = waited + strains[:, number] / rate
        moving = advance(moving, arrival, settings)
        if to_rest:
            moving = _driven(moving, loadings, np.zeros(len(relaxed)))
            moving = advance(moving, arrival + settings.longest_time, settings, to_rest=True)
            waited = waited + moving.time - arrival
        for case, own in enumerate(states):
            if own[-1].outcome is not Outcome.converged:
                continue
            outcome = Outcome.converged
            if moving.diverged[case]:
                outcome = Outcome.diverged
            elif to_rest and not moving.resting[case]:
                outcome = Outcome.time_limit
            state = _state(shape, moving, case, free_under_tension(shape), outcome)
            taken = int(moving.steps[case] - steps[case])
            own.append(
                replace(state, iterations=taken, kinetic_peak=float(moving.kinetic_peak[case]))
            )
            progress(case, number + 1)
        ended = [own[-1].outcome is not Outcome.converged for own in states]
        moving = replace(moving, diverged=moving.diverged | ended)
    return [
        TensileTest(loading if own[0].converged else None, own, history=its.history)
        for loading, own, its in zip(loadings, states, relaxed, strict=True)
    ]


def _body(shape: MeshShape, fabric: Fabric, inertia: Inertia, clamped: bool) -> Body:
    mass = moved_mass(shape, inertia)
    uniform = jnp.ndim(inertia.node_mass) == 0
    inverse = 1 / np.asarray(mass.positions)[:, : 1 if uniform else None, 0]
    lengths = 1 / np.asarray(mass.lengths) if shape.periodic else np.zeros(2)
    if clamped and shape.periodic:
        lengths[1] = 0.0
    elif clamped:
        inverse[[0, -1]] = 0.0
    return Body(
        GridFabric.of(shape, fabric),
        jnp.asarray(inverse),
        jnp.asarray(lengths),
        jnp.asarray(inertia.damping),
        jnp.array([shape.nodes_y, shape.nodes_x], float),
    )


def on_grid(configuration: Configuration) -> Shape:
    """A configuration as the dynamics hold it."""
    x, y, z = np.moveaxis(np.asarray(configuration.positions), -1, 0)
    return Shape(
        (jnp.asarray(x), jnp.asarray(y), jnp.asarray(z)), jnp.asarray(configuration.lengths)
    )


def configuration_of(shape: Shape, case: int) -> Configuration:
    """The configuration of one fabric of a batch."""
    positions = np.stack([np.asarray(part[case]) for part in shape.positions], axis=-1)
    return Configuration(positions, np.asarray(shape.lengths[case]))


def _driven(
    moving: Moving, loadings: Sequence[Loading], rate: Float[np.ndarray, " case"]
) -> Moving:
    """The batch, with what is held moving at rates of the applied strain [1/ms]."""
    velocity = moving.motion.velocity
    own = rate * np.array([loading.length for loading in loadings])
    if moving.body.fabric.periodic:
        velocity = velocity._replace(lengths=velocity.lengths.at[:, 1].set(own))
    else:
        x, y, z = velocity.positions
        velocity = velocity._replace(positions=(x, y.at[:, -1].set(own[:, None]), z))
    return replace(moving, motion=replace(moving.motion, velocity=velocity))


def _state(
    shape: MeshShape, moving: Moving, case: int, free: Int[np.ndarray, " free"], outcome: Outcome
) -> State:
    seen: Observed = jax.tree.map(lambda leaf: np.asarray(leaf[case]), moving.seen)
    gradient = Configuration(np.stack(seen.gradient.positions, axis=-1), seen.gradient.lengths)
    unknowns = np.asarray(configuration_of(moving.motion.shape, case).flattened())
    forces = np.asarray(gradient.flattened())
    return State(
        shape=shape,
        unknowns=unknowns,
        energy=Energy(seen.energy.stretch, seen.energy.fold, seen.energy.wall),
        gradient=forces,
        outcome=outcome,
        residual=float(np.abs(forces[free]).max()),
        iterations=0,
    )


def _relaxed_state(shape: MeshShape, moving: Moving, case: int, relaxed: Relaxed) -> State:
    state = _state(shape, moving, case, all_free(shape), relaxed.outcome)
    peak = float(relaxed.history.kinetic.max())
    return replace(state, iterations=relaxed.steps, kinetic_peak=peak)


@dataclass(frozen=True, eq=False)
class _Record:
    """A fabric at one time of its relaxation; energies as in :class:`History`."""

    time: float
    kinetic: float
    potential: float
    dissipated: float
    configuration: Configuration

    @classmethod
    def of(cls, moving: Moving, case: int) -> "_Record":
        return cls(
            time=float(moving.time[case]),
            kinetic=float(moving.seen.kinetic[case]),
            potential=float(moving.seen.energy.total[case]),
            dissipated=float(moving.motion.dissipated[case]),
            configuration=configuration_of(moving.motion.shape, case),
        )


def _history(records: Sequence[_Record], force_left: float, with_snapshots: bool) -> History:
    kept = records if with_snapshots else records[-1:]
    return History(
        time=np.array([record.time for record in records]),
        kinetic=np.array([record.kinetic for record in records]),
        potential=np.array([record.potential for record in records]),
        dissipated=np.array([record.dissipated for record in records]),
        snapshot_time=np.array([record.time for record in kept]),
        snapshots=Configuration.stacked([record.configuration for record in kept]),
        force_left=force_left,
    )
