"""Programs that JAX has compiled are kept in the user's cache folder, for all runs and workers."""

import hashlib
import platform
from contextlib import suppress
from functools import cache
from pathlib import Path

import jax
from filelock import FileLock, Timeout
from platformdirs import user_cache_path

from knitlab.io.atomic_write import can_write_into
from knitlab.io.job_limits import threads

MAX_CACHE_SIZE = 512 * 2**20
"""Size of all programs that are kept; those not used for longest are removed [bytes]. With a limit,
JAX holds a lock while it reads or writes, which several workers need."""


def cache_flags() -> dict[str, object]:
    """Flags of JAX that keep compiled programs; none if the user has named a folder for them."""
    is_named = getattr(jax.config, "jax_compilation_cache_dir", None) is not None
    return {} if is_named else _own_cache()


@cache
def _own_cache() -> dict[str, object]:
    """Flags for a folder among the user's caches, for all runs and workers."""
    folder = user_cache_path("knitlab") / "compiled" / _kind_of_program()
    if not can_write_into(folder):
        return {}
    # JAX writes the time of use after the program, and would warn every time of programs without
    # it, whose process was killed while it wrote them.
    try:
        with FileLock(folder / ".lockfile", timeout=1):
            for program in folder.glob("*-cache"):
                if not program.with_name(f"{program.name.removesuffix('-cache')}-atime").exists():
                    program.unlink(missing_ok=True)
    except Timeout:
        pass
    except OSError:  # without locks, JAX would warn of every program
        return {}
    return {
        "jax_compilation_cache_dir": str(folder),
        "jax_compilation_cache_max_size": MAX_CACHE_SIZE,
        "jax_persistent_cache_min_compile_time_secs": 0.0,
    }


def _kind_of_program() -> str:
    """JAX's version, the processor (programs may crash on another), and the number of threads."""
    features = ""
    with suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        features = next((line for line in lines if line.startswith(("flags", "Features"))), "")
    processor = " ".join((platform.machine(), platform.processor(), features))
    digest = hashlib.sha256(processor.encode()).hexdigest()[:12]
    return f"jax-{jax.__version__}-{digest}-threads-{threads('PJRT_NPROC')}"
