"""The samples that a claim was judged on, and which of several are nearer those of the paper."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from knitlab.io.cube_file import base_dims, is_measured, source_of
from knitlab.io.plain_cube import READING, stated_options
from knitlab.io.schema import SOURCE
from knitlab.paper.finding import Labels

Size = tuple[int, int]


@dataclass(frozen=True)
class JudgedSamples:
    """What of a cube a claim was judged on.

    Attributes:
        cube: path of the cube.
        boundary: clamped or periodic; empty if the cube does not say.
        unit_cells: sizes (along the weft, along the warp) of the samples, each once, ascending.
        reading: choices of the model that the paper leaves open, in words.
        experiment: what the experiment is called, if it is one.
    """

    cube: Path
    boundary: str
    unit_cells: tuple[Size, ...]
    reading: str
    experiment: str = ""

    @property
    def size(self) -> str:
        """The unit cells of the samples, along weft × warp: one size, or smallest and largest."""
        sizes = [f"{cells_x} × {cells_y}" for cells_x, cells_y in self.unit_cells]
        return " to ".join(dict.fromkeys([sizes[0], sizes[-1]])) if sizes else ""


def judged_samples(path: Path, cube: xr.Dataset, at: Sequence[Labels]) -> JudgedSamples:
    """Say what of a cube a claim was judged on.

    Args:
        path: of the cube.
        cube: the cube, at one value of every swept setting.
        at: labels of the designs or stripes along the cube's own dimensions.
    """
    sizes = {size for labels in at if (size := unit_cells(cube, labels)) is not None}
    boundaries = dict.fromkeys(boundary_of(cube, labels) for labels in at)
    return JudgedSamples(
        path,
        ", ".join(boundary for boundary in boundaries if boundary),
        tuple(sorted(sizes, key=lambda size: (size[0] * size[1], size))),
        _reading(cube),
        source_of(cube) if is_measured(cube) else "",
    )


def boundary_of(cube: xr.Dataset, labels: Labels) -> str:
    """The boundary of one sample; an experiment's is clamped. Empty if the cube does not say."""
    if is_measured(cube):
        return "clamped"
    along = dict(zip(base_dims(cube), labels, strict=True))
    swept = cube.coords.get("boundary")
    if "boundary" in along:
        return str(along["boundary"])
    if swept is not None and not swept.dims:
        return str(swept.item())
    return str(cube.attrs.get(f"{READING}boundary", ""))


def unit_cells(cube: xr.Dataset, labels: Labels) -> Size | None:
    """Unit cells of one sample along (weft, warp).

    They are those that the cube states of the design, else those that its local strains are given
    for, else those of its parameters.
    """
    here = cube.sel(dict(zip(base_dims(cube), labels, strict=True)))
    stated = [float(here[name]) for name in ("unit_cells_x", "unit_cells_y") if name in here]
    if len(stated) == 2 and np.isfinite(stated).all():
        return int(stated[0]), int(stated[1])
    if "strain_xx" in here:
        strained = here["strain_xx"].notnull().any("applied_strain")
        if strained.any():
            return int(strained.any("cell_y").sum()), int(strained.any("cell_x").sum())
    cells = _parameters(cube).get("unit_cells")
    return (int(cells[1]), int(cells[0])) if cells else None


def preference(cube: xr.Dataset, at: Sequence[Labels], boundary: str) -> tuple[bool, int, float]:
    """How near samples are to those of the paper; of two, the smaller is to be preferred.

    First come samples with the boundary that the paper used, then more of the wanted samples
    before fewer, then larger ones, by their mean number of unit cells.

    Args:
        cube: the cube.
        at: labels of the samples along the cube's own dimensions.
        boundary: the one that the paper used.
    """
    sizes = [unit_cells(cube, labels) or (0, 0) for labels in at]
    mean = float(np.mean([cells_x * cells_y for cells_x, cells_y in sizes])) if sizes else 0.0
    another = any(boundary_of(cube, labels) != boundary for labels in at)
    return another, -len(at), -mean


def _reading(cube: xr.Dataset) -> str:
    """The choices of the model in words, those swept and the gap between the walls among them."""
    choices = stated_options(cube.attrs)
    if z_max := _parameters(cube).get("sheet", {}).get("z_max"):
        choices["z_max"] = z_max
    swept = {
        str(name): its.item()
        for name, its in cube.coords.items()
        if not its.dims and name != SOURCE and name not in base_dims(cube)
    }
    shown = {name: value for name, value in (choices | swept).items() if name != "boundary"}
    return ", ".join(f"{name} {_short(value)}" for name, value in shown.items())


def _short(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _parameters(cube: xr.Dataset) -> dict[str, Any]:
    return json.loads(cube.attrs.get("parameters", "{}"))
