"""The tensile test by dynamics: fabrics of one mesh shape relax, are pulled, and come to rest."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from knitlab.mechanics.batch import stacked
from knitlab.mechanics.dynamics import (
    PEAK_OF_SMOOTH_RAMP,
    DynamicsSettings,
    Motion,
    PrescribedMotion,
    Trajectory,
    batch_integrator,
)
from knitlab.mechanics.loading import Loading, all_free, rigidly_aligned, tensile
from knitlab.mechanics.state import History, Outcome, State, TensileTest
from knitlab.model.configuration import Configuration
from knitlab.model.fabric import Fabric, flat_sheet
from knitlab.model.inertia import Inertia
from knitlab.model.network import MeshShape, network

KEPT_TIMES = 400
"""Times at which the energies of a motion are kept."""
SLOWING = 4
"""What the rate of a strain step is divided by if it was not quasi-static."""


@dataclass(frozen=True, eq=False)
class MovingBatch:
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
class MotionPath:
    """Where one fabric starts from rest, and how it is driven from one strain to the next.

    Attributes:
        start: the unknowns there [mm].
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

    def drive(self, shape: MeshShape) -> PrescribedMotion:
        """The path as the dynamics take it."""
        free = all_free(shape) if self.loading is None else self.loading.free
        direction = np.zeros(shape.unknowns) if self.loading is None else self.loading.drive
        return PrescribedMotion(
            free=jnp.asarray(np.isin(np.arange(shape.unknowns), free)),
            reference=jnp.asarray(self.start if self.loading is None else self.loading.reference),
            direction=jnp.asarray(direction),
            before=jnp.asarray(self.before),
            after=jnp.asarray(self.after),
            ramp_time=jnp.asarray(self.ramp_time),
            ended=jnp.asarray(self.ended),
        )


@dataclass(frozen=True)
class MotionResult:
    """The end of a path, and how the fabric moved on the way.

    Attributes:
        state: the last state.
        history: of the way.
        loss: quasi-static loss, the kinetic energy at its peak and all work against the drag over
            the largest work of what drove the fabric; not a number if nothing did.
        settling: time from the end of the drive to rest [ms].
    """

    state: State
    history: History
    loss: float
    settling: float


def move(batch: MovingBatch, paths: Sequence[MotionPath]) -> list[MotionResult]:
    """Move every fabric of a batch along its path until it is at rest, in one call."""
    start = jnp.array([path.start for path in paths])
    nothing = jnp.zeros(len(paths))
    drives = [path.drive(batch.shape) for path in paths]
    trajectories = batch_integrator(batch.shape, batch.settings)(
        stacked(batch.fabrics),
        stacked(batch.inertias),
        stacked(drives),
        Motion(start, jnp.zeros_like(start), nothing, nothing),
        *(
            jnp.array([_kept_times(batch.settings, path, count) for path in paths])
            for count in (KEPT_TIMES, batch.settings.snapshots)
        ),
    )
    leaves, structure = jax.tree.flatten(trajectories)
    return [
        _motion_result(batch.shape, jax.tree.unflatten(structure, parts), drive, batch.settings)
        for drive, *parts in zip(drives, *leaves, strict=True)
    ]


def _kept_times(
    settings: DynamicsSettings, path: MotionPath, count: int
) -> Float[np.ndarray, " time"]:
    """Even times of the ramp if there is one; after it, times even in their logarithm."""
    driven = count // 2 if path.ramp_time else 1
    ramp = np.linspace(0, path.ramp_time, driven)
    after = np.geomspace(settings.time_step, settings.settling_time, count - driven)
    return np.append(ramp, path.ramp_time + np.minimum(after, settings.settling_time))


def _motion_result(
    shape: MeshShape, trajectory: Trajectory, drive: PrescribedMotion, settings: DynamicsSettings
) -> MotionResult:
    if not np.isfinite(trajectory.end.unknowns).all():
        outcome = Outcome.diverged
    elif trajectory.force_left <= settings.force_left:
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
        snapshots=Configuration.of(np.asarray(trajectory.snapshots)[pictured], shape),
    )
    state = State(
        shape=shape,
        unknowns=np.asarray(trajectory.end.unknowns),
        energy=trajectory.energy,
        gradient=np.asarray(trajectory.gradient),
        outcome=outcome,
        residual=float(np.abs(trajectory.gradient[np.asarray(drive.free)]).max()),
        iterations=int(trajectory.steps),
        kinetic_peak=float(history.kinetic.max(initial=0.0)),
    )
    spent = state.kinetic_peak + float(trajectory.end.dissipated)
    work = np.abs(np.asarray(trajectory.energies.supplied)[kept]).max(initial=0.0)
    return MotionResult(
        state,
        history,
        loss=spent / work if work else np.nan,
        settling=float(trajectory.end_time - drive.ramp_time),
    )


