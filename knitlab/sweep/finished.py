"""Finished runs: whether a results folder holds everything that a run would make. Needs no JAX."""

from pathlib import Path
from typing import Any

from knitlab.cube.schema import Status
from knitlab.io.errors import BadInput
from knitlab.io.fingerprint import package_fingerprint
from knitlab.sweep.status import changed_inputs, folder_status, planned_designs, read_plan
from knitlab.sweep.workflow_file import workflow_file


def finished_plan(
    workflow: str, overrides: tuple[str, ...], results: Path
) -> dict[str, Any] | None:
    """The record of a plan whose run is complete, if nothing has changed since.

    Inputs, settings and code are the same, and every case is ok, undamaged, computed by this code
    and in the cube. Otherwise None: the plan must be made and run.

    Args:
        workflow: name of a shipped workflow, or path of a file of the same form.
        overrides: ``KEY=VALUE`` settings.
        results: folder that holds a folder of results for each workflow.
    """
    try:
        path = workflow_file(workflow)
        folder = results / path.stem
        record = read_plan(folder)
        same = (
            tuple(record["overrides"]) == overrides
            and record.get("package") == package_fingerprint()
            and str(path.resolve()) in record["inputs"]
            and not changed_inputs(record)
        )
        if not same:
            return None
        status = folder_status(folder, record, planned_designs(record), check=True)
    except (BadInput, OSError):
        return None
    return record if set(status.counts) == {Status.ok.name} else None
