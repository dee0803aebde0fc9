"""Starts of a design: the nearest known designs, of cubes or of a coarse sweep."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
import xarray as xr

from knitlab.cube.cube_file import CUBE, open_cube
from knitlab.cube.find import find_designs
from knitlab.inverse.request import DesignRequest
from knitlab.inverse.search_space import DesignLabels, SearchSpace
from knitlab.io.errors import fault
from knitlab.sweep.plan import make_plan
from knitlab.sweep.run import RunOptions, run_plan
from knitlab.sweep.settings import PATTERN

PAPERS_PATTERN = "checkerboard"


@dataclass(frozen=True)
class Starts:
    """Where the searches of a design start.

    Attributes:
        designs: at most as many as the request wants, the nearest to the targets first.
        simulations: number of simulations of the coarse sweep, if there was one.
        unknown: allowed designs of which no cube has results; they are not considered.
    """

    designs: tuple[DesignLabels, ...]
    simulations: int = 0
    unknown: tuple[DesignLabels, ...] = ()


def starting_designs(
    request: DesignRequest,
    space: SearchSpace,
    folder: Path,
    options: RunOptions,
    own: Collection[str] = (),
) -> Starts:
    """The designs nearest to the targets before refinement, the nearest first.

    Constraints are treated as further targets, as refining may fulfil them.

    Args:
        request: the request.
        space: the search space.
        folder: folder of the trials, which also holds the coarse sweep.
        options: how to run the coarse sweep if no cube is given.
        own: names of own measures, which no cube has; their targets are ignored here.

    Raises:
        KeyboardInterrupt: if the coarse sweep is interrupted.
        BadInput: if a cube lacks a variable of the targets, or has no allowed design.
    """
    if len(space.designs) <= request.starts and not request.cubes:
        return Starts(space.designs)
    cubes, simulated = [open_cube(path, lazily=True) for path in request.cubes], 0
    if not cubes:
        cubes, simulated = _coarse_sweep(request, space, folder, options)
    known = [each for each in (*request.targets, *request.subject_to) if each.name not in own]
    if not known:
        return Starts(space.designs[: request.starts], simulated)
    found = find_designs(cubes, known).table
    known_designs = list(dict.fromkeys(_labels(found, space.dims)))
    allowed = [design for design in known_designs if design in space.designs]
    unknown = [design for design in space.designs if design not in known_designs]
    if not allowed:
        labels = ", ".join(map(str, space.designs))
        problem = f"have none of the allowed designs; simulate {labels} first"
        raise fault("cubes", problem)
    return Starts(tuple(allowed[: request.starts]), simulated, tuple(unknown))


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
) -> tuple[list[xr.Dataset], int]:
    labels = {
        dim: list(dict.fromkeys(along))
        for dim, along in zip(space.dims, zip(*space.designs, strict=True), strict=True)
    }
    plan = make_plan(space.workflow, {**space.settings, **(labels if request.choices else {})})
    if run_plan(plan, folder, options).stopped:
        raise KeyboardInterrupt
    return [open_cube(folder / CUBE)], len(plan.cases)
