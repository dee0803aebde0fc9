"""The limits of a job, by what a batch system or a container says."""

import os

import psutil
import pytest

from knitlab.io import job_limits
from knitlab.io.job_limits import memory, processors

MACHINE = float(psutil.virtual_memory().total)


@pytest.mark.parametrize(
    ("environment", "count"),
    [
        ({}, None),
        ({"SLURM_CPUS_PER_TASK": "1"}, 1),
        ({"SLURM_CPUS_ON_NODE": "1"}, 1),
        ({"SLURM_CPUS_PER_TASK": "1", "SLURM_CPUS_ON_NODE": "64"}, 1),
        ({"SLURM_CPUS_PER_TASK": "100000"}, None),
        ({"SLURM_CPUS_PER_TASK": "many"}, None),
    ],
)
def test_a_job_has_the_processors_that_slurm_gives_it(environment, count):
    assert processors(environment) == (count or processors({}))


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="needs affinities")
def test_a_job_has_the_processors_of_its_affinity():
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(before)})
    try:
        assert processors({}) == 1
    finally:
        os.sched_setaffinity(0, before)


@pytest.mark.parametrize(
    ("environment", "megabytes"),
    [
        ({"SLURM_MEM_PER_NODE": "300"}, 300),
        ({"SLURM_MEM_PER_CPU": "100", "SLURM_CPUS_ON_NODE": "4"}, 400),
        ({"SLURM_MEM_PER_NODE": "0"}, None),
        ({"SLURM_MEM_PER_NODE": "99999999999"}, None),
    ],
)
def test_a_job_has_the_memory_that_slurm_gives_it(environment, megabytes):
    assert memory(environment) == (megabytes * 2**20 if megabytes else memory({}))


def test_a_job_has_the_memory_of_its_control_group(tmp_path):
    (tmp_path / "memory.max").write_text("123456\n")
    assert min(job_limits._cgroup_memory(tmp_path)) == 123456
    (tmp_path / "memory.max").write_text("max\n")
    assert job_limits._cgroup_memory(tmp_path) == []
    assert 0 < memory({}) <= MACHINE
