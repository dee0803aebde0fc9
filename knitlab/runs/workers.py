"""Workers: batches are simulated in this process, or by dask, which is imported only then.

Signals that end a process are handled like Ctrl-C.
"""

import logging
import os
import signal
import socket
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

import dask

from knitlab.io.errors import MachineError, invalid
from knitlab.io.job_limits import ONE_THREAD
from knitlab.solvers.case import Case
from knitlab.solvers.method import Progress

if TYPE_CHECKING:
    from distributed import Client

# One thread per worker, except for Task.threads; and a compiled program cached on disk must not
# contain host callbacks.
WORKER_ENVIRONMENT = ONE_THREAD | {
    "EQX_ON_ERROR": "nan",
    # glibc keeps the memory of large arrays: a sixth of the processor time of 249,000 nodes.
    "MALLOC_ARENA_MAX": "1",
    "MALLOC_MMAP_THRESHOLD_": str(2**32),
    "MALLOC_TRIM_THRESHOLD_": str(2**34),
}
PROGRESS_TOPIC = "knitlab-progress"
TIMED_OUT = ".timed-out-"  # prefix of the marker files that workers leave on a timeout
ENDING = [each for each in signal.Signals if each.name in ("SIGINT", "SIGTERM", "SIGHUP")]
"""Ctrl-C; what a batch system or ``kill`` sends; and a closed terminal."""
QUIET = """import logging, signal
signal.signal(signal.SIGINT, signal.SIG_IGN)
logging.getLogger("distributed").setLevel(logging.CRITICAL)
"""
"""Run by dask's workers at their start: they ignore Ctrl-C and log nothing."""
SECONDS_TO_ANSWER = 2.0  # longest time until a scheduler sends its first byte
LOGGERS = ("distributed", "tornado")
SCRIPT_NAMES = ("__file__", "__spec__")
"""Names by which a process that is spawned would find the user's script and run it again; workers
need nothing of it."""
ENDED = ("finished", "error")  # states of a dask task whose scheduler still runs

Batch = Sequence[Case]
Simulate = Callable[[Path, Batch, Progress], None]  # an importable function that writes case files


class SchedulerLost(Exception):
    """The dask scheduler ended, or cannot be reached."""


@dataclass(frozen=True)
class BatchError:
    """Why a batch has no results: what was raised; it is ``lost`` if its worker died."""

    reason: str
    trace: str = ""
    lost: bool = False
    machine_error: MachineError | None = None  # not caused by a design

    @classmethod
    def of(cls, error: BaseException) -> "BatchError":
        """The type, message and innermost frame of an exception."""
        frames = traceback.extract_tb(error.__traceback__)
        line = f" ({Path(frames[-1].filename).name}:{frames[-1].lineno})" if frames else ""
        return cls(
            f"{type(error).__name__}: {error}{line}",
            "".join(traceback.format_exception(error)),
            machine_error=error if isinstance(error, MachineError) else None,
        )


Pool = Callable[[Sequence[Batch]], Iterator[tuple[Batch, BatchError | None]]]
"""Simulates batches and yields each when it ends, with its error if there was one."""


@dataclass(frozen=True)
class Task:
    """How every batch is simulated, each case in a longest time [s]."""

    simulate: Simulate
    results: Path
    case_timeout: float | None = None
    threads: int = 1

    def limit(self, batch: Batch) -> float | None:
        """Longest time for a batch [s]."""
        return self.case_timeout and self.case_timeout * len(batch)

    def late(self, batch: Batch) -> BatchError:
        """The error of a batch that timed out."""
        return BatchError(f"it took longer than {self.limit(batch):g} s (case_timeout)")

    def marker(self, batch: Batch) -> Path:
        """Marker file that a worker leaves when a batch times out."""
        return self.results / f"{TIMED_OUT}{batch[0].case_id}"


@contextmanager
def worker_pool(
    task: Task, workers: int, scheduler: str | None, dashboard: bool, progress: Progress
) -> Iterator[Pool]:
    """The pool for a run: a dask scheduler, processes of this machine, or with 0 this process."""
    if scheduler is not None or workers:
        started = connected(scheduler) if scheduler is not None else _started(workers, dashboard)
        with started as client, _dask_pool(client, task, progress) as pool:
            yield pool
        return
    if task.case_timeout is not None and not hasattr(signal, "setitimer"):
        message = "this system ends no case of this process in time; give workers = 1"
        raise invalid(f"case_timeout {task.case_timeout:g}", message)

    def simulated(batches: Sequence[Batch]) -> Iterator[tuple[Batch, BatchError | None]]:
        for batch in batches:
            error = None
            try:
                with _alarm(task.limit(batch)):
                    task.simulate(task.results, batch, progress)
            except TimeoutError:
                error = task.late(batch)
            except Exception as raised:  # whatever a batch raises must not end the sweep
                error = BatchError.of(raised)
            yield batch, error

    yield simulated


@contextmanager
def _alarm(seconds: float | None) -> Iterator[None]:
    """Raise TimeoutError after a time; a compiled program that is running is completed first."""

    def ring(number: int, frame: FrameType | None) -> None:
        raise TimeoutError

    if seconds is None:
        yield
        return
    before = signal.signal(signal.SIGALRM, ring)
    try:
        # Repeatedly, because an exception raised in a callback may be lost.
        signal.setitimer(signal.ITIMER_REAL, seconds, max(seconds, 1.0))
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


