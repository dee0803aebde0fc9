"""Reproducing one case in this process, with details of every state."""

import json
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from knitlab.cubes.case_file import case_path, read_case, stored_cases
from knitlab.cubes.cube_file import parameters_of
from knitlab.cubes.recorded_case import case_of_record
from knitlab.io.errors import InputError, invalid
from knitlab.io.limits import MAX_CASES_NAMED
from knitlab.io.provenance import MODEL
from knitlab.runs.recorded_plan import PLAN, read_plan
from knitlab.runs.results_folder import FAILURES, earlier_failures
from knitlab.solvers.case import Case
from knitlab.solvers.methods import METHODS

HEADER = (
    f"{'strain':>8} {'outcome':>15} {'residual [N]':>13} {'iterations':>10} {'energy [N mm]':>14}"
    f" {'nu':>9} {'force [N]':>10}"
)
TOLERANCE = 1e-3
"""Difference up to which results agree, of ν, and of other curves over their largest value."""
CURVES = {"poisson_ratio": "nu", "reaction_force": "force", "capacitance": "capacitance"}
"""Curves that are compared, and their names in messages."""


class RecordedCase(NamedTuple):
    """A case in a results folder, and its identifier there, perhaps that of another version."""

    case: Case
    case_id: str
    folder: Path


def find_case(results: Path, case_id: str) -> RecordedCase:
    """The case whose identifier begins so, in a results folder or those in it; else InputError."""
    matches: dict[str, tuple[Path, dict[str, Any]]] = {}
    for folder in [results, *sorted(path for path in results.glob("*") if path.is_dir())]:
        with suppress(InputError, OSError):  # a folder that cannot be read holds no case
            recorded = {name: entry["case"] for name, entry in earlier_failures(folder).items()}
            if (folder / PLAN).is_file():
                recorded |= read_plan(folder)["cases"]
            for name in sorted(stored_cases(folder)):
                if name.startswith(case_id) and name not in recorded:
                    recorded[name] = parameters_of(read_case(folder, name))
            for name in recorded:
                if name.startswith(case_id):
                    matches.setdefault(name, (folder, recorded[name]))
    if not matches:
        where = f"is in no {PLAN}, {FAILURES} or cases/ under {results}; name its results folder"
        raise invalid(case_id, where)
    if len(matches) > 1 and case_id not in matches:
        some = ", ".join(list(matches)[:MAX_CASES_NAMED])
        more = ", …" if len(matches) > MAX_CASES_NAMED else ""
        message = f"{len(matches)} cases begin so ({some}{more}); give more characters"
        raise invalid(case_id, message)
    name = case_id if case_id in matches else next(iter(matches))
    folder, record = matches[name]
    return RecordedCase(case_of_record(record, name), name, folder)


def reproduce(
    case_id: str, *, results: str | Path = "results", report: Callable[[str], None] = print
) -> bool:
    """Run one case in this process, and report how every state was reached.

    Args:
        case_id: identifier of the case, or its first characters.
        results: folder that holds a folder of results for each workflow, or one of these.
        report: called with each line of the report.

    Returns:
        Whether every state converged and agrees with the case file, if there is one.

    Raises:
        InputError: if there is no such case, or several.
    """
    recorded = find_case(Path(results), case_id)
    from knitlab.model.computing import computing  # imports JAX

    with computing():
        return _reproduced(recorded, report)


def _reproduced(recorded: RecordedCase, report: Callable[[str], None]) -> bool:
    from knitlab.observables.finished_test import FinishedTest
    from knitlab.observables.measurement import measured

    case = recorded.case
    report(f"{recorded.case_id}: {case.label}")
    if case.case_id != recorded.case_id:
        report(f"recorded by another version; its identifier is now {case.case_id}")
    report(f"{case.mesh_shape.unknowns} unknowns, method {case.method}, {MODEL}")
    report(json.dumps(case.record))
    began = time.perf_counter()

    def report_state(_: str, states: float) -> None:
        if states == int(states):
            seconds = time.perf_counter() - began
            report(f"state {states:.0f} of {len(case.applied_strain)}, {seconds:.1f} s")

    try:
        method = METHODS[case.method]
        (test,) = method.stretch([case], report_state)
    except Exception:  # the report shows whatever it raises
        report(traceback.format_exc().rstrip())
        return False
    recomputed = measured(FinishedTest(case, test))
    report(HEADER)
    curves = recomputed["poisson_ratio"].values, recomputed["reaction_force"].values
    for strain, state, ratio, force in zip(case.applied_strain, test.states, *curves, strict=False):
        report(
            f"{strain:8g} {state.outcome.name:>15} {state.residual:13.2e} {state.iterations:10d}"
            f" {float(state.energy.total):14.7g} {ratio:9.5f} {force:10.5g}"
        )
    reason = METHODS[case.method].failure(case, test)
    report(reason or f"all {len(test.states)} states converged")
    path = case_path(recorded.folder, recorded.case_id)
    if not path.is_file():
        return not reason
    agree, line = comparison(recomputed, read_case(recorded.folder, recorded.case_id))
    report(f"{line} {path}")
    return agree and not reason


def comparison(results: xr.Dataset, kept: xr.Dataset) -> tuple[bool, str]:
    """Whether new results of a case agree with kept ones, and a line with the differences."""
    results, kept = xr.align(results, kept, join="outer")
    errors, same_states = {}, True
    for name in [name for name in CURVES if name in results and name in kept]:
        new, old = results[name].values, kept[name].values
        largest = 1.0 if name == "poisson_ratio" else max(_largest(old), np.finfo(float).tiny)
        errors[name] = _largest(new - old) / largest
        same_states &= bool((np.isfinite(new) == np.isfinite(old)).all())
    agree = same_states and max(errors.values()) <= TOLERANCE
    verdict = "agrees with" if agree else "DOES NOT agree with"
    listed = ", ".join(f"{CURVES[name]} by {value:.1e}" for name, value in errors.items())
    listed = listed.replace("nu by", "nu differs by at most")
    missing = "" if same_states else ", and other states are missing"
    return agree, f"{listed} of the largest{missing}: {verdict}"


def _largest(values: np.ndarray) -> float:
    return float(np.abs(values).max(initial=0.0, where=np.isfinite(values)))
