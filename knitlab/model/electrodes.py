"""Electrodes: conductors plated on a fabric, as rectangles of its flat chart, and their layouts.

The chart counts grid cells: x along the weft from the left edge, y along the warp from the bottom.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import combinations, pairwise, product
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Bool, Float
from pydantic import (
    AfterValidator,
    Field,
    NonNegativeFloat,
    PositiveFloat,
    PositiveInt,
    ValidationError,
    ValidatorFunctionWrapHandler,
    WrapValidator,
)

from knitlab.model.checked import Checked
from knitlab.model.fold_lines import Ridge, fold_senses
from knitlab.model.network import MeshShape, mesh_shape
from knitlab.model.pattern import Along, PatchGrid
from knitlab.model.settings import Fraction, ModelOptions, Position, Unit

NAMES = ("A", "B")
BARE = "."  # letter of a mask where no electrode is plated
SENSES = {"front": (1,), "back": (-1,), "both": (1, -1)}  # folds that are ridges of a face
SHARP = 1e-9  # width of a ridge, relative to a stripe, where only its middle line is needed

StitchCounts = tuple[Float[np.ndarray, " grid_y"], Float[np.ndarray, " grid_x"]]
"""Courses in every row of grid cells, and wales in every column."""


@dataclass(frozen=True)
class Strip:
    """A plated rectangle of the chart [grid cells]."""

    left: float
    right: float
    bottom: float
    top: float

    def __str__(self) -> str:
        return (
            f"columns {self.left:g} to {self.right:g}, rows {self.bottom:g} to {self.top:g}"
            " (grid cells)"
        )

    @property
    def extents(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Start and end along x, and along y."""
        return (self.left, self.right), (self.bottom, self.top)

    @property
    def area(self) -> float:
        """Its area [grid cells]."""
        return (self.right - self.left) * (self.top - self.bottom)

    def moved(self, x: float, y: float) -> "Strip":
        """The strip moved to the right and up [grid cells]."""
        return Strip(self.left + x, self.right + x, self.bottom + y, self.top + y)

    def shared(self, other: "Strip") -> "Strip | None":
        """The intersection with another strip, possibly an edge or a corner; ``None`` if empty."""
        (left, right), (bottom, top) = (
            (max(one[0], two[0]), min(one[1], two[1]))
            for one, two in zip(self.extents, other.extents, strict=True)
        )
        return Strip(left, right, bottom, top) if left <= right and bottom <= top else None


def split_by_cells(strip: Strip) -> list[Strip]:
    """The pieces of a strip, one for each grid cell that it covers."""
    x, y = (
        pairwise([low, *np.arange(np.floor(low) + 1, np.ceil(high)).tolist(), high])
        for low, high in strip.extents
    )
    return [Strip(*columns, *rows) for columns, rows in product(x, y)]


@dataclass(frozen=True)
class Electrodes:
    """The two conductors of a capacitor; if periodic, along their direction only."""

    strips: tuple[tuple[Strip, ...], tuple[Strip, ...]]
    along: Along

    @property
    def axis(self) -> int:
        """The axis of the electrodes, 0 for x and 1 for y."""
        return 0 if self.along == "course" else 1

    def mistakes(self, shape: MeshShape) -> list[str]:
        """All mistakes of the electrodes on a mesh, each with its position."""
        mistakes = []
        size = (shape.cells_x, shape.cells_y)
        period = size[self.axis] if shape.periodic else 0
        x, y = (period, 0) if self.axis == 0 else (0, period)

        def common(pairs: Iterable[tuple[Strip, Strip]]) -> list[Strip]:
            """Intersections of strips, also with their images along the electrodes."""
            turns = (-1, 0, 1) if period else (0,)
            images = ((one, other.moved(k * x, k * y)) for one, other in pairs for k in turns)
            return [strip for one, image in images if (strip := one.shared(image))]

        def leaves(strip: Strip) -> bool:
            """Whether a strip extends beyond the fabric; across periodic electrodes it may wrap."""
            return not all(
                (low >= 0 and high <= cells)
                or (period and axis != self.axis and high - low < cells)
                for axis, (cells, (low, high)) in enumerate(zip(size, strip.extents, strict=True))
            )

        for name, strips in zip(NAMES, self.strips, strict=True):
            mistakes += [
                f"electrode {name} extends beyond the fabric: {strip} of {size[0]} × {size[1]}"
                for strip in filter(leaves, strips)
            ]
            mistakes += [
                f"electrode {name} overlaps itself: {shared}"
                for shared in common(combinations(strips, 2))
                if shared.area > 0
            ]
        touching = common(product(*self.strips))
        return mistakes + [f"the electrodes touch, a short circuit: {each}" for each in touching]


