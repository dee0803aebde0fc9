"""One design of each kept cube, computed again, has the numbers of the cube."""

import re
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from knitlab.observables.status import Status
from knitlab.runs.plan import make_plan
from knitlab.runs.run import run_plan
from knitlab.runs.run_options import RunOptions

ROOT = Path(__file__).parents[1]
REFERENCE = ROOT / "results" / "reference"
PAGE = (REFERENCE / "README.md").read_text(encoding="utf-8")
ROWS = re.findall(r"^\| `(\w+)` \| `knitlab run (.*?)` \| (\S+) \|$", PAGE, flags=re.MULTILINE)
"""Name, command and agreement of each cube that the page lists."""
OF_THE_SEARCH = re.compile("iterations|residual")  # how a solver went, not what it found


def case_and_kept(plan, cube):
    """The case of a plan that takes least time among those with results in a cube, and these."""
    batches = sorted(plan.batches, key=lambda batch: batch.estimated_seconds / len(batch.cases))
    for case_id in (case_id for batch in batches for case_id in batch.cases):
        kept = cube.sel(plan.cases[case_id].design)
        if int(kept["status"]) == Status.ok:
            return plan.cases[case_id], kept
    raise LookupError("the cube has results of no planned design")


def disagreement(again, kept):
    """Difference of each variable over its largest value, or over its unit if that is larger."""
    found = {}
    for name, old in kept.data_vars.items():
        if old.dtype.kind not in "fi" or OF_THE_SEARCH.search(str(name)):
            continue
        if name in again or old.notnull().any():  # else of other cases of the cube
            old, new = xr.align(old, again[name], join="left")
            old, new = old.values, new.transpose(*old.dims).values
            scale = np.abs(old).max(initial=1.0, where=np.isfinite(old))
            off = np.where(np.isnan(old) & np.isnan(new), 0.0, np.abs(new - old) / scale)
            found[str(name)] = float(off.max(initial=0.0))
    return found


@pytest.mark.slow
@pytest.mark.nightly
@pytest.mark.parametrize(("name", "command", "within"), ROWS, ids=[row[0] for row in ROWS])
def test_a_design_computed_again_agrees_with_the_kept_cube(
    name, command, within, tmp_path, monkeypatch
):
    monkeypatch.chdir(ROOT)
    workflow, *words = shlex.split(command)
    plan = make_plan(workflow, [word for word in words if word != "--set"])
    with xr.open_dataset(REFERENCE / name / "cube.nc") as cube:
        case, kept = case_and_kept(plan, cube.load())
    (batch,) = (batch for batch in plan.batches if case.case_id in batch.cases)
    one = replace(
        plan,
        cases={case.case_id: case},
        batches=(replace(batch, cases=(case.case_id,)),),
        excluded={},
    )
    again = run_plan(one, tmp_path, RunOptions(workers=0)).cube.sel(case.design)
    off = disagreement(again, kept)
    assert {key: value for key, value in off.items() if not value <= float(within)} == {}


def test_every_kept_cube_is_listed():
    listed = set(re.findall(r"^\| `(\w+)` \|", PAGE, flags=re.MULTILINE))
    assert {path.parent.name for path in REFERENCE.glob("*/*.nc")} == listed
