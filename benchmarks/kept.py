"""Kept cubes against this code: one case of each is computed again and compared.

``python -m benchmarks.kept`` in the repository, or with names of kept cubes. The case with the
fewest unknowns is taken. A cube is left out where no workflow of its name makes it.
"""

import sys
import tempfile
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import knitlab as kl

KEPT = Path("results/reference")
COMPARED = ("poisson_ratio", "reaction_force", "capacitance")
NEGLIGIBLE = 1e-6
"""Largest difference, relative to the largest value of a curve, that counts as none."""


def smallest_case(workflow: str) -> dict[str, Any]:
    """The design of the case with the fewest unknowns, as settings."""
    cases = kl.plan(workflow).cases.values()
    smallest = min(cases, key=lambda case: case.mesh_shape.unknowns)
    return dict(smallest.design)


def largest_difference(kept: xr.Dataset, computed: xr.Dataset, design: dict[str, Any]) -> float:
    """The largest difference of the curves of one design, relative to the largest value of each."""
    differences = [0.0]
    for name in COMPARED:
        if name in kept and name in computed:
            before, now = (cube[name].sel(design).squeeze() for cube in (kept, computed))
            before, now = xr.align(before, now, join="inner")
            if bool((before.isnull() != now.isnull()).any()):
                return np.inf
            if bool(before.notnull().any()):
                differences.append(float(abs(now - before).max() / abs(before).max()))
    return max(differences)


def main(names: list[str]) -> int:
    """Compare the kept cubes of these names, or all, and print a line for each."""
    differing = 0
    for name in names or sorted(path.parent.name for path in KEPT.glob("*/cube.nc")):
        kept = kl.open_cube(KEPT / name)
        if kept.attrs.get("workflow") != name:
            print(f"{name:20} no workflow of this name makes it", flush=True)
            continue
        design = smallest_case(name)
        with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            computed = kl.run(name, **design, results=folder)
        difference = largest_difference(kept, computed, design)
        differing += difference > NEGLIGIBLE
        print(f"{name:20} {difference:9.1e}  {design}", flush=True)
    return differing


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
