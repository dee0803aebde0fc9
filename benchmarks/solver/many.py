"""Many designs: a cold run of the paper's twenty through the command line, by some workers."""

import os
import subprocess
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.command_line import COMMAND
from benchmarks.solver.measurement import Measurement, Record
from knitlab.cubes.cube_file import open_cube
from knitlab.observables.schema import Status


def measure(measurement: Measurement) -> Record:
    """Time ``knitlab run`` for the set of designs that the measurement's solver names."""
    designs = f"set={measurement.size}"
    settings = ["--set", designs, "--workers", str(measurement.workers)]
    with TemporaryDirectory() as results:
        began = time.perf_counter()
        ran = subprocess.run(
            [*COMMAND, "run", "periodic", *settings, "--results", results],
            capture_output=True,
            text=True,
            env=os.environ | {"JAX_ENABLE_COMPILATION_CACHE": "false"},
        )
        seconds = time.perf_counter() - began
        if ran.returncode not in (0, 1):
            raise RuntimeError(ran.stderr)
        cube = open_cube(Path(results) / "periodic")
    done = int((cube["status"] == Status.ok).sum())
    values: Record = {
        "reached": ran.returncode == 0,
        "reason": "" if ran.returncode == 0 else "a design did not converge",
        "states": done * cube.sizes["applied_strain"],
        "designs": done,
        "residual": float(cube["residual_force"].max()),
        "evaluations": int(cube["iterations"].sum()),
    }
    return values | ({"seconds": seconds} if values["reached"] else {})
