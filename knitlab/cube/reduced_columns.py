"""Columns that reduce a curve over a window of strain: ``mean(poisson_ratio, 0.05:0.25)``."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from knitlab.cube.plain_cube import PlainCube
from knitlab.cube.strain_window import REDUCTIONS, STRAIN, StrainWindow
from knitlab.io.errors import fault, unknown

if TYPE_CHECKING:
    import xarray as xr  # slow to import

_CALL = re.compile(
    rf"\b(?P<reduction>{'|'.join(REDUCTIONS)})\s*\(\s*(?P<name>\w+)\s*,\s*(?P<window>[^()]*?)\s*\)"
)


@dataclass(frozen=True)
class ReducedColumn:
    """A column that is a reduction of a variable along the applied strain.

    Attributes:
        reduction: name in :data:`~knitlab.cube.strain_window.REDUCTIONS`.
        name: variable of the cube.
        window: strains over which it is reduced.
    """

    reduction: str
    name: str
    window: StrainWindow

    @property
    def label(self) -> str:
        """The canonical name of the column."""
        return f"{self.reduction}({self.name}, {self.window})"


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


def with_columns(cubes: Sequence[PlainCube], texts: Iterable[str]) -> list[PlainCube]:
    """Cubes with the reduced columns of some texts as additional variables.

    Args:
        cubes: the cubes.
        texts: conditions, names of columns, and so on.

    Raises:
        BadInput: if no cube has the curve that a column reduces.
    """
    wanted = {column.label: column for t in texts for column in reduced_columns(t).values()}
    for label, column in wanted.items():
        _check(cubes, label, column)
    return [_with(cube, wanted) for cube in cubes]


def with_reduction(cube: "xr.Dataset", text: str) -> tuple["xr.Dataset", str]:
    """A cube with the reduced column that a text names, and the column's canonical name.

    Args:
        cube: the cube.
        text: ``mean(poisson_ratio, 0.05:0.25)`` and the like; any other text changes nothing.

    Raises:
        BadInput: if the cube lacks the curve that is reduced.
    """
    column = reduced_columns(text).get(text)
    if column is None:
        return cube, text
    (plain,) = with_columns([PlainCube.of(cube)], [text])
    unit = "1" if column.reduction == "linearity" else cube[column.name].attrs.get("units", "1")
    attributes = {"units": unit, "long_name": column.label}
    values = (plain.design_dims, plain.read(column.label), attributes)
    return cube.assign({column.label: values}), column.label


def _check(cubes: Sequence[PlainCube], label: str, column: ReducedColumn) -> None:
    curves = {
        name
        for cube in cubes
        for name, dims in cube.dims.items()
        if set(dims) - set(cube.design_dims) == {STRAIN}
    }
    if column.name not in curves:
        raise fault(label, f"reduces a curve along {STRAIN}, and {unknown(column.name, curves)}")


def _with(cube: PlainCube, wanted: dict[str, ReducedColumn]) -> PlainCube:
    own = {label: column for label, column in wanted.items() if column.name in cube.dims}

    def read_several(names: Sequence[str]) -> dict[str, np.ndarray]:
        curves = {own[name].name if name in own else name for name in names}
        found = cube.read_several(sorted(curves))
        return {name: reduced(found, name) if name in own else found[name] for name in names}

    def reduced(read: dict[str, np.ndarray], name: str) -> np.ndarray:
        column = own[name]
        values = np.asarray(read[column.name], float)
        curves = values.reshape(-1, values.shape[-1])
        strains = np.asarray(cube.coordinates[STRAIN], float)
        found = REDUCTIONS[column.reduction](*column.window.read(strains, curves))
        return found.reshape(values.shape[:-1])

    return replace(
        cube, dims=cube.dims | dict.fromkeys(own, cube.design_dims), read_several=read_several
    )
