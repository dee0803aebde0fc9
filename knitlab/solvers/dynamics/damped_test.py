"""Relaxation and tensile test by damped dynamics, for a batch of fabrics of one mesh shape."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from knitlab.model.energy import Energy
from knitlab.model.fabric import Configuration, Fabric, flat_sheet
from knitlab.model.inertia import Inertia
from knitlab.model.network import MeshShape, network
from knitlab.solvers.dynamics.contact_pairs import PairFinder
from knitlab.solvers.dynamics.grid import GridFabric, Shape
from knitlab.solvers.dynamics.motion import Body, Moving, advance, developing, largest_step
from knitlab.solvers.dynamics.settings import Dynamics
from knitlab.solvers.equilibrium.alignment import between_walls, rigidly_aligned
from knitlab.solvers.equilibrium.state import History, Outcome, State, TensileTest
from knitlab.solvers.loads.load import Load
from knitlab.solvers.loads.loading import Loading, all_free, free_under, loading_of

Progress = Callable[[int, float], None]  # of the index in a batch, and of finished states
Record = tuple[float, float, float, float, Configuration]
"""Time, kinetic and potential energy, dissipated work, as in a :class:`History`, and the shape."""


@dataclass(frozen=True, eq=False)
class MovingFabrics:
    """Fabrics of one mesh shape that move together, with their masses, drags and loads."""

    shape: MeshShape
    fabrics: Sequence[Fabric]
    inertias: Sequence[Inertia]
    settings: Dynamics
    loads: Sequence[Load]
    finders: Sequence[PairFinder] = ()  # of what may touch, if they have contact

    def bodies(self, clamped: bool) -> list[Body]:
        """The fabrics as bodies, free or with what the tests of their loads hold held."""
        inverses = [
            _inverse_mass(self.shape, inertia, load if clamped else None)
            for inertia, load in zip(self.inertias, self.loads, strict=True)
        ]
        # With a number for each row, where it suffices, a step reads less memory.
        columns = slice(None)
        if all((each.positions == each.positions[:, :1]).all() for each in inverses):
            columns = slice(1)
        lengths = jnp.array([self.shape.nodes_y, self.shape.nodes_x], float)
        return [
            Body(
                GridFabric.of(self.shape, fabric),
                on_grid(Configuration(inverse.positions[:, columns], inverse.lengths)),
                jnp.asarray(inertia.damping),
                lengths,
            )
            for fabric, inertia, inverse in zip(self.fabrics, self.inertias, inverses, strict=True)
        ]


@dataclass(frozen=True, eq=False)
class Relaxed:
    """The end of a relaxation; ``converged`` if at rest, or after the given time."""

    configuration: Configuration  # aligned for clamping if the fabric is a sample [mm]
    history: History
    strain_rate: float  # at which a test by dynamics is to pull it [1/ms]
    steps: int
    outcome: Outcome


def relax_by_dynamics(
    fabrics: MovingFabrics,
    progress: Progress = lambda case, states: None,
    sheets: Sequence[Configuration | None] | None = None,
) -> list[Relaxed]:
    """Release flat sheets at rest and let them fold (paper, Sec. "Relaxation of a pattern").

    A sample is then rotated rigidly for the clamps of its load. ``sheets``, such as imperfect ones,
    replace flat sheets [mm].
    """
    shape, settings, cases = fabrics.shape, fabrics.settings, range(len(fabrics.fabrics))
    flat = [flat_sheet(network(shape), fabric) for fabric in fabrics.fabrics]
    released = [given or sheet for given, sheet in zip(sheets or flat, flat, strict=True)]
    starts, finders = [on_grid(sheet) for sheet in released], fabrics.finders
    moving = Moving.from_rest(fabrics.bodies(clamped=False), starts, finders)
    first_force = np.asarray(moving.seen.force)
    to_rest = settings.ending == "rest"
    if settings.ending == "steps":
        stable = largest_step(moving)
        longest, rate = settings.relax_steps * stable, settings.step_strain / stable
    else:
        duration = settings.longest_time if to_rest else settings.relax_time
        longest, rate = (np.full(len(flat), each) for each in (duration, settings.strain_rate))
    if settings.release:
        whole = np.full(len(flat), settings.relax_time) if to_rest else longest
        moving = developing(moving, settings.release * whole)
    # The first record after the beginning is at 0.01 ms. The last is the end, even if it is the
    # only one or if all is over before the first.
    count = settings.snapshots or 40
    times = np.geomspace(longest, np.minimum(0.01, longest), count)[::-1]
    records = [[_record(moving, case)] for case in cases]
    for number, time in enumerate(times):
        moving = advance(moving, time, settings, to_rest)
        for case in cases:
            if moving.time[case] > records[case][-1][0]:
                records[case].append(_record(moving, case))
            progress(case, (number + 1) / (len(times) + 1))
        if (moving.resting | moving.diverged).all():
            break
    relaxed = []
    for case in cases:
        folded = records[case][-1][-1]
        if not shape.periodic:
            aligned = rigidly_aligned(shape, flat[case], folded, fabrics.loads[case])
            folded = between_walls(shape, aligned, float(fabrics.fabrics[case].z_max))
        first, left = float(first_force[case]), float(moving.seen.force[case])
        force_left = left / first if first else 0.0
        *numbers, shapes = zip(*records[case], strict=True)
        time, kinetic, potential, dissipated = map(np.array, numbers)
        kept = slice(None) if settings.snapshots else slice(-1, None)
        snapshots = time[kept], Configuration.stacked(shapes[kept])
        history = History(time, kinetic, potential, dissipated, *snapshots, force_left)
        outcome, steps = _outcome(moving, case, to_rest), int(moving.steps[case])
        relaxed.append(Relaxed(folded, history, float(rate[case]), steps, outcome))
    return relaxed


def stretch_by_dynamics(
    fabrics: MovingFabrics,
    applied_strain: Sequence[Sequence[float]],
    progress: Progress = lambda case, states: None,
) -> list[TensileTest]:
    """Relax flat sheets, then pull them from rest (paper, Sec. "Kinematics under tension").

    With ``settings.ending`` ``"rest"`` the fabric comes to rest at every strain; otherwise it is
    pulled without pause, and its states are not equilibria. Strains ascend from 0.
    """
    shape, settings = fabrics.shape, fabrics.settings
    relaxed = relax_by_dynamics(fabrics, progress)
    loadings = [
        loading_of(shape, end.configuration, load)
        for end, load in zip(relaxed, fabrics.loads, strict=True)
    ]
    starts = [on_grid(end.configuration) for end in relaxed]
    moving = Moving.from_rest(fabrics.bodies(clamped=True), starts, fabrics.finders)
    failed = np.array([end.outcome is not Outcome.converged for end in relaxed])
    moving = replace(moving, diverged=failed)
    to_rest, still = settings.ending == "rest", np.zeros(len(relaxed))
    states = []
    for case, end in enumerate(relaxed):
        state = _state(shape, moving, case, all_free(shape), end.outcome)
        peak = float(end.history.kinetic.max())
        states.append([replace(state, iterations=end.steps, kinetic_peak=peak)])
    strains, rate = np.array(applied_strain), np.array([end.strain_rate for end in relaxed])
    waited = still
    for number in range(1, strains.shape[1]):
        steps, began = moving.steps, moving.time
        moving = replace(driven(moving, loadings, rate), kinetic_peak=0 * began)
        arrival = waited + strains[:, number] / rate
        moving = advance(moving, arrival, settings)
        if to_rest:
            moving = driven(moving, loadings, still)
            moving = advance(moving, arrival + settings.longest_time, settings, to_rest=True)
            waited = waited + moving.time - arrival
        for case, own in enumerate(states):
            if own[-1].converged:
                outcome = _outcome(moving, case, to_rest)
                state = _state(shape, moving, case, loadings[case].free, outcome)
                taken = int(moving.steps[case] - steps[case])
                peak = float(moving.kinetic_peak[case])
                own.append(replace(state, iterations=taken, kinetic_peak=peak))
                progress(case, number + 1)
        ended = [not own[-1].converged for own in states]
        moving = replace(moving, diverged=moving.diverged | ended)
    return [
        TensileTest(loading if own[0].converged else None, own, history=end.history)
        for loading, own, end in zip(loadings, states, relaxed, strict=True)
    ]


def _outcome(moving: Moving, case: int, to_rest: bool) -> Outcome:
    if moving.diverged[case]:
        return Outcome.diverged
    return Outcome.time_limit if to_rest and not moving.resting[case] else Outcome.converged


def moved_mass(shape: MeshShape, inertia: Inertia) -> Configuration:
    """Mass that each unknown moves [g]; L_x and L_y, not in the paper, that of a line of nodes."""
    mass = jnp.broadcast_to(inertia.node_mass, (shape.nodes_y, shape.nodes_x))
    lines = jnp.stack([mass[:, 0].sum(), mass[0].sum()])
    return Configuration(jnp.broadcast_to(mass[..., None], (*mass.shape, 3)), lines)


def _inverse_mass(shape: MeshShape, inertia: Inertia, load: Load | None) -> Configuration:
    """1/m of every unknown [1/g], 0 where the test of a load holds it."""
    inverse = np.zeros(shape.unknowns)
    free = all_free(shape) if load is None else free_under(shape, load)
    inverse[free] = 1 / np.asarray(moved_mass(shape, inertia).flattened())[free]
    return Configuration.of(inverse, shape)


def on_grid(configuration: Configuration) -> Shape:
    """A configuration as the dynamics hold it."""
    x, y, z = map(jnp.asarray, np.moveaxis(np.asarray(configuration.positions), -1, 0))
    return Shape((x, y, z), jnp.asarray(configuration.lengths))


def configuration_of(shape: Shape, case: int) -> Configuration:
    """The configuration of one fabric of a batch."""
    positions = np.stack([np.asarray(each[case]) for each in shape.positions], axis=-1)
    return Configuration(positions, np.asarray(shape.lengths[case]))


def driven(moving: Moving, loadings: Sequence[Loading], rate: Float[np.ndarray, " case"]) -> Moving:
    """The batch, with what is held moving at rates of the applied strain [1/ms]."""
    drives = [on_grid(Configuration.of(each.drive, each.shape)) for each in loadings]

    def held(velocity: Array, inverse: Array, *drive: Array) -> Array:
        rates = rate.reshape(-1, *[1] * (velocity.ndim - 1))
        return jnp.where(inverse == 0, rates * jnp.stack(drive), velocity)

    velocity = jax.tree.map(held, moving.motion.velocity, moving.body.inverse, *drives)
    return replace(moving, motion=replace(moving.motion, velocity=velocity))


def _state(
    shape: MeshShape, moving: Moving, case: int, free: Int[np.ndarray, " free"], outcome: Outcome
) -> State:
    energy: Energy = jax.tree.map(lambda leaf: np.asarray(leaf[case]), moving.seen.energy)
    forces = np.asarray(configuration_of(moving.seen.gradient, case).flattened())
    unknowns = np.asarray(configuration_of(moving.motion.shape, case).flattened())
    residual = float(np.abs(forces[free]).max())
    return State(shape, unknowns, energy, forces, outcome, residual, iterations=0)


def _record(moving: Moving, case: int) -> Record:
    seen = moving.seen
    energies = seen.kinetic[case], seen.energy.total[case], moving.motion.dissipated[case]
    kinetic, potential, dissipated = map(float, energies)
    shape = configuration_of(moving.motion.shape, case)
    return float(moving.time[case]), kinetic, potential, dissipated, shape
