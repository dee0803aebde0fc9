"""Starts of a design: the nearest known designs, of cubes or of a coarse sweep."""

from collections.abc import Collection, Sequence
from pathlib import Path

import pandas as pd

from knitlab.execution.run import RunOptions, run_plan
from knitlab.io.errors import fault
from knitlab.io.plain_cube import CUBE, PlainCube, open_plain_cube
from knitlab.optimisation.request import DesignRequest
from knitlab.optimisation.search_space import DesignLabels, SearchSpace
from knitlab.study.plan import make_plan
from knitlab.study.settings import PATTERN
from knitlab.tables.find import find_designs

PAPERS_PATTERN = "checkerboard"


def starting_designs(
    request: DesignRequest,
    space: SearchSpace,
    folder: Path,
    options: RunOptions,
    own: Collection[str] = (),
) -> tuple[list[DesignLabels], int]:
    """The designs that are nearest to the targets as the tables have them, the nearest first.

    Constraints count as further targets here: a design that breaks one may meet it when it varies.

    Args:
        request: the request.
        space: what may vary.
        folder: of the trials, where the coarse sweep goes too.
        options: how to run a coarse sweep, if no cube is given.
        own: names of own measures, which no cube has; targets on them do not count here.

    Returns:
        At most ``request.starts`` designs, and how many were simulated for them.

    Raises:
        KeyboardInterrupt: if the coarse sweep is interrupted.
        BadInput: if a cube does not have what the targets name, or no design of it is allowed.
    """
    if len(space.designs) <= request.starts and not request.cubes:
        return list(space.designs), 0
    cubes, simulated = [open_plain_cube(path) for path in request.cubes], 0
    if not cubes:
        cubes, simulated = _coarse_sweep(request, space, folder, options)
    known = [its for its in (*request.targets, *request.subject_to) if its.name not in own]
    if not known:
        return list(space.designs[: request.starts]), simulated
    found = find_designs(cubes, known).table
    allowed = [design for design in _labels(found, space.dims) if design in space.designs]
    starts = list(dict.fromkeys(allowed))[: request.starts]
    if not starts:
        labels = ", ".join(map(str, space.designs))
        problem = f"hold none of the designs that are allowed; have {labels} simulated first"
        raise fault("cubes", problem)
    return starts, simulated


def _labels(table: pd.DataFrame, dims: Sequence[str]) -> list[DesignLabels]:
    """Labels of the designs of a table; one that names no pattern is of the paper's."""
    columns = [
        table[dim].astype(str)
        if dim == PATTERN and dim in table
        else [PAPERS_PATTERN] * len(table)
        if dim == PATTERN
        else table[dim].astype(int)
        for dim in dims
    ]
    return list(zip(*columns, strict=True))


def _coarse_sweep(
    request: DesignRequest, space: SearchSpace, folder: Path, options: RunOptions
) -> tuple[list[PlainCube], int]:
    labels = {
        dim: list(dict.fromkeys(along))
        for dim, along in zip(space.dims, zip(*space.designs, strict=True), strict=True)
    }
    plan = make_plan(space.workflow, {**space.settings, **(labels if request.choices else {})})
    if run_plan(plan, folder, options).stopped:
        raise KeyboardInterrupt
    return [open_plain_cube(folder / CUBE)], len(plan.cases)
