"""The file of a workflow, by its name or its path. Needs no JAX."""

from pathlib import Path

from knitlab.io.errors import fault
from knitlab.io.shipped import shipped
from knitlab.io.suggestions import unknown


def workflow_file(workflow: str) -> Path:
    """The file of a workflow given by its name or its path.

    Raises:
        BadInput: if there is none.
    """
    named = shipped("workflows") / f"{workflow}.toml"
    if named.is_file():
        return named
    path = Path(workflow)
    if path.is_file():
        return path
    names = [file.stem for file in shipped("workflows").glob("*.toml")]
    problem = unknown(path.stem, names, "workflow")
    raise fault(workflow, f"is not a file, and {problem}")