def stretch_by_dynamics(
    batch: MovingBatch,
    applied_strain: Sequence[Sequence[float]],
    progress: Callable[[int, int], None] = lambda case, done: None,
) -> list[TensileTest]:
    """Relax a batch from flat sheets at rest, then take it through a tensile test.

    To every applied strain the driven end moves at no more than ``settings.ramp_rate``; then the
    fabric comes to rest. A strain step whose quasi-static loss exceeds
    ``settings.quasi_static_limit`` is taken again at a quarter of the rate, which lowers the drag's
    work as much and the kinetic energy more. If the loss does not even halve, though both drives
    lasted longer than the settling after them, the fabric snaps, for which no rate is slow enough,
    and the step is kept. A test ends at the first strain that cannot be reached; the others of the
    batch go on.

    Args:
        batch: the fabrics.
        applied_strain: of each, ascending from 0, equally many.
        progress: called with a place in the batch and how many of its states are done.
    """
    shape = batch.shape
    sheets = [flat_sheet(network(shape), fabric) for fabric in batch.fabrics]
    starts = [np.asarray(sheet.flattened()) for sheet in sheets]
    results = move(batch, [MotionPath(start) for start in starts])
    tests = []
    for case, (relaxed, result) in enumerate(
        zip(_rigidly_aligned(batch, sheets, results), results, strict=True)
    ):
        loading = tensile(shape, relaxed.configuration) if relaxed.converged else None
        tests.append(TensileTest(loading, [relaxed], result.history))
        progress(case, 1)
    for place in range(1, len(applied_strain[0])):
        paths = [
            MotionPath(
                start=test.states[-1].unknowns if test.loading else start,
                loading=test.loading,
                before=strains[place - 1],
                after=strains[place],
                rate=batch.settings.ramp_rate,
                ended=not test.states[-1].converged,
            )
            for test, start, strains in zip(tests, starts, applied_strain, strict=True)
        ]
        for case, state in _quasi_static(batch, paths).items():
            tests[case].states.append(state)
            progress(case, place + 1)
    return tests


def _rigidly_aligned(
    batch: MovingBatch,
    sheets: Sequence[Configuration],
    results: Sequence[MotionResult],
) -> list[State]:
    """Relaxed states; samples are rigidly aligned and at rest again, as walls may resist that."""
    relaxed = [result.state for result in results]
    if batch.shape.periodic:
        return relaxed
    paths = []
    for sheet, state in zip(sheets, relaxed, strict=True):
        start = sheet
        if state.converged:
            start = rigidly_aligned(batch.shape, sheet, state.configuration)
        unknowns = np.asarray(start.flattened())
        paths.append(MotionPath(unknowns, ended=not state.converged))
    return [
        replace(again.state.after(state), kinetic_peak=state.kinetic_peak)
        if state.converged
        else state
        for state, again in zip(relaxed, move(batch, paths), strict=True)
    ]


def _quasi_static(batch: MovingBatch, paths: Sequence[MotionPath]) -> dict[int, State]:
    """Move along paths that have not ended, each again and slower while it was too fast."""
    settings = batch.settings
    paths, reached, too_fast = list(paths), dict[int, State](), dict[int, MotionResult]()
    while pending := [case for case, path in enumerate(paths) if not path.ended]:
        results = move(batch, paths)
        for case in pending:
            result, earlier = results[case], too_fast.get(case)
            if earlier is not None:
                result = replace(result, state=result.state.after(earlier.state))
            slower = paths[case].rate / SLOWING
            if not result.state.converged or result.loss <= settings.quasi_static_limit:
                reached[case] = result.state
            elif earlier is not None and _snapped(paths[case], earlier, result):
                reached[case] = replace(result.state, snapped=True)
            elif slower < settings.smallest_rate * settings.ramp_rate:
                reached[case] = replace(result.state, outcome=Outcome.too_fast)
            else:
                too_fast[case] = result
            paths[case] = replace(paths[case], rate=slower, ended=case in reached)
    return reached


def _snapped(slower: MotionPath, faster: MotionResult, result: MotionResult) -> bool:
    """Whether work is lost at any rate: the loss is not even halved at a quarter of a slow rate.

    A rate is slow if the drive outlasts the settling after it. A sudden pull loses the same work at
    any rate too.
    """
    slow = slower.ramp_time / SLOWING >= faster.settling
    return slow and 2 * result.loss > faster.loss
