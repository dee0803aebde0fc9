"""Workers for which the memory of this machine suffices."""

from collections.abc import Sequence

import psutil

from knitlab.io.errors import fault
from knitlab.sweep.plan import Batch


def workers_that_fit(batches: Sequence[Batch], workers: int, memory: float | None = None) -> int:
    """Number of workers whose batches fit into the memory together, at most as many as wished.

    Args:
        batches: the batches to come; any of them may run at the same time.
        workers: the number wished, 0 for this process.
        memory: memory of the machine [bytes]; by default that of this one.

    Raises:
        BadInput: if a single batch does not fit.
    """
    memory = float(psutil.virtual_memory().total) if memory is None else memory
    needs = sorted((batch.estimated_bytes for batch in batches), reverse=True)
    if needs and needs[0] > memory:
        raise fault(
            f"batch of {max(batch.unknowns for batch in batches):,} unknowns",
            f"needs about {needs[0] / 1e9:.1f} GB, and this machine has {memory / 1e9:.1f} GB;"
            " take fewer unit_cells or a larger machine",
        )
    while workers > 1 and sum(needs[:workers]) > memory:
        workers -= 1
    return workers
