"""The recorded plan of a results folder. Imports neither JAX nor xarray."""

import json
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from knitlab.io.checksum import is_damaged_json
from knitlab.io.errors import InputError, invalid, raise_if_any
from knitlab.io.provenance import file_digests, package_digest
from knitlab.runs.workflow_file import Overrides, read_overrides, workflow_file

PLAN = "plan.json"
Labels = tuple[Any, ...]  # of a design, along the dimensions of its cube


def read_plan(folder: Path) -> dict[str, Any]:
    """The record of a folder's plan."""
    path = folder / PLAN
    try:
        text = path.read_text(encoding="utf-8")
        record: dict[str, Any] = json.loads(text)
        if is_damaged_json(text) or "cases" not in record:
            raise ValueError("its contents are not those of a plan")
    except FileNotFoundError as error:
        raise invalid(str(path), "does not exist; plan or run the workflow first") from error
    except ValueError as error:
        message = f"is not as it was written ({error}); plan the workflow again"
        raise invalid(str(path), message) from error
    return record


def planned_designs(record: Mapping[str, Any]) -> dict[str, Labels]:
    """Labels of the cases of a recorded plan, by identifier."""
    return {case_id: tuple(case["design"].values()) for case_id, case in record["cases"].items()}


def changed_inputs(record: Mapping[str, Any]) -> tuple[str, ...]:
    """Input files of a recorded plan that have changed since it was made."""
    now = file_digests(map(Path, record["inputs"]))
    return tuple(path for path, digest in record["inputs"].items() if now.get(path) != digest)


def same_plan(workflow: str, overrides: Overrides, results: Path) -> dict[str, Any] | None:
    """The record of a workflow's plan if it would be made again as it is, or None."""
    with suppress(InputError, OSError):
        path = workflow_file(workflow)
        record = read_plan(results / path.stem)
        given, mistakes = read_overrides(overrides)
        raise_if_any(mistakes)
        if (
            record["overrides"] == {each.name: each.value for each in given}
            and record["package"] == package_digest()
            and str(path.resolve()) in record["inputs"]
            and not changed_inputs(record)
        ):
            return record
    return None
