"""Layouts: which fold lines of a fabric are plated, and the electrodes that result."""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Bool, Float
from pydantic import (
    AfterValidator,
    PositiveFloat,
    PositiveInt,
    ValidationError,
    ValidatorFunctionWrapHandler,
    WrapValidator,
)
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from knitlab.fabric.electrodes import NAMES, Along, Electrodes, Strip
from knitlab.fabric.fold_lines import Ridge, fold_senses
from knitlab.fabric.network import MeshShape, mesh_shape
from knitlab.fabric.options import ModelOptions
from knitlab.fabric.pattern import PatchGrid
from knitlab.fabric.setting_types import Position

BARE = "."
"""Letter of a mask where no electrode is plated."""

Face = Literal["front", "back", "both"]
Within = Literal["patch", "fabric"]


def _width(value: object, number_or_stripe: ValidatorFunctionWrapHandler) -> object:
    try:
        return number_or_stripe(value)
    except ValidationError as error:
        problem = f"a width is a number of stitches above 0 or 'stripe', but is {value!r}"
        raise ValueError(problem) from error


def _mask(rows: tuple[str, ...]) -> tuple[str, ...]:
    if len({len(row) for row in rows}) > 1 or "" in rows:
        raise ValueError("a mask is a rectangle of letters; give rows of equal length")
    if unknown := sorted(set("".join(rows).upper()) - {*NAMES, BARE}):
        raise ValueError(f"a mask consists of A, B and '.', not {', '.join(unknown)}")
    return rows


Width = Annotated[PositiveFloat | Literal["stripe"], WrapValidator(_width)]
Mask = Annotated[tuple[str, ...], AfterValidator(_mask)]

SENSES: dict[Face, tuple[int, ...]] = {"front": (1,), "back": (-1,), "both": (1, -1)}


StitchCounts = tuple[Float[np.ndarray, " grid_y"], Float[np.ndarray, " grid_x"]]
"""Courses in every row of grid cells, and wales in every column."""
SHARP = 1e-9
"""Width of a ridge, relative to a stripe, where only its middle line is needed."""


class BadLayout(ValueError):
    """A layout that is impossible on a fabric.

    Attributes:
        problems: a sentence for each fault.
    """

    def __init__(self, problems: list[str]) -> None:
        super().__init__("; ".join(problems))
        self.problems = problems


@dataclass(frozen=True)
class ElectrodeLayout:
    """Where the two electrodes of a fabric lie: along two of its ridges, or as drawn in a mask.

    Attributes:
        along: direction of the electrodes. Ridges along a wale are folds of rib, and electrodes on
            them continue through garter patches; ridges along a course are folds of garter.
        ridges: numbers of the two ridges; 1 is the leftmost or lowest.
        face: the face on which ridges are counted.
        within: whether ridges are counted in the middle patch, or in the whole fabric.
        width: of each electrode, centred on its ridge; ``"stripe"`` is a whole stripe [stitches].
        span: start and end of the electrodes, relative to the length of the fabric; 0 and 1 for
            periodic fabric.
        mask: instead of ridges, a letter for each grid cell, A or B where it is plated and ``.``
            where it is not, top course first.
    """

    along: Along = "wale"
    ridges: tuple[PositiveInt, PositiveInt] = (1, 2)
    face: Face = "front"
    within: Within = "patch"
    width: Width = "stripe"
    span: tuple[Position, Position] = (0.0, 1.0)
    mask: Mask = ()


def place_electrodes(
    layout: ElectrodeLayout, pattern: PatchGrid, options: ModelOptions, stitches: StitchCounts
) -> Electrodes:
    """The electrodes of a layout on a fabric.

    Args:
        layout: the layout.
        pattern: which patch is rib and which garter.
        options: model options, which define where folds lie and whether the fabric is periodic.
        stitches: courses in every row of grid cells, and wales in every column.

    Raises:
        BadLayout: if the layout is impossible; it lists every fault with its place.
    """
    shape = mesh_shape(pattern, options.boundary)
    if shape.periodic and layout.span != (0.0, 1.0):
        raise BadLayout(["periodic fabric has no ends; remove span, or use boundary = clamped"])
    if layout.mask:
        electrodes = _drawn(layout, shape)
    else:
        electrodes = _along_ridges(layout, pattern, options, shape, stitches)
    if faults := electrodes.faults(shape):
        raise BadLayout(faults)
    return electrodes


