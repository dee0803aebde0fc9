"""The workflow that reproduces a candidate."""

from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from knitlab.inverse.request import DesignRequest
from knitlab.inverse.search import SearchResult
from knitlab.inverse.search_space import SearchSpace
from knitlab.io.atomic_write import atomic_write
from knitlab.io.toml import read_toml
from knitlab.sweep.settings import SETTINGS
from knitlab.sweep.workflow_file import workflow_file

FIGURES = ["curves", "shape"]


def write_workflow(
    path: Path, request: DesignRequest, space: SearchSpace, search: SearchResult
) -> Path:
    """Write a workflow that reproduces the best trial of a search exactly.

    Args:
        path: the file.
        request: the request.
        space: the search space.
        search: the search.

    Returns:
        The file.

    Raises:
        CannotWrite: if it cannot be written.
    """
    if search.winner is None:
        raise TypeError("a search without a trial that converged has no workflow")
    base = workflow_file(space.workflow)
    table: dict[str, Any] = read_toml(base)
    place = np.array(search.winner.place)
    settings = {
        **space.settings,
        **space.values(place),
        "robustness": request.robustness,
        **{name: [label] for name, label in space.labels(search.design).items()},
    }
    for name, value in settings.items():
        table.setdefault(SETTINGS[name].section, {})[name] = value
    table["design"].pop("set", None)
    table["title"] = f"{path.stem} of the design {request.name}"
    table["figures"] = FIGURES
    for section, name in (("model", "stripe_files"), ("design", "pattern_files")):
        if files := table.get(section, {}).get(name):
            table[section][name] = [str((base.parent / file).resolve()) for file in files]
    with atomic_write(path) as temporary:
        temporary.write_text(tomli_w.dumps(table), encoding="utf-8")
    return path
