"""The benchmark for accelerators, on the processor."""

import os
import re
import subprocess
import sys

import pytest

from knitlab.io.shipped import PACKAGE


@pytest.mark.slow
def test_it_counts_simulations_and_compares_their_forces():
    # With contact, the variants of a batch end their steps together to list pairs anew, and their
    # steps are then of another length than those of a case by itself.
    small = (
        *("unit_cells=1,1", "contact=none"),
        *("relax_steps=300", "step_strain=1e-3", "strain_max=0.03"),
    )
    done = subprocess.run(
        [
            *(sys.executable, "-m", "benchmarks.accelerator", "--designs=1", "--variants=3"),
            *(f"--set={each}" for each in small),
        ],
        cwd=PACKAGE.parent,
        env=os.environ | {"JAX_PLATFORMS": "cpu"},
        capture_output=True,
        text=True,
    )
    assert not done.returncode, done.stderr
    device, core, compared = done.stdout.splitlines()
    assert re.fullmatch(r"cpu .*: 3 cases, \S+ a second", device)
    assert re.fullmatch(r"one core: 1 cases, \S+ a second", core)
    # A batch is summed in another order than a single case.
    assert float(compared.split()[-3]) < 1e-6