def ridge_lines(layout: ElectrodeLayout, pattern: PatchGrid, options: ModelOptions) -> list[int]:
    """Grid lines of the ridges that a layout counts."""
    like = pattern.cells_of("rib") if layout.along == "wale" else pattern.cells_of("garter").T
    sharp = Ridge(pattern.cells_per_period, SHARP)
    senses = fold_senses(like, options.fold_phase, options.boundary == "periodic", sharp)
    if layout.along == "course" and options.garter_start == "valley":
        senses = -senses
    folded = np.asarray(np.isin(senses, SENSES[layout.face]).any(axis=0))
    if layout.within == "patch":
        borders = pattern.column_borders if layout.along == "wale" else pattern.row_borders
        middle = (len(borders) - 2) // 2
        folded[: borders[middle]], folded[borders[middle + 1] :] = False, False
    return np.flatnonzero(folded).tolist()


def _along_ridges(
    layout: ElectrodeLayout,
    pattern: PatchGrid,
    options: ModelOptions,
    shape: MeshShape,
    stitches: StitchCounts,
) -> Electrodes:
    lines = ridge_lines(layout, pattern, options)
    if missing := sorted({number for number in layout.ridges if number > len(lines)}):
        where = "its middle patch" if layout.within == "patch" else "the fabric"
        raise BadLayout(
            [
                f"there is no ridge {number}: {where} has {len(lines)} on face {layout.face}; give"
                " other ridges, or count them within the fabric"
                for number in missing
            ]
        )
    across = stitches[1 if layout.along == "wale" else 0]
    length = shape.cells_y if layout.along == "wale" else shape.cells_x
    start, end = (part * length for part in layout.span)
    strips = []
    for number in layout.ridges:
        line = lines[number - 1]
        width = (
            pattern.cells_per_period / 2
            if layout.width == "stripe"
            else layout.width / across[line]
        )
        low, high = line - width / 2, line + width / 2
        on = (low, high, start, end) if layout.along == "wale" else (start, end, low, high)
        strips.append((Strip(*on),))
    return Electrodes((strips[0], strips[1]), layout.along)


def _drawn(layout: ElectrodeLayout, shape: MeshShape) -> Electrodes:
    drawing = np.array([list(row.upper()) for row in layout.mask[::-1]])
    if drawing.shape != (shape.cells_y, shape.cells_x):
        columns = len(layout.mask[0])
        raise BadLayout(
            [
                f"the mask has {len(layout.mask)} rows of {columns} letters, the fabric"
                f" {shape.cells_y} rows of {shape.cells_x} grid cells; draw one letter per cell"
            ]
        )
    problems, strips = [], []
    for name in NAMES:
        plated = drawing == name
        problems += _broken(name, plated, layout.along, shape)
        strips.append(
            tuple(
                Strip(column, column + 1.0, row, row + 1.0)
                for row, column in np.argwhere(plated).astype(float).tolist()
            )
        )
    if problems:
        raise BadLayout(problems)
    return Electrodes((strips[0], strips[1]), layout.along)


def _broken(
    name: str, plated: Bool[np.ndarray, "row column"], along: Along, shape: MeshShape
) -> list[str]:
    """Faults of a drawn electrode: not connected, or not continued across a periodic boundary."""
    if not plated.any():
        return [f"the mask has no letter {name}; draw both electrodes"]
    axis = 0 if along == "wale" else 1
    number = np.full(plated.shape, -1)
    number[plated] = np.arange(plated.sum())
    joined = []
    for direction in (0, 1):
        ahead = np.roll(number, -1, axis=direction)
        seam = np.zeros_like(plated)
        seam[(slice(None),) * direction + (-1,)] = True
        meets = (number >= 0) & (ahead >= 0)
        if shape.periodic and direction == axis and not (meets & seam).any():
            return [f"electrode {name} does not continue across the boundary of periodic fabric"]
        if not (shape.periodic and direction == axis):
            meets &= ~seam
        joined.append(np.stack([number[meets], ahead[meets]]))
    start, end = np.concatenate(joined, axis=1)
    graph = coo_array((np.ones(len(start)), (start, end)), shape=(plated.sum(),) * 2)
    count, part = connected_components(graph, directed=False)
    if count == 1:
        return []
    row, column = np.argwhere(plated)[np.argmin(np.bincount(part)[part])]
    return [f"electrode {name} is in {count} pieces, one of them at column {column}, row {row}"]
