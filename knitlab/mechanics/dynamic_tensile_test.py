"""The tensile test by dynamics, for a batch of fabrics of one mesh shape."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from knitlab.mechanics.dynamics import (
    PEAK_OF_SMOOTH_RAMP,
    Motion,
    PrescribedMotion,
    Trajectory,
    batch_integrator,
)
from knitlab.mechanics.dynamics_settings import DynamicsSettings
from knitlab.mechanics.loading import Loading, all_free, rigidly_aligned, tensile
from knitlab.mechanics.tensile_result import History, TensileTest
from knitlab.model.configuration import Configuration
from knitlab.model.fabric import Fabric, flat_sheet
from knitlab.model.inertia import Inertia
from knitlab.model.network import MeshShape, network
from knitlab.solvers.batch import stacked
from knitlab.solvers.state import Outcome, State

KEPT_TIMES = 400
"""Number of times at which the energies of a motion are recorded."""
SLOWING = 4
"""Divisor of the rate of a strain step that was not quasi-static."""


@dataclass(frozen=True, eq=False)
class MovingBatch:
    """Fabrics of one mesh shape that are integrated together.

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


@dataclass(frozen=True, eq=False)
class MotionPath:
    """Initial state of one fabric at rest, and its path from one applied strain to the next.

    Attributes:
        start: initial unknowns [mm].
        loading: what is held and driven; ``None`` if all unknowns are free.
        before, after: applied strains.
        rate: largest strain rate [1/ms].
        ended: whether the test of the fabric has ended; it then only fills its place in the batch.
    """

    start: Float[np.ndarray, " unknown"]
    loading: Loading | None = None
    before: float = 0.0
    after: float = 0.0
    rate: float = 1.0
    ended: bool = False

    @property
    def ramp_time(self) -> float:
        """Duration of the change of strain [ms]."""
        return PEAK_OF_SMOOTH_RAMP * (self.after - self.before) / self.rate

    def drive(self, shape: MeshShape) -> PrescribedMotion:
        """The path as a prescribed motion."""
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
    """The result of a motion along a path.

    Attributes:
        state: the final state.
        history: history of the motion.
        loss: quasi-static loss: peak kinetic energy plus work against the drag, over the largest
            work of the driven unknowns; NaN if none are driven.
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
    """Times evenly spaced over the ramp, if there is one, and then in their logarithm."""
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
    recorded, pictured = (
        np.isfinite(times) for times in (trajectory.time, trajectory.snapshot_time)
    )
    history = History(
        time=np.asarray(trajectory.time)[recorded],
        kinetic=np.asarray(trajectory.energies.kinetic)[recorded],
        potential=np.asarray(trajectory.energies.potential)[recorded],
        dissipated=np.asarray(trajectory.energies.dissipated)[recorded],
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
    work = np.abs(np.asarray(trajectory.energies.supplied)[recorded]).max(initial=0.0)
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
    """Relax a batch from flat sheets at rest, then run its tensile tests.

    The driven end moves to every applied strain at no more than ``settings.ramp_rate``; then the
    fabric moves until it is at rest. A strain step whose quasi-static loss exceeds
    ``settings.quasi_static_limit`` is repeated at a quarter of the rate, which reduces the work of
    the drag as much and the kinetic energy more. If that does not even halve the loss, although
    both ramps lasted longer than the settling after them, the fabric snaps: no rate is slow enough,
    and the step is accepted. A test ends at the first strain that cannot be reached; the others of
    the batch continue.

    Args:
        batch: the fabrics.
        applied_strain: strains of each fabric, ascending from 0, of equal number.
        progress: called with the index in the batch and the number of its finished states.
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
    """Relaxed states; samples are rigidly aligned and relaxed again, as walls may resist that."""
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
    """Move along the paths that have not ended, repeating each more slowly while it is too fast."""
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

    A rate is slow if the ramp takes longer than the settling after it; a fast ramp, too, may lose
    the same work at different rates.
    """
    slow = slower.ramp_time / SLOWING >= faster.settling
    return slow and 2 * result.loss > faster.loss