@contextmanager
def _dask_pool(client: "Client", task: Task, progress: Progress) -> Iterator[Pool]:
    """A pool on a dask cluster; progress is reported as events of the scheduler."""
    from distributed import KilledWorker, as_completed

    def explained(batch: Batch, error: BaseException) -> BatchError:
        if not isinstance(error, KilledWorker):
            return BatchError.of(error)
        if not (marker := task.marker(batch)).exists():
            return BatchError("its worker died: it was killed, or it ran out of memory", lost=True)
        marker.unlink()
        return task.late(batch)

    def simulated(batches: Sequence[Batch]) -> Iterator[tuple[Batch, BatchError | None]]:
        futures = {
            client.submit(simulate_on_worker, task, batch, pure=False): batch for batch in batches
        }
        try:
            for future in as_completed(list(futures)):
                if future.status not in ENDED:
                    raise SchedulerLost
                batch, error = futures.pop(future), future.exception()
                yield batch, explained(batch, error) if error else None
        finally:
            client.cancel(list(futures), force=True)

    client.subscribe_topic(PROGRESS_TOPIC, lambda event: progress(*event[1]))
    try:
        yield simulated
    finally:
        with suppress(Exception):  # the scheduler may be gone already
            client.unsubscribe_topic(PROGRESS_TOPIC)


def simulate_on_worker(task: Task, batch: Batch) -> None:
    """The dask task: simulate a batch and log its progress; on a timeout the process exits."""
    from distributed import get_worker

    worker = get_worker()
    if task.threads > 1:
        # Not through the cluster's settings, which this process's own variables would override.
        os.environ["OMP_NUM_THREADS"] = str(task.threads)

    def give_up() -> None:
        task.marker(batch).touch()
        os._exit(1)

    watch = threading.Timer(task.limit(batch) or threading.TIMEOUT_MAX, give_up)
    watch.daemon = True
    watch.start()
    try:
        # On a worker, xarray would request a lock from the scheduler for every variable it writes.
        with dask.config.set(scheduler="synchronous"):
            task.simulate(
                task.results, batch, lambda *event: worker.log_event(PROGRESS_TOPIC, event)
            )
    finally:
        watch.cancel()


def connected(scheduler: str) -> "Client":
    """A client of an existing scheduler; InputError if none answers."""
    from distributed import Client
    from distributed.comm.addressing import get_address_host_port

    try:
        if scheduler.partition("://")[0] not in ("tls", "ws", "wss"):
            # A scheduler sends at once; dask would wait indefinitely for another service.
            place = get_address_host_port(scheduler)
            with socket.create_connection(place, SECONDS_TO_ANSWER) as line:
                line.recv(1)
        return Client(scheduler, timeout=10)
    except (OSError, ValueError) as error:
        message = f"no dask scheduler answers ({error}); check the address"
        raise invalid(f"scheduler {scheduler}", message) from error


@contextmanager
def _started(workers: int, dashboard: bool) -> Iterator["Client"]:
    """A client of processes on this machine, which end with it; InputError if they cannot start."""
    settings = {
        "distributed.nanny.pre-spawn-environ": WORKER_ENVIRONMENT,
        "distributed.worker.multiprocessing-method": "spawn",
        "distributed.worker.daemon": False,
        # A case that kills its worker would kill others; run_plan itself tries again, and alone.
        "distributed.scheduler.allowed-failures": 0,
        "distributed.scheduler.worker-saturation": 1.0,
        # The plan makes sure that all workers fit; one that keeps its memory would pause.
        "distributed.worker.memory.pause": False,
        # By default dask gives up restarting a worker after 15 s, and the run would wait.
        "distributed.deploy.lost-worker-timeout": "1 day",
        "distributed.worker.preload": [QUIET],
    }
    with ExitStack() as stack:
        stack.enter_context(_as_before())
        from distributed import Client, LocalCluster  # sets levels of loggers

        stack.enter_context(dask.config.set(settings))
        for name in LOGGERS:
            logging.getLogger(name).setLevel(logging.CRITICAL)
        vars(sys.modules["__main__"]).update(dict.fromkeys(SCRIPT_NAMES))
        try:
            cluster = LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                host="127.0.0.1",
                # Any free port, so that a second run on this machine causes no warning.
                dashboard_address="127.0.0.1:0",
                scheduler_kwargs={"dashboard": dashboard},
                silence_logs=logging.CRITICAL,
            )
            client = stack.enter_context(Client(stack.enter_context(cluster)))
        except Exception as error:  # many types, if a process is killed or there are few files
            message = f"cannot be started ({error}); run again, with fewer workers or 0 for none"
            raise invalid(f"workers {workers}", message) from error
        if dashboard:
            logging.getLogger(__name__).warning("dashboard  %s", cluster.dashboard_link)
        yield client


@contextmanager
def _as_before() -> Iterator[None]:
    """Put back what dask and this module change in the user's process to start workers."""
    environment = dict(os.environ)
    levels = {name: logging.getLogger(name).level for name in LOGGERS}
    script = vars(sys.modules["__main__"])
    named = {name: script[name] for name in SCRIPT_NAMES if name in script}
    try:
        yield
    finally:
        for name in os.environ.keys() - environment.keys():
            del os.environ[name]
        os.environ.update(environment)
        for name, level in levels.items():
            logging.getLogger(name).setLevel(level)
        for name in SCRIPT_NAMES:
            script.pop(name, None)
        script.update(named)


@contextmanager
def interrupted_by_signals() -> Iterator[threading.Event]:
    """Raise KeyboardInterrupt on signals that end a process, and set the event.

    Python may lose an exception that is raised within an import.
    """
    asked = threading.Event()

    def interrupt(number: int, frame: FrameType | None) -> None:
        asked.set()
        raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        yield asked
        return
    before = {
        number: signal.signal(number, interrupt)
        for number in ENDING
        if signal.getsignal(number) is not signal.SIG_IGN
    }
    try:
        yield asked
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
