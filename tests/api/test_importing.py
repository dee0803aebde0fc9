"""``import knitlab`` alone changes nothing; whatever computes does so in float64."""

import os
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest

from knitlab.io.shipped import PACKAGE
from knitlab.model.stripe import Stripe
from knitlab.model.zigzag import tension, zigzag

CUBE = "results/reference/periodic/cube.nc"


def printed(program, **environment):
    """What a new process prints; warnings are errors."""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", program],
        env=os.environ | environment,
        cwd=PACKAGE.parent,
        capture_output=True,
        text=True,
    )
    assert not done.returncode, done.stderr
    return done.stdout.strip()


@pytest.mark.parametrize(
    ("program", "missing"),
    [
        # Nor is SciPy, but by xarray before 2026.4.
        ("import knitlab; assert before == os.environ", {"jax", "matplotlib", "dask"}),
        ("sys.argv[0] = 'knitlab'; import knitlab.cli", {"jax", "pandas", "xarray", "matplotlib"}),
        ("import knitlab.cli, knitlab.api.cubes", {"jax", "trimesh", "matplotlib"}),
        (f"import knitlab; knitlab.query({CUBE!r}, where='n_stripe > 4')", {"jax", "matplotlib"}),
    ],
)
def test_libraries_that_are_not_used_are_not_imported(program, missing):
    before = "import os, sys; before = dict(os.environ)"
    after = f"print(sorted({missing} & set(sys.modules)))"
    assert printed(f"{before}; {program}; {after}") == "[]"


def test_it_leaves_the_settings_of_jax_and_the_users_folder_as_they_are(tmp_path):
    program = """
import jax
before = dict(jax.config.values)
import knitlab
assert knitlab.__version__
assert before == dict(jax.config.values)
print(jax.config.jax_enable_x64, jax.config.jax_compilation_cache_dir)
"""
    home = {"HOME": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path), "JAX_ENABLE_X64": "0"}
    chosen = {"JAX_COMPILATION_CACHE_DIR": str(tmp_path / "own")}
    assert printed(program, **home, **chosen) == f"False {tmp_path / 'own'}"
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_a_new_worker_process_computes_in_float64():
    stripe = Stripe("rib", 4, period=1.41, k_s=0.8, theta_0=0.8, k_t=0.01)
    strain = np.linspace(0.1, 1, 5)
    here = np.asarray(tension(zigzag(stripe), strain))
    with ProcessPoolExecutor(1, get_context("spawn")) as worker:
        there = np.asarray(worker.submit(tension, zigzag(stripe), strain).result())
    assert there.dtype == np.float64
    # Single precision would differ by 1e-7.
    np.testing.assert_allclose(there, here, rtol=1e-12)


@pytest.mark.parametrize(
    "imported",
    [
        "import knitlab as kl, xarray as xr",
        "import xarray as xr, knitlab as kl",
        "import knitlab as kl, importlib; importlib.reload(kl); import xarray as xr",
    ],
)
def test_cubes_that_xarray_opened_have_the_accessor(imported):
    program = f"""
{imported}
found = xr.load_dataset({CUBE!r}).knitlab.query("poisson_ratio_min < -0.8")
assert found.equals(kl.query({CUBE!r}, where="poisson_ratio_min < -0.8"))
print(len(found), type(xr.__loader__).__name__)
"""
    assert printed(program) == "5 SourceFileLoader"


def test_the_package_runs_as_the_command_line():
    def ran(*words):
        return subprocess.run([sys.executable, *words], capture_output=True, text=True)

    script = "import sys; sys.argv[0] = 'knitlab'; from knitlab.cli import main; main()"
    for arguments in (["--help"], ["query", "nowhere.nc"], ["query", "--wrong"]):
        one, other = ran("-m", "knitlab", *arguments), ran("-c", script, *arguments)
        assert (one.returncode, one.stdout, one.stderr) == (
            other.returncode,
            other.stdout,
            other.stderr,
        )
        assert one.returncode == (0 if arguments == ["--help"] else 2)
        assert "knitlab" in one.stdout + one.stderr
        assert "Traceback" not in one.stderr
