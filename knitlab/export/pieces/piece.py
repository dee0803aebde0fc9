"""A piece: the part of a patterned fabric that an outline needs, and the outline it relaxes to.

The piece is laid out on the grid of its fabric: as many rows of grid cells as its length needs,
and of each row the columns between its edges. How long and how wide a grid cell of the finished
piece is, at each height, is a :class:`Scale`.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from knitlab.export.pieces.outline import Outline
from knitlab.io.errors import invalid
from knitlab.model.network import Spans
from knitlab.model.pattern import Grading
from knitlab.model.settings import PlainKnit
from knitlab.model.stitches import Gauge
from knitlab.solvers.case import Case
from knitlab.solvers.equilibrium.settings import Solver

Border = Literal["whole", "plain", "cut"]
LEAST_CELLS = 2  # grid cells of a row
LEAST_PATCHES = 2  # along each axis, so that there is a unit cell
MAX_NODES = 60_000  # of the grid of a piece, about an hour on a core

Along = Float[np.ndarray, " row"]


@dataclass(frozen=True, eq=False)
class Scale:
    """Size of a grid cell of the finished piece, at places from 0 at its lower end to 1 [mm]."""

    place: Along
    width: Along
    height: Along

    @classmethod
    def even(cls, width: float, height: float) -> "Scale":
        """The same size everywhere."""
        return cls(np.array([0.5]), np.array([width]), np.array([height]))

    def at(self, place: Along) -> tuple[Along, Along]:
        """Width and height at other places."""
        width, height = (np.interp(place, self.place, of) for of in (self.width, self.height))
        return width, height


@dataclass(frozen=True, eq=False)
class Fabric:
    """What pieces are cut from: endless patches of one design.

    Attributes:
        case: the design, with its model, walls and material.
        gauge: the size of a stitch [mm].
        plain: plain knit, for borders.
        border: how patches end at the outline: ``"whole"``, none is cut; ``"cut"``, along the grid;
            ``"plain"``, those that are cut are plain knit.
    """

    case: Case
    gauge: Gauge
    plain: PlainKnit | None
    border: Border

    @property
    def patch(self) -> int:
        """Grid cells along a side of a patch."""
        return self.case.periods * self.case.options.cells_per_period

    @property
    def mm_of_cloth(self) -> Float[np.ndarray, "2"]:
        """Lengths in cloth over those in the network, along x and y [1]."""
        width, height = self.case.flat_cell
        stitches = self.case.stitches
        gauge = self.gauge
        along_x = stitches.wales_in_cell * gauge.stitch_width / width
        return np.array([along_x, stitches.courses_in_cell * gauge.stitch_height / height])

    def piece(self, outline: Outline, scale: Scale, strain: float = 0.0) -> Case:
        """The case of the piece that has an outline, if its grid cells have the sizes of a scale.

        It relaxes from the flat sheet to equilibrium, and is then pulled by the strain.
        """
        lines = self._rows(outline, scale)
        left, right = self._edges(outline, scale, lines)
        patch = self.patch
        first = int(left.min() // patch) * patch
        patches_x = max(-(-int(right.max() - first) // patch), LEAST_PATCHES)
        spans = tuple(zip((left - first).tolist(), (right - first).tolist(), strict=True))
        rows = len(lines)
        if rows * patches_x * patch > MAX_NODES:
            message = f"of {outline.size[0]:.0f} × {outline.size[1]:.0f} mm takes a grid of"
            nodes = f"{rows} × {patches_x * patch} cells, above {MAX_NODES:,}"
            raise invalid("piece", f"{message} {nodes}; take a smaller piece, or larger n_stripe")
        periods = [self.case.periods] * (rows // patch)
        if rest := rows % patch:
            periods.append(rest // self.case.options.cells_per_period)
        return self._case(tuple(periods), patches_x, spans, strain)

    def _rows(self, outline: Outline, scale: Scale) -> Along:
        """Heights of the middles of the rows of grid cells in the finished piece [mm]."""
        _, length = outline.size
        unit = self.patch if self.border == "whole" else self.case.options.cells_per_period
        _, height = scale.at(np.linspace(0, 1, 101))
        count = max(round(length / float(height.mean()) / unit) * unit, LEAST_PATCHES * self.patch)
        _, height = scale.at((np.arange(count) + 0.5) / count)
        ends = np.cumsum(height)
        return (ends - height / 2) * length / ends[-1]

    def _edges(self, outline: Outline, scale: Scale, lines: Along) -> tuple[np.ndarray, np.ndarray]:
        """Columns of the left and the right edge of every row, from the axis of the piece."""
        width, _ = scale.at((np.arange(len(lines)) + 0.5) / len(lines))
        patch = self.patch
        unit = patch if self.border == "whole" else 1
        left, right = (edge / width for edge in outline.edges(lines))
        if self.border == "whole":
            # Rows of a patch begin and end together.
            starts = np.arange(0, len(lines), patch)
            of_patch = np.arange(len(lines)) // patch
            counts = np.diff(np.append(starts, len(lines)))
            left, right = (
                (np.add.reduceat(edge, starts) / counts)[of_patch] for edge in (left, right)
            )
        # A piece may have its axis in the middle of a patch.
        columns = float((right - left).max())
        shift = patch / 2 * (round(columns / patch) % 2)
        left, right = (np.rint((edge + shift) / unit).astype(int) * unit for edge in (left, right))
        least = max(unit, LEAST_CELLS)
        right = np.maximum(right, left + least)
        return left, right

    def _case(self, periods: tuple[int, ...], patches_x: int, spans: Spans, strain: float) -> Case:
        case = self.case
        letters = np.resize(np.array([list(row) for row in case.pattern[::-1]]), (2, 2))
        knit = np.tile(letters, (-(-len(periods) // 2), -(-patches_x // 2)))
        knit = knit[: len(periods), :patches_x].copy()
        if self.border == "plain":
            knit[self._is_cut(periods, patches_x, spans)] = "P"
        grading = Grading(
            row_periods=periods[::-1],
            column_periods=(case.periods,) * patches_x,
            row_stripes=(case.warp,) * len(periods),
            column_stripes=(case.weft,) * patches_x,
        )
        piece = replace(
            case,
            pattern=tuple("".join(row) for row in knit[::-1]),
            unit_cells=(1, 1),
            grading=grading,
            cell_patches=(2, 2),
            spans=spans,
            applied_strain=(0.0, strain) if strain else (0.0,),
            options=replace(case.options, boundary="clamped"),
            method="equilibrium",
            solver=replace(case.solver or Solver(), start="flat"),
            plain=self.plain if "P" in knit else None,
            sensitivities=False,
            unloading=False,
            capacitor=None,
            robustness=0,
        )
        return piece.without_unused()

    def _is_cut(self, periods: tuple[int, ...], patches_x: int, spans: Spans) -> np.ndarray:
        """Which patches have grid cells on both sides of an edge."""
        left, right = np.array(spans).T[..., None]
        column = np.arange(patches_x * self.patch)
        inside = (left <= column) & (column < right)
        starts = np.append(0, np.cumsum(periods)[:-1]) * self.case.options.cells_per_period
        rows = np.diff(np.append(starts, len(spans)))
        count = np.add.reduceat(
            np.add.reduceat(inside, starts, axis=0, dtype=int),
            np.arange(0, inside.shape[1], self.patch),
            axis=1,
        )
        return (count > 0) & (count < rows[:, None] * self.patch)


def finished(
    case: Case, positions: Float[np.ndarray, "node_y node_x 3"], mm_of_cloth: Float[np.ndarray, "2"]
) -> tuple[Outline, Scale]:
    """The outline of a simulated piece seen from above, and the sizes of its grid cells [mm]."""
    plane = positions[..., :2] * mm_of_cloth
    first, last = np.array(case.spans).T
    rows = np.arange(len(first))
    # At a step an edge goes along the line between two rows.
    left = np.stack([plane[rows, first], plane[rows + 1, first]], axis=1).reshape(-1, 2)
    right = np.stack([plane[rows, last], plane[rows + 1, last]], axis=1).reshape(-1, 2)
    ends = plane[0, first[0] + 1 : last[0]], plane[-1, first[-1] + 1 : last[-1]]
    line = np.concatenate([right, ends[1][::-1], left[::-1], ends[0]])
    line = line - [(line[:, 0].min() + line[:, 0].max()) / 2, line[:, 1].min()]
    middle = np.array([plane[row, first[row] : last[row] + 1, 1].mean() for row in rows])
    above = np.array([plane[row + 1, first[row] : last[row] + 1, 1].mean() for row in rows])
    wide = plane[rows, last] - plane[rows, first] + plane[rows + 1, last] - plane[rows + 1, first]
    width = wide[:, 0] / 2 / (last - first)
    return Outline(line), _smooth(case, width, above - middle)


def _smooth(case: Case, width: Along, height: Along) -> Scale:
    """Sizes of grid cells averaged over a unit cell, within which folds change them."""
    window = min(2 * case.periods * case.options.cells_per_period, len(width))
    kernel = np.ones(window)
    counts = np.convolve(np.ones(len(width)), kernel, "same")
    smoothed = (np.convolve(of, kernel, "same") / counts for of in (width, height))
    return Scale((np.arange(len(width)) + 0.5) / len(width), *smoothed)