class BadLayout(ValueError):
    """A layout that is impossible on a fabric; ``messages`` has a sentence for each mistake."""

    def __init__(self, messages: list[str]) -> None:
        super().__init__("; ".join(messages))
        self.messages = messages


def _width(value: object, number_or_stripe: ValidatorFunctionWrapHandler) -> object:
    try:
        return number_or_stripe(value)
    except ValidationError as error:
        message = f"a width is a number of stitches above 0 or 'stripe', but is {value!r}"
        raise ValueError(message) from error


def _mask(rows: tuple[str, ...]) -> tuple[str, ...]:
    if len({len(row) for row in rows}) > 1 or "" in rows:
        raise ValueError("a mask is a rectangle of letters; give rows of equal length")
    if unknown := sorted(set("".join(rows).upper()) - {*NAMES, BARE}):
        raise ValueError(f"a mask consists of A, B and '.', not {', '.join(unknown)}")
    return rows


@dataclass(frozen=True)
class ElectrodeLayout(Checked):
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
    face: Literal["front", "back", "both"] = "front"
    within: Literal["patch", "fabric"] = "patch"
    width: Annotated[PositiveFloat | Literal["stripe"], WrapValidator(_width)] = "stripe"
    span: tuple[Position, Position] = (0.0, 1.0)
    mask: Annotated[tuple[str, ...], AfterValidator(_mask)] = ()


def place_electrodes(
    layout: ElectrodeLayout, pattern: PatchGrid, options: ModelOptions, stitches: StitchCounts
) -> Electrodes:
    """The electrodes of a layout on a fabric; or :class:`BadLayout` with every mistake."""
    shape = mesh_shape(pattern, options.boundary)
    if shape.periodic and layout.span != (0.0, 1.0):
        raise BadLayout(["periodic fabric has no ends; remove span, or use boundary = clamped"])
    if layout.mask:
        strips = _drawn(layout, shape)
    else:
        strips = _along_ridges(layout, pattern, options, stitches)
    electrodes = Electrodes((strips[0], strips[1]), layout.along)
    if mistakes := electrodes.mistakes(shape):
        raise BadLayout(mistakes)
    return electrodes


def ridge_lines(layout: ElectrodeLayout, pattern: PatchGrid, options: ModelOptions) -> list[int]:
    """Grid lines of the ridges that a layout counts."""
    like = pattern.knit_cells("rib") if layout.along == "wale" else pattern.knit_cells("garter").T
    sharp = Ridge(pattern.cells_per_period, SHARP)
    senses = fold_senses(like, options.fold_phase, options.boundary == "periodic", sharp)
    if layout.along == "course" and options.garter_start == "valley":
        senses = -senses
    folded = np.asarray(np.isin(senses, SENSES[layout.face]).any(axis=0))
    if layout.within == "patch":
        borders = pattern.column_borders if layout.along == "wale" else pattern.row_borders
        middle = (len(borders) - 2) // 2
        folded[: borders[middle]] = False
        folded[borders[middle + 1] :] = False
    return np.flatnonzero(folded).tolist()


def _along_ridges(
    layout: ElectrodeLayout, pattern: PatchGrid, options: ModelOptions, stitches: StitchCounts
) -> list[tuple[Strip, ...]]:
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
    return [
        (ridge_strip(layout, pattern, stitches, lines[number - 1]),) for number in layout.ridges
    ]


