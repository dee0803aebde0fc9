"""Starts of a design: the nearest known designs, of cubes or of a coarse sweep."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import xarray as xr

from knitlab.cube.cube_file import CUBE, open_cube
from knitlab.cube.find import find_designs
from knitlab.cube.target import Target
from knitlab.inverse.request import DesignRequest
from knitlab.inverse.search_space import DesignLabels, SearchSpace
from knitlab.io.errors import fault
from knitlab.sweep.plan import make_plan
from knitlab.sweep.run import RunOptions, run_plan
from knitlab.sweep.settings import PATTERN

PAPERS_PATTERN = "checkerboard"


class Starts(NamedTuple):
    """Designs to refine, the nearest first; simulations of a coarse sweep; designs in no cube."""

    designs: tuple[DesignLabels, ...]
    simulations: int = 0
    unknown: tuple[DesignLabels, ...] = ()


def starting_designs(
    request: DesignRequest,
    space: SearchSpace,
    targets: Sequence[Target],
    folder: Path,
    options: RunOptions,
) -> Starts:
    """At most as many designs as the request wants, the nearest to targets before refinement.

    Args:
        request: the request.
        space: the search space.
        targets: its targets and constraints, which refining may fulfil, of variables that cubes
            have.
        folder: folder of the trials, which also holds the coarse sweep.
        options: how to run the coarse sweep if no cube is given.

    Raises:
        KeyboardInterrupt: if the coarse sweep is interrupted.
        BadInput: if a cube lacks a variable of the targets, or has no allowed design.
    """
    if len(space.designs) <= request.starts and not request.cubes:
        return Starts(space.designs)
    cubes, simulations = [open_cube(path, lazily=True) for path in request.cubes], 0
    if not cubes:
        cubes, simulations = _coarse_sweep(request, space, folder, options)
    if not targets:
        return Starts(space.designs[: request.starts], simulations)
    table = find_designs(cubes, targets).table
    if PATTERN not in table:
        table = table.assign(**{PATTERN: PAPERS_PATTERN})
    known: list[DesignLabels] = [*map(tuple, table[[*space.dims]].to_numpy(object).tolist())]
    allowed = [design for design in dict.fromkeys(known) if design in space.designs]
    unknown = tuple(design for design in space.designs if design not in known)
    if not allowed:
        labels = ", ".join(map(str, space.designs))
        raise fault("cubes", f"have none of the allowed designs; simulate {labels} first")
    return Starts(tuple(allowed[: request.starts]), simulations, unknown)


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
