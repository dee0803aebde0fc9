"""Processors and memory of this job, which may be fewer than those of the machine.

A batch system, a container or ``taskset`` limits a job; every number of workers, threads and bytes
that knitlab chooses itself comes from here.
"""

import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

ONE_THREAD = {
    "PJRT_NPROC": "1",
    "JAX_CPU_ENABLE_ASYNC_DISPATCH": "false",  # JAX then computes in the thread that calls it
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
}
"""Environment of a process limited to one thread."""
MEGABYTE = 2.0**20  # unit of SLURM's variables


def processors(environment: Mapping[str, str] = os.environ) -> int:
    """Processors of this job: by its affinity, its cgroup and SLURM."""
    from dask.system import cpu_count

    stated = _number(environment, "SLURM_CPUS_PER_TASK", "SLURM_CPUS_ON_NODE")
    return min(cpu_count(), int(stated)) if stated else cpu_count()


def memory(environment: Mapping[str, str] = os.environ) -> float:
    """Memory of this job: by the machine, its cgroup and SLURM [bytes]."""
    import psutil

    limits = [float(psutil.virtual_memory().total), *_cgroup_memory()]
    each = _number(environment, "SLURM_MEM_PER_CPU") * _number(environment, "SLURM_CPUS_ON_NODE")
    if stated := _number(environment, "SLURM_MEM_PER_NODE") or each:
        limits.append(stated * MEGABYTE)
    return min(limits)


def threads(variable: str = "OMP_NUM_THREADS") -> int:
    """Threads that this process may use: by an environment variable, or all processors."""
    return int(_number(os.environ, variable)) or processors()


def _cgroup_memory(root: Path = Path("/sys/fs/cgroup")) -> list[float]:
    """Limits of the control groups that this process is in, and of its container [bytes]."""
    files = [root / "memory.max", root / "memory" / "memory.limit_in_bytes"]
    with suppress(OSError):
        for line in Path("/proc/self/cgroup").read_text(encoding="utf-8").splitlines():
            group = root / line.rpartition(":")[2].lstrip("/")
            files += [folder / "memory.max" for folder in (group, *group.parents)]
    limits = []
    for file in files:
        with suppress(OSError, ValueError):  # absent, or "max"
            limits.append(float(file.read_text(encoding="utf-8")))
    return limits


def _number(environment: Mapping[str, str], *names: str) -> float:
    """The first of some variables that is a number above 0; else 0."""
    texts = (environment.get(name, "") for name in names)
    return next((float(text) for text in texts if text.isdecimal() and int(text)), 0.0)
