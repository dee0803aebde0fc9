"""One measurement, in this process: ``python -m benchmarks.solver.one JSON RESULTS``."""

import json
import resource
import sys
from datetime import UTC, datetime
from pathlib import Path

from benchmarks.solver import limit, many, methods
from benchmarks.solver.cube import blas_kernels, cpu_model
from benchmarks.solver.measurement import Measurement
from knitlab.io.provenance import git_commit

MEASURES = {
    "tuning": methods.measure,
    "relaxation": methods.measure,
    "tension": methods.measure,
    "shipped_relaxation": methods.measure_shipped,
    "iteration": limit.measure,
    "sweep": many.measure,
}


def main(text: str, results: str) -> None:
    """Make a measurement and leave its record."""
    measurement = Measurement(**json.loads(text))
    values = MEASURES[measurement.task](measurement)
    who = resource.RUSAGE_CHILDREN if measurement.task == "sweep" else resource.RUSAGE_SELF
    values |= {
        "peak_memory": resource.getrusage(who).ru_maxrss * 1024,
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "git_commit": git_commit(),
        "cpu_model": cpu_model(),
        "blas_kernels": blas_kernels(),
    }
    measurement.write(Path(results), values)


if __name__ == "__main__":
    main(*sys.argv[1:])
