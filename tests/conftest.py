import os

# One thread a process, so that as many processes as there are processors can share the tests.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("PJRT_NPROC", "1")

from hypothesis import settings
from jaxtyping import install_import_hook

from tests.array_shapes import checked

# Before anything imports knitlab.
install_import_hook("knitlab", f"{checked.__module__}.{checked.__name__}")

# A first example may compile a JAX program; speed is the benchmark's business.
settings.register_profile("quick", deadline=None, max_examples=20)
settings.register_profile("thorough", deadline=None, max_examples=100)
settings.load_profile("quick")
