"""Workers: where batches are simulated, in this process or by dask."""

import logging
import os
import signal
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

import dask
from distributed import Client, KilledWorker, LocalCluster, as_completed, get_worker

from knitlab.io.errors import CannotWrite, fault
from knitlab.linalg.threads import ONE_THREAD
from knitlab.simulation.case import Case
from knitlab.simulation.reporting import Progress

# One thread a worker, except for Task.threads; and a solve cached on disk must not hold host
# callbacks.
WORKER_ENVIRONMENT = ONE_THREAD | {"EQX_ON_ERROR": "nan"}
PROGRESS_TOPIC = "knitlab-progress"
TIMED_OUT = ".timed-out-"
"""What the marks begin with that workers leave in a results folder when time is up."""
TIME_IS_UP = 75
"""Exit code of such a worker."""

Batch = Sequence[Case]
Simulate = Callable[[Path, Batch, Progress], None]
"""Simulates a batch and writes its case files; an importable function."""


@dataclass(frozen=True)
class BatchError:
    """Why a batch has no results.

    Attributes:
        reason: in a sentence.
        trace: where it was raised, if it was.
        lost: whether its worker died with it.
        cannot_write: the fault, if there was no writing its files.
    """

    reason: str
    trace: str = ""
    lost: bool = False
    cannot_write: CannotWrite | None = None

    @classmethod
    def of(cls, error: BaseException) -> "BatchError":
        """Describe an exception by its type, message and innermost frame."""
        if isinstance(error, KilledWorker):
            return cls("its worker died: it was killed, or it ran out of memory", lost=True)
        frames = traceback.extract_tb(error.__traceback__)
        place = f" ({Path(frames[-1].filename).name}:{frames[-1].lineno})" if frames else ""
        return cls(
            f"{type(error).__name__}: {error}{place}",
            "".join(traceback.format_exception(error)),
            cannot_write=error if isinstance(error, CannotWrite) else None,
        )

    @classmethod
    def late(cls, seconds: float) -> "BatchError":
        """A batch whose time was up."""
        return cls(f"it took longer than {seconds:g} s (case_timeout)")


Pool = Callable[[Sequence[Batch]], Iterator[tuple[Batch, BatchError | None]]]
"""Simulates batches and yields each as it ends, with the error that ended it if any."""


@dataclass(frozen=True)
class Task:
    """What is done with every batch, and where.

    Attributes:
        simulate: what simulates a batch.
        results: results folder of the workflow, as the workers see it.
        case_timeout: longest time for each case of a batch, if any [s].
        threads: that a worker on this machine may use for one large sample.
    """

    simulate: Simulate
    results: Path
    case_timeout: float | None = None
    threads: int = 1

    def limit(self, batch: Batch) -> float | None:
        """Longest time for a batch [s]."""
        return None if self.case_timeout is None else self.case_timeout * len(batch)

    def mark(self, batch: Batch) -> Path:
        """What is left behind where the time for a batch was up."""
        return self.results / f"{TIMED_OUT}{batch[0].case_id}"


def in_process(task: Task, progress: Progress) -> Pool:
    """A pool that simulates in this process, one batch after the other."""

    def simulated(batches: Sequence[Batch]) -> Iterator[tuple[Batch, BatchError | None]]:
        for batch in batches:
            try:
                with _alarm(task.limit(batch)):
                    task.simulate(task.results, batch, progress)
            except TimeoutError:
                yield batch, BatchError.late(task.limit(batch) or 0.0)
            except Exception as error:  # whatever a batch raises must not end the sweep
                yield batch, BatchError.of(error)
            else:
                yield batch, None

    return simulated


@contextmanager
def _alarm(seconds: float | None) -> Iterator[None]:
    """Raise TimeoutError here when time is up; a compiled program ends first."""

    def ring(number: int, frame: FrameType | None) -> None:
        raise TimeoutError

    if seconds is None:
        yield
        return
    before = signal.signal(signal.SIGALRM, ring)
    # Again and again, for what it raises may be lost in a callback.
    signal.setitimer(signal.ITIMER_REAL, seconds, max(seconds, 1.0))
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


