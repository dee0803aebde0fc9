"""Programs that JAX has compiled are kept in the user's cache folder, for all runs and workers."""

import hashlib
import os
import platform
from contextlib import suppress
from pathlib import Path

import jax
from filelock import FileLock, Timeout
from platformdirs import user_cache_path

LARGEST = 512 * 2**20
"""Size of all programs that are kept; those not used for longest are removed [bytes]. With a limit,
JAX holds a lock while it reads or writes, which several workers need."""


def keep_compiled_programs() -> None:
    """Keep compiled programs, unless the user has set JAX's cache or the folder cannot be written.

    ``JAX_COMPILATION_CACHE_DIR`` names another folder, and ``JAX_ENABLE_COMPILATION_CACHE=0`` keeps
    none.
    """
    if getattr(jax.config, "jax_compilation_cache_dir", None) is not None:
        return
    folder = user_cache_path("knitlab") / "compiled" / _kind_of_program()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return
    if not os.access(folder, os.W_OK):
        return
    _remove_incomplete(folder)
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_compilation_cache_max_size", LARGEST)
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)


def _remove_incomplete(folder: Path) -> None:
    """Remove programs whose process was killed while it wrote them.

    JAX writes the time of use after the program, and would warn of its lack for ever.
    """
    if not any(folder.glob("*-atime")):
        return
    with suppress(OSError, Timeout), FileLock(folder / ".lockfile", timeout=1):
        for path in folder.glob("*-cache"):
            date = path.with_name(f"{path.name.removesuffix('-cache')}-atime")
            if not date.exists():
                path.unlink(missing_ok=True)


def _kind_of_program() -> str:
    """Version of JAX, processor and threads.

    Programs of one processor may crash on another, and XLA decides on parallel loops as it
    compiles: a program of one thread stays one where there are more.
    """
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    features = next((line for line in lines if line.startswith(("flags", "Features"))), "")
    processor = " ".join((platform.machine(), platform.processor(), features))
    digest = hashlib.sha256(processor.encode()).hexdigest()[:12]
    return f"jax-{jax.__version__}-{digest}-threads-{_threads()}"


def _threads() -> int:
    """Threads that XLA may use: ``PJRT_NPROC``, or all processors of the process."""
    text = os.environ.get("PJRT_NPROC", "")
    if text.isdecimal() and int(text) > 0:
        return int(text)
    # Not every system reports which processors a process may use.
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
