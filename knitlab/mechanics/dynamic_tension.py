"""The tensile test by dynamics: fabrics of one mesh shape relax, are pulled, and come to rest."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from knitlab.mechanics.dynamics import (
    PEAK_OF_SMOOTH_RAMP,
    Drive,
    DynamicsSettings,
    Motion,
    Trajectory,
    batch_integrator,
)
from knitlab.mechanics.loading import Loading, all_free, squaring_angle, tensile, turned
from knitlab.mechanics.lockstep import stacked
from knitlab.mechanics.state import History, Outcome, State, TensileTest
from knitlab.model.fabric import Fabric, flat_sheet
from knitlab.model.inertia import Inertia
from knitlab.model.network import MeshShape, network

KEPT_TIMES = 400
"""Times at which the energies of a motion are kept."""
SLOWING = 4
"""What the rate of a strain step is divided by if it was not quasi-static."""


@dataclass(frozen=True, eq=False)
class Batch:
    """Fabrics of one mesh shape that move together.

    Attributes:
        shape: the mesh shape.
        fabrics: their numbers.
        inertias: their masses and drags.
        settings: of the dynamics.
    """

    shape: MeshShape
    fabrics: Sequence[Fabric]
    inertias: Sequence[Inertia]
    settings: DynamicsSettings


@dataclass(frozen=True, eq=False)
class Course:
    """Where one fabric starts from rest, and how it is driven from one strain to the next.

    Attributes:
        start: the configuration [mm].
        loading: what is held and driven; ``None`` if all is free.
        before, after: applied strains.
        rate: fastest strain rate on the way [1/ms].
        ended: whether the fabric only keeps its place in the batch.
    """

    start: Float[np.ndarray, " unknown"]
    loading: Loading | None = None
    before: float = 0.0
    after: float = 0.0
    rate: float = 1.0
    ended: bool = False

    @property
    def ramp_time(self) -> float:
        """How long the strain changes [ms]."""
        return PEAK_OF_SMOOTH_RAMP * (self.after - self.before) / self.rate

    def drive(self, shape: MeshShape) -> Drive:
        """The course as the dynamics take it."""
        free = all_free(shape) if self.loading is None else self.loading.unknowns
        direction = np.zeros(shape.unknowns) if self.loading is None else self.loading.drive
        return Drive(
            free=jnp.asarray(np.isin(np.arange(shape.unknowns), free)),
            reference=jnp.asarray(self.start if self.loading is None else self.loading.reference),
            direction=jnp.asarray(direction),
            before=jnp.asarray(self.before),
            after=jnp.asarray(self.after),
            ramp_time=jnp.asarray(self.ramp_time),
            ended=jnp.asarray(self.ended),
        )


@dataclass(frozen=True)
class Arrival:
    """Where a course led, and how the fabric moved on the way.

    Attributes:
        state: the last state.
        history: of the way.
        haste: kinetic energy at its peak and work against the drag, over the largest elastic
            energy, while driven.
    """

    state: State
    history: History
    haste: float


def move(batch: Batch, courses: Sequence[Course]) -> list[Arrival]:
    """Move every fabric of a batch along its course until it is at rest, in one call."""
    start = jnp.array([course.start for course in courses])
    nothing = jnp.zeros(len(courses))
    drives = [course.drive(batch.shape) for course in courses]
    trajectories = batch_integrator(batch.shape, batch.settings)(
        stacked(batch.fabrics),
        stacked(batch.inertias),
        stacked(drives),
        Motion(start, jnp.zeros_like(start), nothing, nothing),
        *(
            jnp.array([_kept_times(batch.settings, course, count) for course in courses])
            for count in (KEPT_TIMES, batch.settings.snapshots)
        ),
    )
    leaves, structure = jax.tree.flatten(trajectories)
    return [
        _arrival(jax.tree.unflatten(structure, parts), np.asarray(drive.free), batch.settings)
        for drive, *parts in zip(drives, *leaves, strict=True)
    ]


def _kept_times(
    settings: DynamicsSettings, course: Course, count: int
) -> Float[np.ndarray, " time"]:
    """Even times of a ramp; of a motion that is not driven, times even in their logarithm."""
    if course.ramp_time:
        return np.linspace(0, course.ramp_time, count)
    times = np.geomspace(settings.time_step, settings.settling_time, count - 1)
    return np.append(0, np.minimum(times, settings.settling_time))


def _arrival(
    trajectory: Trajectory, free: Bool[np.ndarray, " unknown"], settings: DynamicsSettings
) -> Arrival:
    if not np.isfinite(trajectory.end.configuration).all():
        outcome = Outcome.diverged
    elif trajectory.force_left <= settings.steady_force:
        outcome = Outcome.converged
    elif trajectory.successful:
        outcome = Outcome.time_limit
    elif trajectory.step_limit:
        outcome = Outcome.iteration_limit
    else:
        outcome = Outcome.stalled
    kept, pictured = (np.isfinite(times) for times in (trajectory.time, trajectory.snapshot_time))
    history = History(
        time=np.asarray(trajectory.time)[kept],
        kinetic=np.asarray(trajectory.energies.kinetic)[kept],
        potential=np.asarray(trajectory.energies.potential)[kept],
        dissipated=np.asarray(trajectory.energies.dissipated)[kept],
        snapshot_time=np.asarray(trajectory.snapshot_time)[pictured],
        snapshots=np.asarray(trajectory.snapshots)[pictured],
    )
    state = State(
        configuration=np.asarray(trajectory.end.configuration),
        energy=trajectory.energy,
        gradient=np.asarray(trajectory.gradient),
        outcome=outcome,
        residual=float(np.abs(trajectory.gradient[free]).max()),
        iterations=int(trajectory.steps),
        kinetic_peak=float(history.kinetic.max(initial=0.0)),
    )
    spent = state.kinetic_peak + history.dissipated.max(initial=0.0)
    stored = history.potential.max(initial=0.0)
    return Arrival(state, history, haste=spent / stored if stored else 0.0)


def stretch_by_dynamics(
    batch: Batch,
    applied_strain: Sequence[Sequence[float]],
    progress: Callable[[int, int], None] = lambda case, done: None,
) -> list[TensileTest]:
    """Relax a batch from flat sheets at rest, then take it through a tensile test.

    To every applied strain the driven end moves at no more than ``settings.ramp_rate``; then the
    fabric comes to rest. A strain step whose haste exceeds ``settings.haste_limit`` is taken
    again at a quarter of the rate, which lowers the drag's work as much and the kinetic energy
    more. If haste does not even halve, the fabric snaps, for which no rate is slow enough, and
    the step stands. A test ends at the first strain that cannot be reached; its batch mates go
    on.

    Args:
        batch: the fabrics.
        applied_strain: of each, ascending from 0, equally many.
        progress: told, for a place in the batch, how many of its states are done.
    """
    shape = batch.shape
    sheets = [np.asarray(flat_sheet(network(shape), fabric)) for fabric in batch.fabrics]
    arrivals = move(batch, [Course(sheet) for sheet in sheets])
    tests = []
    for case, (sheet, arrival) in enumerate(zip(sheets, arrivals, strict=True)):
        relaxed = _squared_up(shape, sheet, arrival.state)
        loading = tensile(shape, relaxed.configuration) if relaxed.converged else None
        tests.append(TensileTest(loading, [relaxed], arrival.history))
        progress(case, 1)
    for place in range(1, len(applied_strain[0])):
        courses = [
            Course(
                start=test.states[-1].configuration if test.loading else sheet,
                loading=test.loading,
                before=strains[place - 1],
                after=strains[place],
                rate=batch.settings.ramp_rate,
                ended=not test.states[-1].converged,
            )
            for test, sheet, strains in zip(tests, sheets, applied_strain, strict=True)
        ]
        for case, state in _quasi_static(batch, courses).items():
            tests[case].states.append(state)
            progress(case, place + 1)
    return tests


def _squared_up(shape: MeshShape, sheet: Float[np.ndarray, " unknown"], relaxed: State) -> State:
    angle = squaring_angle(shape, sheet, relaxed.configuration)
    return replace(
        relaxed,
        configuration=turned(relaxed.configuration, angle),
        gradient=turned(relaxed.gradient, angle),
    )


def _quasi_static(batch: Batch, courses: Sequence[Course]) -> dict[int, State]:
    """Move along courses that have not ended, each again and slower while it was too fast."""
    settings = batch.settings
    courses, reached, hasty = list(courses), dict[int, State](), dict[int, Arrival]()
    while pending := [case for case, course in enumerate(courses) if not course.ended]:
        arrivals = move(batch, courses)
        for case in pending:
            arrival = arrivals[case]
            if case in hasty:
                arrival = replace(arrival, state=arrival.state.after(hasty[case].state))
            slower = courses[case].rate / SLOWING
            if not arrival.state.converged or arrival.haste <= settings.haste_limit:
                reached[case] = arrival.state
            elif case in hasty and 2 * arrival.haste > hasty[case].haste:
                reached[case] = replace(arrival.state, snapped=True)
            elif slower < settings.smallest_rate * settings.ramp_rate:
                reached[case] = replace(arrival.state, outcome=Outcome.too_fast)
            else:
                hasty[case] = arrival
            courses[case] = replace(courses[case], rate=slower, ended=case in reached)
    return reached