def ridge_strip(
    layout: ElectrodeLayout, pattern: PatchGrid, stitches: StitchCounts, line: int
) -> Strip:
    """The strip of a layout's width and span that is centred on a ridge, by its grid line."""
    wale = layout.along == "wale"
    start, end = (fraction * pattern.grid[not wale] for fraction in layout.span)
    width = pattern.cells_per_period / 2
    if layout.width != "stripe":
        width = layout.width / stitches[wale][line % pattern.grid[wale]]
    low, high = line - width / 2, line + width / 2
    return Strip(low, high, start, end) if wale else Strip(start, end, low, high)


def _drawn(layout: ElectrodeLayout, shape: MeshShape) -> list[tuple[Strip, ...]]:
    drawing = np.array([list(row.upper()) for row in layout.mask[::-1]])
    if drawing.shape != (shape.cells_y, shape.cells_x):
        message = (
            f"the mask has {len(layout.mask)} rows of {len(layout.mask[0])} letters, the fabric"
            f" {shape.cells_y} rows of {shape.cells_x} grid cells; draw one letter per cell"
        )
        raise BadLayout([message])
    if messages := [
        message for name in NAMES for message in _broken(name, drawing == name, layout.along, shape)
    ]:
        raise BadLayout(messages)
    plated = (np.argwhere(drawing == name).astype(float).tolist() for name in NAMES)
    return [tuple(Strip(x, x + 1, y, y + 1) for y, x in cells) for cells in plated]


def _broken(
    name: str, plated: Bool[np.ndarray, "row column"], along: Along, shape: MeshShape
) -> list[str]:
    """Mistakes of a drawn electrode: not connected, or not continued across a periodic boundary."""
    if not plated.any():
        return [f"the mask has no letter {name}; draw both electrodes"]
    from scipy.ndimage import label  # slow to import
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    pieces, count = label(plated)
    if shape.periodic:
        axis = 0 if along == "wale" else 1
        first = pieces.take(0, axis)
        last = pieces.take(-1, axis)
        meet = (first > 0) & (last > 0)
        if not meet.any():
            return [f"electrode {name} does not continue across the boundary of periodic fabric"]
        ends = first[meet], last[meet]
        graph = coo_array((np.ones(meet.sum()), ends), shape=(count + 1, count + 1))
        # What is bare remains a component of its own.
        with_bare, joined = connected_components(graph, directed=False)
        pieces = joined[pieces]
        count = with_bare - 1
    if count == 1:
        return []
    piece = pieces[plated]
    row, column = np.argwhere(plated)[np.argmin(np.bincount(piece)[piece])]
    return [f"electrode {name} is in {count} pieces, one of them at column {column}, row {row}"]


@dataclass(frozen=True)
class Capacitor(Checked):
    """Parameters of electrodes on a fabric.

    Attributes:
        layout: layout of the electrodes.
        electrode_length: relaxed length of the electrodes on periodic fabric [mm].
        permittivity: relative permittivity of the surroundings [1].
        clearance: distance below which electrodes count as touching [mm].
        accuracy: largest estimated relative error of a capacitance [1].
        linearity: R² that the working range must have [1].
        unfolded: fold angle over the relaxed one at which unfolding is complete [1].
        dielectric_thickness: of what insulates the electrodes from each other: a distance r between
            them counts as √(r² + dielectric_thickness²) [mm]. Insulated electrodes may touch.
        lead_capacitance: of the leads to the meter, parallel to the fabric [pF].
        ground: what lies below the fabric: nothing, or a grounded plane such as skin.
        ground_distance: distance of that plane from the lowest point of the fabric [mm].
    """

    layout: ElectrodeLayout
    electrode_length: Annotated[PositiveFloat, Unit("mm")]
    permittivity: Annotated[float, Field(ge=1)]
    clearance: Annotated[PositiveFloat, Unit("mm")]
    accuracy: Fraction
    linearity: Fraction
    unfolded: Fraction
    dielectric_thickness: Annotated[NonNegativeFloat, Unit("mm")] = 0.0
    lead_capacitance: Annotated[NonNegativeFloat, Unit("pF")] = 0.0
    ground: Literal["none", "plane"] = "none"
    ground_distance: Annotated[PositiveFloat, Unit("mm")] = 2.0
