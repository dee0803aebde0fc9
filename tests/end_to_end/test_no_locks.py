"""File systems without locks, by a library that makes flock fail, and cubes that others write."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import xarray as xr

from knitlab.cubes.cube_file import read_cube
from tests.refusals import refused

ROOT = Path(__file__).parents[2]
PREVIEW = ROOT / "results/reference/preview/cube.nc"
TWO = ("--set", "n_stripe=4", "--set", "n_subunit=8,16", "--set", "strain_max=0.06")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform != "linux", reason="preloads a library"),
]


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    if shutil.which("gcc") is None:
        pytest.skip("gcc is not installed")
    path = tmp_path_factory.mktemp("library") / "noflock.so"
    source = Path(__file__).with_name("noflock.c")
    subprocess.run(["gcc", "-shared", "-fPIC", "-o", path, source], check=True)
    return path


@pytest.fixture
def knitlab(library, tmp_path):
    def knitlab(*words):
        command = [sys.executable, "-c", "from knitlab.cli import main; main()", *words]
        paths = {"PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])}
        # A cache of JAX has locks of its own.
        own = {"JAX_COMPILATION_CACHE_DIR": ""} | paths | {"LD_PRELOAD": str(library)}
        environment = os.environ | own
        return subprocess.run(
            command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )

    return knitlab


def test_a_cube_is_read_without_a_lock(knitlab):
    said = knitlab("query", str(PREVIEW), "--columns", "n_stripe", "--format", "csv")
    assert (said.returncode, len(said.stderr.splitlines())) == (0, 1)  # that of the model
    assert said.stdout.split()[:2] == ["n_stripe", "2"]


@pytest.mark.nightly
def test_parts_run_in_folders_of_their_own_and_are_merged(knitlab, tmp_path):
    quick = ("run", "periodic", *TWO, "--set", "robustness=0", "--workers", "0")
    for number in ("1", "2"):
        said = knitlab(*quick, "--shard", f"{number}/2", "--results", number)
        assert said.returncode == 0, said.stderr
        assert "Warning" not in said.stderr
    again = knitlab(*quick, "--shard", "2/2", "--results", "2")
    assert "0 cases simulated, 1 already there" in again.stdout, again.stderr
    beside = knitlab(*quick, "--shard", "1/2", "--results", "2")
    assert beside.returncode == 2
    assert "locks" in beside.stderr
    merged = knitlab("merge", "1", "2", "--results", "both")
    assert "2 designs: 2 ok" in merged.stdout, merged.stderr
    assert (xr.load_dataset(tmp_path / "both/periodic/cube.nc")["status"] == 1).all()


WRITER = "import sys, netCDF4; d = netCDF4.Dataset(sys.argv[1], 'a'); print(flush=True); input()"


def test_a_cube_that_another_program_writes_is_refused_as_locked(tmp_path):
    path = shutil.copy(PREVIEW, tmp_path)
    command = [sys.executable, "-c", WRITER, path]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as writer:
        writer.stdout.readline()
        with refused("HDF5_USE_FILE_LOCKING=FALSE"):
            read_cube(path)
        writer.communicate(b"\n")
    assert "status" in read_cube(path)
