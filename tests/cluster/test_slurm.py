"""Sweeps on a real SLURM: parts, some of them ended early, and a dask cluster of jobs."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import xarray as xr

import knitlab as kl
from tests.cluster.conftest import NODES
from tests.commands import knitlab

pytestmark = [pytest.mark.slow, pytest.mark.nightly]

SWEEP = {"n_stripe": 4, "n_subunit": 16, "k_t_factor": [0.8, 0.9, 1, 1.1, 1.2, 1.3]}
SWEEP |= {"strain_max": 0.06, "robustness": 0}


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    return kl.run("periodic", **SWEEP, results=tmp_path_factory.mktemp("plain"))


PARTS = 2
FOLDER = Path("results/periodic")


def words(**changes):
    """The sweep as options, with changed settings."""
    return [f"--set={name}={value}" for name, value in (SWEEP | changes).items()]


def submitted(*options):
    """The numbers of the two jobs of a submission of the sweep."""
    said = knitlab("submit", "periodic", *options)
    assert said.exit_code == 0, said.output
    return re.findall(r"^job +(\d+)", said.output, re.MULTILINE)


def cases(folder=FOLDER):
    """Case files of a results folder."""
    return list(folder.glob("cases/*.nc"))


def log(part):
    """What a part has printed."""
    return (FOLDER / "slurm" / f"{part}.log").read_text()


def assert_same(folder, plain):
    """The cube of a folder is the one of a plain run, up to rounding in batches of other sizes."""
    cube = kl.open_cube(folder)
    names = [name for name, values in cube.items() if values.dtype.kind != "O"]
    xr.testing.assert_allclose(cube[names], plain[names], rtol=1e-6)
    assert kl.status("periodic", results=folder.parent).counts == {"ok": plain["case_id"].size}


def test_the_parts_of_an_array_job_and_one_that_was_cancelled(slurm, plain):
    parts, last = submitted("--parts", PARTS, *words())
    slurm.wait_for(lambda: cases())
    slurm("scancel", last, f"{parts}_1")
    slurm.wait_for(lambda: slurm.ended(parts))
    assert slurm.states(parts) == {"1": "CANCELLED", "2": "COMPLETED"}
    assert "stopping" in log(1)
    assert 0 < len(cases()) < plain["case_id"].size
    again = slurm("sbatch", "--parsable", "--array=1", FOLDER / "submit.sh")
    slurm.wait_for(lambda: slurm.ended(again))
    assert_same(FOLDER, plain)
    figures = slurm("sbatch", "--parsable", "--array=0", FOLDER / "submit.sh")
    slurm.wait_for(lambda: slurm.ended(figures))
    assert "0 cases simulated" in log(0)
    assert list(FOLDER.glob("figures/*.png"))


def test_a_part_stops_before_its_time_limit(slurm):
    # SLURM signals two minutes before the limit, or up to one minute earlier.
    long = words(strain_max=0.6, strain_step=0.0025, robustness=8)
    part, _ = submitted("--parts", 1, *long, "--sbatch", "time=4")
    slurm.wait_for(lambda: slurm.ended(part))
    assert slurm.states(part) == {"1": "FAILED"}
    assert "stopping" in log(1)
    assert "TIME LIMIT" not in log(1)


def test_a_lost_node_is_replaced_by_the_other_one(slurm, plain):
    parts, last = submitted("--parts", PARTS, *words())
    slurm.wait_for(lambda: cases())
    slurm.lose_node("n2")
    slurm.wait_for(lambda: slurm.state_of("n2").startswith("down"))
    slurm.wait_for(lambda: slurm.ended(last))
    assert slurm.states(parts) == {"1": "COMPLETED", "2": "COMPLETED"}
    assert "Restarts=1" in slurm("scontrol", "show", "job", parts)
    assert_same(FOLDER, plain)
    slurm.start_node("n2")


def test_folders_of_their_own_are_merged(slurm, plain):
    part = f"$SLURM_ARRAY_TASK_ID/{PARTS}"
    run = [sys.executable, "-m", "knitlab", "run", "periodic", *words(), "--workers", "0"]
    wrapped = f"{shlex.join(run)} --shard {part} --results part-$SLURM_ARRAY_TASK_ID"
    job = slurm("sbatch", "--parsable", f"--array=1-{PARTS}", "--wrap", wrapped)
    slurm.wait_for(lambda: slurm.ended(job))
    said = knitlab("merge", "part-1", "part-2")
    assert said.exit_code == 0, said.output
    assert_same(FOLDER, plain)


def test_a_dask_cluster_of_jobs_runs_a_sweep_and_outlives_one(slurm, plain):
    jobqueue = pytest.importorskip("dask_jobqueue", reason="pip install dask-jobqueue")
    with jobqueue.SLURMCluster(
        cores=1,
        processes=1,
        memory="2GB",
        walltime="00:10:00",
        job_script_prologue=["export PJRT_NPROC=1 OMP_NUM_THREADS=1"],
        scheduler_options={"host": "127.0.0.1", "dashboard": False},
        interface="lo",
    ) as cluster:
        cluster.scale(jobs=len(NODES))
        program = [sys.executable, "-m", "knitlab", "run", "periodic", *words()]
        with subprocess.Popen([*program, "--scheduler", cluster.scheduler_address]) as run:
            slurm.wait_for(lambda: cases() or run.poll())
            slurm("scancel", "--nodelist", "n2")
    assert run.returncode == 0
    assert_same(FOLDER, plain)
