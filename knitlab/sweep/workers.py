"""Workers: where batches are simulated, in this process or by dask."""

import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import dask
from distributed import Client, LocalCluster, as_completed, get_worker

from knitlab.sweep.case import Case
from knitlab.sweep.faults import fault
from knitlab.sweep.simulation import Progress, simulate_batch

# One thread a worker, and a solve cached on disk must not hold host callbacks.
WORKER_ENVIRONMENT = {
    "PJRT_NPROC": "1",
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "EQX_ON_ERROR": "nan",
}
PROGRESS_TOPIC = "knitlab-progress"


@dataclass(frozen=True)
class BatchError:
    """Why a batch has no results."""

    reason: str

    @classmethod
    def of(cls, error: BaseException) -> "BatchError":
        """Describe an exception by its type, message and innermost frame."""
        frame = traceback.extract_tb(error.__traceback__)[-1]
        place = f"{Path(frame.filename).name}:{frame.lineno}"
        return cls(f"{type(error).__name__}: {error} ({place})")


Batch = Sequence[Case]
Pool = Callable[[Path, Sequence[Batch]], Iterator[tuple[Batch, BatchError | None]]]
"""Simulates batches and yields each as it ends, with the error that ended it if any."""


def in_process(progress: Progress) -> Pool:
    """A pool that simulates in this process, one batch after the other."""

    def simulate(
        results: Path, batches: Sequence[Batch]
    ) -> Iterator[tuple[Batch, BatchError | None]]:
        for batch in batches:
            try:
                simulate_batch(results, batch, progress)
            except Exception as error:  # whatever a batch raises must not end the sweep
                yield batch, BatchError.of(error)
            else:
                yield batch, None

    return simulate


@contextmanager
def dask_pool(client: Client, progress: Progress) -> Iterator[Pool]:
    """A pool on a dask cluster; progress comes back as events of the scheduler."""

    def heard(event: tuple[float, tuple[str, int]]) -> None:
        progress(*event[1])

    def simulate(
        results: Path, batches: Sequence[Batch]
    ) -> Iterator[tuple[Batch, BatchError | None]]:
        futures = {
            client.submit(simulate_on_worker, results, batch, pure=False): batch
            for batch in batches
        }
        for future in as_completed(list(futures)):
            error = future.exception()
            yield futures.pop(future), BatchError.of(error) if error else None

    client.subscribe_topic(PROGRESS_TOPIC, heard)
    try:
        yield simulate
    finally:
        client.unsubscribe_topic(PROGRESS_TOPIC)


def simulate_on_worker(results: Path, batch: Batch) -> None:
    """The dask task: simulate a batch and log its progress as events."""
    worker = get_worker()

    def progress(case_id: str, states: int) -> None:
        worker.log_event(PROGRESS_TOPIC, (case_id, states))

    simulate_batch(results, batch, progress)


@contextmanager
def pool_of(workers: int, scheduler: str | None, progress: Progress) -> Iterator[Pool]:
    """The pool that a run asked for.

    Args:
        workers: processes on this machine, spawned, one thread each; 0 for this process.
        scheduler: address of an existing dask scheduler; it overrides ``workers``.
        progress: told, for a case, how many of its states are done.

    Raises:
        BadInput: if there is no scheduler at the address.
    """
    if scheduler is None and workers == 0:
        yield in_process(progress)
        return
    with _client(workers, scheduler) as client, dask_pool(client, progress) as pool:
        yield pool


@contextmanager
def _client(workers: int, scheduler: str | None) -> Iterator[Client]:
    if scheduler is not None:
        try:
            client = Client(scheduler, timeout=10)
        except (OSError, ValueError) as error:
            problem = f"no dask scheduler answers ({error}); check the address"
            raise fault(f"--scheduler {scheduler}", problem) from error
        with client:
            yield client
        return
    settings = {
        "distributed.nanny.pre-spawn-environ": WORKER_ENVIRONMENT,
        "distributed.worker.multiprocessing-method": "spawn",
        "distributed.worker.daemon": False,
    }
    with (
        dask.config.set(settings),
        LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            # Any free port: a second run on this machine is no reason for a warning.
            dashboard_address="127.0.0.1:0",
        ) as cluster,
        Client(cluster) as client,
    ):
        yield client
