import atexit
import ctypes
import os
import shutil
import tempfile

# Tests call the parts of knitlab directly; only the public functions set JAX to float64.
os.environ.setdefault("JAX_ENABLE_X64", "1")
# One thread per process, so that the tests can be distributed over one process per core.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("PJRT_NPROC", "1")
# Processes of a session load what another has compiled, which takes a tenth of the time.
if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
    os.environ["JAX_COMPILATION_CACHE_DIR"] = tempfile.mkdtemp(prefix="knitlab-compiled-")
    atexit.register(shutil.rmtree, os.environ["JAX_COMPILATION_CACHE_DIR"], ignore_errors=True)
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")

import pytest
from hypothesis import settings
from jaxtyping import install_import_hook

from tests.array_shapes import checked

# This must precede any import of knitlab.
install_import_hook("knitlab", f"{checked.__module__}.{checked.__name__}")

# A first example may compile a JAX program; benchmarks measure speed.
settings.register_profile("quick", deadline=None, max_examples=20)
settings.register_profile("thorough", deadline=None, max_examples=50)
settings.load_profile("quick")


def pytest_runtest_teardown(item, nextitem):
    """Return freed memory to the system after each file, which glibc else keeps: half of it."""
    if nextitem is None or nextitem.path != item.path:
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if os.name == "posix" else None
        if trim is not None:
            trim(0)


@pytest.fixture
def small_subdomains(monkeypatch):
    """Divides samples of some cells into subdomains, as only large ones are otherwise."""
    from knitlab.solvers.equilibrium import subdomains

    monkeypatch.setattr(subdomains, "CELLS", 8)
    monkeypatch.setattr(subdomains, "OVERLAP", 2)
    monkeypatch.setattr(subdomains, "MIN_SUBDOMAINS", 2)
