"""The samples that a claim was judged on, and their similarity to those of the paper."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from knitlab.cube.cube_file import READING, base_dims, is_measured, model_options, source_of
from knitlab.cube.schema import SOURCE
from knitlab.validation.finding import Labels
from knitlab.validation.samples import one_sample

Size = tuple[int, int]
PAPER_BOUNDARY = "clamped"
"""Boundary of the paper's own samples."""


@dataclass(frozen=True)
class JudgedSamples:
    """Samples of a cube that a claim was judged on.

    Attributes:
        cube: path of the cube.
        boundary: clamped or periodic; empty if the cube does not state it.
        unit_cells: sizes (along the weft, along the warp) of the samples, each once, ascending.
        options: model options, as text.
        experiment: name of the experiment, if it is one.
    """

    cube: Path
    boundary: str
    unit_cells: tuple[Size, ...]
    options: str
    experiment: str = ""

    @property
    def size(self) -> str:
        """The unit cells of the samples, along weft × warp: one size, or smallest and largest."""
        sizes = [f"{cells_x} × {cells_y}" for cells_x, cells_y in self.unit_cells]
        return " to ".join(dict.fromkeys([sizes[0], sizes[-1]])) if sizes else ""


def judged_samples(path: Path, cube: xr.Dataset, at: Sequence[Labels]) -> JudgedSamples:
    """Describe the samples of a cube that a claim was judged on.

    Args:
        path: path of the cube.
        cube: the cube, at one value of every swept setting.
        at: labels of the samples.
    """
    sizes = {size for labels in at if (size := unit_cells(cube, labels)) is not None}
    boundaries = dict.fromkeys(boundary_of(cube, labels) for labels in at)
    return JudgedSamples(
        path,
        ", ".join(boundary for boundary in boundaries if boundary),
        tuple(sorted(sizes, key=lambda size: (size[0] * size[1], size))),
        _options(cube),
        source_of(cube) if is_measured(cube) else "",
    )


def boundary_of(cube: xr.Dataset, labels: Labels) -> str:
    """The boundary of one sample; an experiment's is clamped. Empty if the cube has none."""
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

    They are taken from the variables ``unit_cells_x`` and ``unit_cells_y``, else counted in the
    local strains, else taken from the parameters of the cube.
    """
    names = [each for each in ("unit_cells_x", "unit_cells_y", "strain_xx") if each in cube]
    sample = one_sample(cube[["status", *names]], labels)
    stated = [float(sample[name]) for name in ("unit_cells_x", "unit_cells_y") if name in sample]
    if len(stated) == 2 and np.isfinite(stated).all():
        return int(stated[0]), int(stated[1])
    if "strain_xx" in sample:
        strained = sample["strain_xx"].notnull().any("applied_strain")
        if strained.any():
            return int(strained.any("cell_y").sum()), int(strained.any("cell_x").sum())
    cells = _parameters(cube).get("unit_cells")
    return (int(cells[1]), int(cells[0])) if cells else None


def preference(cube: xr.Dataset, at: Sequence[Labels]) -> tuple[bool, int, float]:
    """Sort key for cubes by the similarity of their samples to those of the paper.

    Samples with the boundary of the paper's come first, then more of the wanted samples before
    fewer, then larger ones, by their mean number of unit cells.

    Args:
        cube: the cube.
        at: labels of the samples.
    """
    sizes = [unit_cells(cube, labels) or (0, 0) for labels in at]
    mean = float(np.mean([cells_x * cells_y for cells_x, cells_y in sizes])) if sizes else 0.0
    another = any(boundary_of(cube, labels) != PAPER_BOUNDARY for labels in at)
    return another, -len(at), -mean


def _options(cube: xr.Dataset) -> str:
    """The model options as text, with swept settings and the gap between the walls."""
    options = model_options(cube)
    if z_max := _parameters(cube).get("sheet", {}).get("z_max"):
        options["z_max"] = z_max
    swept = {
        str(name): each.item()
        for name, each in cube.coords.items()
        if not each.dims and name != SOURCE and name not in base_dims(cube)
    }
    shown = {name: value for name, value in (options | swept).items() if name != "boundary"}
    return ", ".join(f"{name} {_short(value)}" for name, value in shown.items())


def _short(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _parameters(cube: xr.Dataset) -> dict[str, Any]:
    return json.loads(cube.attrs.get("parameters", "{}"))
