"""Results are the same on any CPU, with any number of threads, alone or in a batch."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from knitlab.observables.measurement import measured
from knitlab.runs.plan import make_plan
from knitlab.runs.simulate import tensile_tests

ROOT = Path(__file__).parents[2]
SAME = 1e-3
DESIGNS = ("strain_max=0.45", "strain_step=0.15", "robustness=0")
KERNELS = {"Sandybridge": "avx", "Haswell": "avx2", "SkylakeX": "avx512f"}
"""Kernels of OpenBLAS, and the CPU features that they need."""


def ratios(cases):
    """Poisson's ratios of cases of one mesh shape, by identifier."""
    tests = tensile_tests(cases, lambda *_: None)
    found = {}
    for case, test in zip(cases, tests, strict=True):
        results = measured(case, test)
        assert int(results["status"]) == 1
        found[case.case_id] = results["poisson_ratio"].values[1:].tolist()
    return found


def batches():
    plan = make_plan("periodic", DESIGNS)
    return [[plan.cases[case_id] for case_id in batch.cases] for batch in plan.batches]


def elsewhere(kernel, threads):
    """Ratios of the preview's designs in another process."""
    environment = os.environ | {"OPENBLAS_CORETYPE": kernel, "OMP_NUM_THREADS": str(threads)}
    command = [sys.executable, "-m", "tests.end_to_end.test_same_everywhere"]
    said = subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True, check=True
    )
    return json.loads(said.stdout.splitlines()[-1])


def largest_difference(one, other):
    assert one.keys() == other.keys()
    return max(np.abs(np.subtract(one[name], other[name])).max() for name in one)


@pytest.fixture(scope="module")
def usual():
    return elsewhere("Haswell", threads=1)


def runs_here(kernel):
    return KERNELS[kernel] in Path("/proc/cpuinfo").read_text(encoding="utf-8").split()


needs_linux = pytest.mark.skipif(
    not Path("/proc/cpuinfo").is_file(), reason="this system does not say what its processor knows"
)


@pytest.mark.slow
@pytest.mark.nightly
@needs_linux
@pytest.mark.parametrize(("kernel", "threads"), [("Sandybridge", 2), ("SkylakeX", 1)])
def test_threads_and_kernels_do_not_change_the_ratios_of_the_preview(usual, kernel, threads):
    if not runs_here(kernel):
        pytest.skip(f"this processor does not know {KERNELS[kernel]}")
    assert len(usual) == 10
    assert largest_difference(usual, elsewhere(kernel, threads)) < SAME


@pytest.mark.slow
def test_a_case_has_the_same_ratios_alone_and_in_a_batch():
    # The shortest one: batches begin with the longest.
    together = next(batch for batch in reversed(batches()) if len(batch) > 2)
    in_batch = ratios(together)
    alone = {}
    for case in together:
        alone |= ratios([case])
    assert largest_difference(alone, in_batch) < SAME


if __name__ == "__main__":
    everything = {}
    for batch in batches():
        everything |= ratios(batch)
    print(json.dumps(everything))
