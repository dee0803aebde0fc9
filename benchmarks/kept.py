"""Kept cubes against this code: one case of each is computed again and compared.

``python -m benchmarks.kept`` in the repository, or with names of kept cubes. The case with the
fewest unknowns is taken. A cube is left out where no workflow of its name makes it.
"""

import sys
import tempfile
import warnings
from pathlib import Path
from typing import Any

import knitlab as kl
from knitlab.runs.reproduce import largest_differences

KEPT = Path("results/reference")
NEGLIGIBLE = 1e-6  # largest difference that counts as none


def main(names: list[str]) -> int:
    """Compare the kept cubes of these names, or all, and print a line for each."""
    differing = 0
    for name in names or sorted(path.parent.name for path in KEPT.glob("*/cube.nc")):
        kept = kl.open_cube(KEPT / name)
        if kept.attrs.get("workflow") != name:
            print(f"{name:20} no workflow of this name makes it", flush=True)
            continue
        cases = kl.plan(name).cases.values()
        design: dict[str, Any] = dict(min(cases, key=lambda case: case.mesh_shape.unknowns).design)
        with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            computed = kl.run(name, **design, results=folder)
        new, old = (cube.sel(design, drop=True) for cube in (computed, kept))
        differ, same = largest_differences(new, old)
        difference = max(differ.values()) if same else float("inf")
        differing += difference > NEGLIGIBLE
        print(f"{name:20} {difference:9.1e}  {design}", flush=True)
    return differing


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
