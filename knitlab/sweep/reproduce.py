"""Reproducing one case alone, in this process, with everything that can be said of it."""

import json
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from knitlab.mechanics.state import TensileTest
from knitlab.sweep.case import Case, case_of
from knitlab.sweep.case_file import case_path, read_case
from knitlab.sweep.faults import BadInput, fault
from knitlab.sweep.fingerprint import code_fingerprint
from knitlab.sweep.simulation import failure_reason, tensile_tests
from knitlab.sweep.status import FAILURES, PLAN, earlier_failures, read_plan

HEADER = (
    f"{'strain':>8} {'outcome':>15} {'residual [N]':>13} {'iterations':>10} {'energy [N mm]':>14}"
)


def find_case(results: Path, case_id: str) -> Case:
    """The case of an identifier, from the plans, failures and case files under a folder.

    Args:
        results: folder that holds a folder of results for each workflow.
        case_id: its identifier.

    Raises:
        BadInput: if there is none, or it was recorded by another version.
    """
    for folder in sorted(path.parent for path in results.glob(f"*/{PLAN}")):
        record = None
        with suppress(BadInput, OSError):  # a folder that cannot be read holds no case
            record = _record(folder, case_id)
        if record is None:
            continue
        try:
            case = case_of(record)
        except (ValidationError, KeyError, TypeError) as error:
            raise fault(case_id, f"was recorded by another version of knitlab ({error})") from error
        if case.case_id != case_id:
            raise fault(
                case_id,
                f"now has the identifier {case.case_id}, for knitlab has changed since;"
                " reproduce that one",
            )
        return case
    raise fault(
        case_id, f"is in no {PLAN}, {FAILURES} or cases/ under {results}; give its --results"
    )


def _record(folder: Path, case_id: str) -> dict[str, Any] | None:
    planned = read_plan(folder)["cases"]
    if case_id in planned:
        found: dict[str, Any] = planned[case_id]
        return found
    if entry := earlier_failures(folder).get(case_id):
        return dict(entry["case"])
    if case_path(folder, case_id).is_file():
        return dict(json.loads(read_case(folder, case_id).attrs["parameters"]))
    return None


def reproduce(case: Case, say: Callable[[str], None]) -> bool:
    """Run a case alone and say how every state was reached; nothing is written.

    Args:
        case: the case.
        say: takes each line.

    Returns:
        Whether every state converged.
    """
    say(f"{case.case_id}: {case.label}")
    say(f"{case.mesh_shape.unknowns} unknowns, method {case.method}, code {code_fingerprint()}")
    say(json.dumps(case.record))
    began = time.perf_counter()

    def told(_: str, states: float) -> None:
        if states != int(states):
            return
        say(f"state {states} of {len(case.applied_strain)}, {time.perf_counter() - began:.1f} s")

    try:
        (test,) = tensile_tests([case], told)
    except Exception:  # whatever it raises is what one wants to see
        say(traceback.format_exc().rstrip())
        return False
    for line in states_table(case, test):
        say(line)
    reason = failure_reason(case, test)
    say(reason or f"all {len(test.states)} states converged")
    return not reason


def states_table(case: Case, test: TensileTest) -> list[str]:
    """How every state of a test was reached, in lines of text."""
    return [
        HEADER,
        *(
            f"{strain:8g} {state.outcome.name:>15} {state.residual:13.2e} {state.iterations:10d}"
            f" {float(state.energy.total):14.7g}"
            for strain, state in zip(case.applied_strain, test.states, strict=False)
        ),
    ]
