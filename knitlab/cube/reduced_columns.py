"""Columns that reduce a curve over a window of strain: ``mean(poisson_ratio, 0.05:0.25)``."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from knitlab.cube.cube_file import design_dims
from knitlab.cube.strain_window import REDUCTIONS, STRAIN, StrainWindow
from knitlab.io.errors import fault, unknown

_CALL = re.compile(
    rf"\b(?P<reduction>{'|'.join(REDUCTIONS)})\s*\(\s*(?P<name>\w+)\s*,\s*(?P<window>[^()]*?)\s*\)"
)


@dataclass(frozen=True)
class ReducedColumn:
    """A reduction, see ``REDUCTIONS``, of the curve of a variable over a window of strain."""

    reduction: str
    name: str
    window: StrainWindow

    @property
    def label(self) -> str:
        """The canonical name of the column."""
        return f"{self.reduction}({self.name}, {self.window})"

    def of(self, cube: xr.Dataset) -> xr.DataArray:
        """Its values for the designs of a cube."""
        dims = design_dims(cube)
        curve = cube[self.name].transpose(*dims, STRAIN)
        curves = np.asarray(curve.values, float).reshape(-1, curve.sizes[STRAIN])
        strains = np.asarray(cube[STRAIN].values, float)
        values = REDUCTIONS[self.reduction](*self.window.read(strains, curves))
        unit = "1" if self.reduction == "linearity" else curve.attrs.get("units", "1")
        attributes = {"units": unit, "long_name": self.label}
        return xr.DataArray(values.reshape(curve.shape[:-1]), dims=dims, attrs=attributes)


def reduced_columns(text: str) -> dict[str, ReducedColumn]:
    """The reduced columns in a text, by the parts of the text that name them.

    Raises:
        BadInput: if one names no window.
    """
    return {
        match[0]: ReducedColumn(
            match["reduction"], match["name"], StrainWindow.of(match["window"], match[0])
        )
        for match in _CALL.finditer(text)
    }


def relabelled(text: str) -> str:
    """A text with the canonical name of every reduced column."""
    for part, column in reduced_columns(text).items():
        text = text.replace(part, column.label)
    return text


def with_columns(cubes: Sequence[xr.Dataset], texts: Iterable[str]) -> list[xr.Dataset]:
    """Cubes with the reduced columns of conditions, names of columns, ... as variables.

    Raises:
        BadInput: if no cube has the curve that a column reduces.
    """
    wanted = [column for text in texts for column in reduced_columns(text).values()]
    curves = {
        str(name)
        for cube in cubes
        for name in cube.data_vars
        if set(cube[name].dims) - set(design_dims(cube)) == {STRAIN}
    }
    for column in wanted:
        if column.name not in curves:
            problem = f"reduces a curve along {STRAIN}, and {unknown(column.name, curves)}"
            raise fault(column.label, problem)
    return [
        cube.assign({column.label: column.of(cube) for column in wanted if column.name in cube})
        for cube in cubes
    ]


def with_reduction(cube: xr.Dataset, text: str) -> tuple[xr.Dataset, str]:
    """A cube with the reduced column that a text names, and the column's canonical name.

    Any other text changes nothing.

    Raises:
        BadInput: if the cube lacks the curve that is reduced.
    """
    column = reduced_columns(text).get(text)
    if column is None:
        return cube, text
    return with_columns([cube], [text])[0], column.label