@contextmanager
def dask_pool(client: Client, task: Task, progress: Progress) -> Iterator[Pool]:
    """A pool on a dask cluster; progress comes back as events of the scheduler."""

    def heard(event: tuple[float, tuple[str, float]]) -> None:
        progress(*event[1])

    def simulated(batches: Sequence[Batch]) -> Iterator[tuple[Batch, BatchError | None]]:
        futures = {
            client.submit(simulate_on_worker, task, batch, pure=False): batch for batch in batches
        }
        try:
            for future in as_completed(list(futures)):
                batch, error = futures.pop(future), future.exception()
                yield batch, _explained(task, batch, error) if error else None
        finally:
            client.cancel(list(futures), force=True)

    client.subscribe_topic(PROGRESS_TOPIC, heard)
    try:
        yield simulated
    finally:
        with suppress(Exception):  # a scheduler that is gone needs no farewell
            client.unsubscribe_topic(PROGRESS_TOPIC)


def _explained(task: Task, batch: Batch, error: BaseException) -> BatchError:
    mark = task.mark(batch)
    if isinstance(error, KilledWorker) and mark.exists():
        mark.unlink()
        return BatchError.late(task.limit(batch) or 0.0)
    return BatchError.of(error)


def simulate_on_worker(task: Task, batch: Batch) -> None:
    """The dask task: simulate a batch and log its progress as events.

    When its time is up the process ends, for nothing else ends a compiled program.
    """
    worker = get_worker()
    if task.threads > 1:
        # Not of the cluster's settings: dask would let this process's own variables go before.
        os.environ["OMP_NUM_THREADS"] = str(task.threads)

    def progress(case_id: str, states: float) -> None:
        worker.log_event(PROGRESS_TOPIC, (case_id, states))

    def give_up() -> None:
        task.mark(batch).touch()
        os._exit(TIME_IS_UP)

    limit = task.limit(batch)
    watch = threading.Timer(limit, give_up) if limit else None
    if watch:
        watch.daemon = True
        watch.start()
    try:
        # On a worker xarray would request a lock from the scheduler to write, at every variable.
        with dask.config.set(scheduler="synchronous"):
            task.simulate(task.results, batch, progress)
    finally:
        if watch:
            watch.cancel()


@contextmanager
def pool_of(
    task: Task, workers: int, scheduler: str | None, dashboard: bool, progress: Progress
) -> Iterator[Pool]:
    """The pool that a run requests.

    Args:
        task: what is done with every batch.
        workers: processes on this machine, spawned; 0 for this process.
        scheduler: address of an existing dask scheduler; it overrides ``workers``.
        dashboard: whether to open dask's dashboard, on this machine alone.
        progress: called with a case's identifier and how many of its states are done.

    Raises:
        BadInput: if there is no scheduler at the address, or no way to end a case in time.
    """
    if scheduler is None and workers == 0:
        if task.case_timeout is not None and not hasattr(signal, "setitimer"):
            problem = "this system ends no case of this process in time; give workers = 1"
            raise fault(f"case_timeout {task.case_timeout:g}", problem)
        yield in_process(task, progress)
        return
    with (
        _client(workers, scheduler, dashboard) as client,
        dask_pool(client, task, progress) as pool,
    ):
        yield pool


def connected(scheduler: str) -> Client:
    """A client of an existing scheduler.

    Raises:
        BadInput: if there is none at the address.
    """
    try:
        return Client(scheduler, timeout=10)
    except (OSError, ValueError) as error:
        problem = f"no dask scheduler answers ({error}); check the address"
        raise fault(f"scheduler {scheduler}", problem) from error


@contextmanager
def _client(workers: int, scheduler: str | None, dashboard: bool) -> Iterator[Client]:
    if scheduler is not None:
        with connected(scheduler) as client:
            yield client
        return
    settings = {
        "distributed.nanny.pre-spawn-environ": WORKER_ENVIRONMENT,
        "distributed.worker.multiprocessing-method": "spawn",
        "distributed.worker.daemon": False,
        # A case that kills its worker would kill others; run_plan tries again, and alone.
        "distributed.scheduler.allowed-failures": 0,
        "distributed.scheduler.worker-saturation": 1.0,
        # A worker that died is started anew, however long that takes: dask would else give it up
        # after 15 s, and with the last of them the run would wait for ever.
        "distributed.deploy.lost-worker-timeout": "1 day",
        "distributed.worker.preload": ["knitlab.execution.quiet_worker"],
    }
    for name in ("distributed", "tornado"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    with (
        dask.config.set(settings),
        LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            # Any free port: a second run on this machine is no reason for a warning.
            dashboard_address="127.0.0.1:0",
            scheduler_kwargs={"dashboard": dashboard},
            silence_logs=logging.CRITICAL,
        ) as cluster,
        Client(cluster) as client,
    ):
        if dashboard:
            logging.getLogger(__name__).warning("dashboard  %s", cluster.dashboard_link)
        yield client
