"""Candidates: the best trial of each search, simulated again with perturbed copies, and ranked."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from jaxtyping import Float

from knitlab.cubes.find import Found, find_designs
from knitlab.cubes.target import Target
from knitlab.design.objective import Objective, tolerance
from knitlab.design.request import DesignRequest
from knitlab.design.search import TRIALS, SearchResult
from knitlab.design.search_space import SearchSpace
from knitlab.design.trial import ShapeFunctions, run_trial
from knitlab.io.provenance import text_digest
from knitlab.io.toml import read_toml, write_toml
from knitlab.model.stitches import Gauge
from knitlab.observables.knit_size import ALONG_X, ALONG_Y
from knitlab.observables.schema import STRAIN, described
from knitlab.runs.cube import GAUGE_ATTRIBUTES
from knitlab.runs.declared_fields import declared
from knitlab.runs.plan import Plan, batched
from knitlab.runs.workflow import SETTINGS
from knitlab.runs.workflow_file import workflow_file
from knitlab.solvers.case import Case

NOTICED = 0.25  # trade-off between two targets, in tolerances, above which they conflict


class Candidate(NamedTuple):
    """The best trial of a search: its values of variables, and its case and gauge."""

    number: int  # of the search, from 1
    labels: dict[str, int | str]
    values: dict[str, float]
    case: Case
    gauge: Gauge


def candidates_plan(
    request: DesignRequest, space: SearchSpace, candidates: Sequence[Candidate]
) -> Plan:
    """The candidates as cases to be simulated from the flat sheet, with perturbed copies."""
    tested = [
        replace(case, design={**labels, "candidate": number}, robustness=request.robustness)
        for number, labels, _, case, _ in candidates
    ]
    cases = {case.case_id: case for case in tested}
    return Plan(
        workflow=request.name,
        title=f"Candidates of the design {request.name}",
        figures=(),
        cases=cases,
        batches=batched(cases),
        excluded={},
        coordinates={},
        overrides={},
        inputs={},
        stripes=text_digest(request.text),
        gauge=space.case(space.designs[0])[1],
    )


def completed(
    cube: xr.Dataset,
    space: SearchSpace,
    candidates: Sequence[Candidate],
    own: ShapeFunctions,
    folder: Path,
) -> xr.Dataset:
    """The cube with own functions, and with sizes in cloth at the gauge of each candidate."""
    dims = cube["status"].dims
    unknown = np.full(cube["status"].shape, np.nan)
    curves = np.repeat(unknown[..., None], cube.sizes[STRAIN], axis=-1)
    cube = cube.assign({name: ((*dims, STRAIN), curves.copy()) for name, _ in own})
    gauge_varies = bool(set(declared(Gauge)) & set(space.names))
    if gauge_varies:
        cube = cube.assign({name: (dims, unknown.copy()) for name in declared(Gauge)})
        for name in GAUGE_ATTRIBUTES.values():
            cube.attrs.pop(name, None)
    for number, labels, _, case, gauge in candidates:
        trial = run_trial(folder / TRIALS, case, gauge, own)
        values: dict[str, Any] = {name: trial.values(name) for name, _ in own}
        if gauge_varies:
            values |= {name: trial.values(name)[0] for name in (*ALONG_X, *ALONG_Y)} | vars(gauge)
        for name, value in values.items():
            cube[name].loc[{**labels, "candidate": number}] = value
    return cube


def ranked(cube: xr.Dataset, objective: Objective) -> tuple[Found, xr.Dataset]:
    """Candidates that meet the constraints, then others, by worst distance; the cube with these."""
    nearest = find_designs([cube], objective.request.wanted)
    worst_of_each = [each.worst for each in nearest.reached]
    worst = objective.distance(worst_of_each)
    table = nearest.table
    violation = objective.violation(worst_of_each) + np.zeros(len(worst))
    table["distance"] = objective.distance([each.off_by for each in nearest.reached])
    column = list(table.columns).index("distance") + 1
    if objective.request.subject_to:
        table.insert(column, "violation", violation)
    table.insert(column, "distance_worst", worst)
    distances = table.set_index([*cube["status"].dims])[["distance", "distance_worst"]]
    cube = cube.assign(distances.to_xarray().reindex_like(cube))
    order = np.lexsort((worst, violation))
    in_order = tuple(each.in_order(order) for each in nearest.reached)
    table = table.iloc[order].reset_index(drop=True)
    marks = tuple(nearest.marks[row] for row in order)
    return Found(table, in_order, nearest.excluded, marks), described(cube)


def write_workflow(
    folder: Path, request: DesignRequest, space: SearchSpace, candidate: Candidate
) -> Path:
    """Write a workflow that reproduces a candidate exactly; returns its path."""
    path = folder / f"candidate_{candidate.number}.toml"
    base = workflow_file(space.workflow)
    table: dict[str, Any] = read_toml(base)
    settings = {
        **space.settings,
        **candidate.values,
        "robustness": request.robustness,
        **{name: [label] for name, label in candidate.labels.items()},
    }
    for name, value in settings.items():
        table.setdefault(SETTINGS[name].section, {})[name] = value
    table["design"].pop("set", None)
    table["title"] = f"{path.stem} of the design {request.name}"
    table["figures"] = ["curves", "shape"]
    if files := table["design"].get("pattern_files"):
        table["design"]["pattern_files"] = [str((base.parent / file).resolve()) for file in files]
    if material := table.get("model", {}).get("material"):
        table["model"]["material"] = str((base.parent / material).resolve())
    write_toml(path, table)
    return path


def trials_table(
    request: DesignRequest, dims: Sequence[str], searches: Sequence[SearchResult]
) -> pd.DataFrame:
    """One row for each trial: design, values, distance, and how far it is from each target."""
    facts = ("converged", "snapped", "distance", "violation")
    unknown = [None] * len(request.wanted)
    return pd.DataFrame(
        {
            "candidate": number,
            **dict(zip(dims, search.design, strict=True)),
            **trial.values,
            **{name: getattr(trial, name) for name in facts},
            **{f"off_by_{k}": off for k, off in enumerate(trial.off_by or unknown, start=1)},
            "case_id": trial.case_id,
        }
        for number, search in enumerate(searches, start=1)
        for trial in search.trials
    )


class Conflict(NamedTuple):
    """Two targets that no trial meets at once."""

    distances: Float[np.ndarray, "trial 2"]  # over the tolerance of each
    targets: tuple[str, str]
    candidates: pd.Series  # number of the search of each trial


def worst_conflict(wanted: Sequence[Target], trials: pd.DataFrame) -> Conflict | None:
    """The two targets or constraints that conflict most in the trials of a design, if any do."""
    trials = trials[trials["distance"].notna()]
    names = [f"off_by_{number}" for number in range(1, len(wanted) + 1)]
    scaled = trials[names].to_numpy(float) / [tolerance(target) for target in wanted]
    joint = {}
    for pair in combinations(range(len(wanted)), 2):
        one, other = scaled[:, pair].T
        # The trial nearest to either target is further from the other than the best trial.
        if min(one[np.argmin(other)] - one.min(), other[np.argmin(one)] - other.min()) > NOTICED:
            joint[pair] = float(np.maximum(one, other).min())
    if max(joint.values(), default=0.0) <= 1:
        return None
    one, other = max(joint, key=lambda pair: joint[pair])
    texts = (wanted[one].text, wanted[other].text)
    return Conflict(scaled[:, [one, other]], texts, trials["candidate"].reset_index(drop=True))
