"""A piece: the part of a patterned fabric that an outline needs, and the outline it relaxes to.

The piece is laid out on the grid of its fabric: as many rows of grid cells as its length needs,
and of each row the columns between its edges. How long and how wide a grid cell of the finished
piece is, at each height, is a :class:`Scale`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from knitlab.export.pieces.outline import Outline
from knitlab.export.pieces.rows import Row
from knitlab.io.errors import invalid
from knitlab.model.network import MeshShape, Spans
from knitlab.model.pattern import Grading
from knitlab.model.settings import PlainKnit
from knitlab.model.stitches import Gauge
from knitlab.solvers.case import Case

Border = Literal["whole", "plain", "cut"]
MIN_CELLS = 2  # grid cells of a row
MIN_PATCHES = 2  # along each axis, so that there is a unit cell
MAX_NODES = 60_000  # of the grid of a piece, about an hour on a core

Along = Float[np.ndarray, " row"]


@dataclass(frozen=True, eq=False)
class Scale:
    """Sizes at places from 0 at the lower end of a piece to 1.

    Attributes:
        place: the places, ascending.
        width: of a grid cell [mm], or a factor on it.
        height: the same along the wales.
    """

    place: Along
    width: Along
    height: Along

    @classmethod
    def of_rows(cls, width: Along, height: Along) -> "Scale":
        """Sizes in the rows of a grid."""
        return cls((np.arange(len(width)) + 0.5) / len(width), width, height)

    def at(self, place: Along) -> tuple[Along, Along]:
        """Width and height at other places."""
        width, height = (np.interp(place, self.place, of) for of in (self.width, self.height))
        return width, height

    def over(self, other: "Scale") -> "Scale":
        """Sizes over those of another scale, at the same places."""
        return Scale(self.place, self.width / other.width, self.height / other.height)

    def times(self, factor: "Scale") -> "Scale":
        """Sizes with a factor at every place."""
        width, height = factor.at(self.place)
        return Scale(self.place, self.width * width, self.height * height)

    def smooth(self, window: int) -> "Scale":
        """Means over so many neighbouring rows."""
        return Scale(self.place, *(mean_of_rows(of, window) for of in (self.width, self.height)))


UNCHANGED = Scale.of_rows(np.ones(1), np.ones(1))
"""The factor of sizes that are those of endless fabric."""


def mean_of_rows(values: Along, window: int) -> Along:
    """Means over so many neighbouring rows, fewer at the ends."""
    kernel = np.ones(min(window, len(values)))
    counts = np.convolve(np.ones(len(values)), kernel, "same")
    return np.convolve(values, kernel, "same") / counts


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

    def in_equilibrium(self, **changes: Any) -> Case:
        """The design with changes, without electrodes or perturbed copies."""
        left_out = {"sensitivities": False, "unloading": False, "robustness": 0, "capacitor": None}
        changed: dict[str, Any] = {**left_out, **changes}
        return replace(self.case, **changed).without_unused()

    def view(self, case: Case, positions: Float[np.ndarray, "node_y node_x 3"]) -> "PlanView":
        """A piece in a state seen from above, in the lengths of cloth.

        The tables of stripes have lengths of their own, so that rows of another garter stripe have
        another factor from the network to the cloth.
        """
        along_x, along_y = mm_of_cloth(case, self.gauge)
        x, y = np.moveaxis(positions[..., :2], -1, 0)
        steps = np.nanmean(np.diff(y, axis=0), axis=1)
        lines, in_cloth = (np.append(0.0, np.cumsum(step)) for step in (steps, steps * along_y))
        # A node line lies between two rows.
        beside = np.pad(along_y, 1, mode="edge")
        factor = (beside[1:] + beside[:-1]) / 2
        heights = in_cloth[:, None] + (y - lines[:, None]) * factor[:, None]
        return PlanView(case, np.stack([x * along_x.mean(), heights], axis=-1))

    def rows_of(self, kind: Row, length: float, factor: Scale) -> list[Row]:
        """Rows of one kind that a length needs; the last one may be lower, unless all are whole."""
        cells = self.case.options.cells_per_period
        _, factors = factor.at(np.linspace(0, 1, 101))
        periods = length / (kind.cell[1] * float(factors.mean()) * cells)
        unit = kind.periods if self.border == "whole" else 1
        count = max(round(periods / unit) * unit, MIN_PATCHES * kind.periods)
        whole, rest = divmod(count, kind.periods)
        return [kind] * whole + [replace(kind, periods=rest)] * (rest > 0)

    def endless(self, rows: Sequence[Row]) -> Scale:
        """The sizes of grid cells in rows, as in endless fabric of each kind."""
        cells = [row.periods * self.case.options.cells_per_period for row in rows]
        width, height = (np.repeat([row.cell[axis] for row in rows], cells) for axis in (0, 1))
        return Scale.of_rows(width, height)

    def piece(
        self, outline: Outline, rows: Sequence[Row], scale: Scale, strain: float = 0.0
    ) -> Case:
        """The case of a piece of these rows that has an outline, if its grid cells have a scale.

        It relaxes from the flat sheet to equilibrium, and is then pulled by the strain.
        """
        _, length = outline.size
        ends = np.cumsum(scale.height)
        lines = (ends - scale.height / 2) * length / ends[-1]
        left, right = self._edges(outline, rows, scale.width, lines)
        patch = self.patch
        first = int(left.min() // patch) * patch
        patches_x = max(-(-int(right.max() - first) // patch), MIN_PATCHES)
        spans = tuple(zip((left - first).tolist(), (right - first).tolist(), strict=True))
        if len(lines) * patches_x * patch > MAX_NODES:
            message = f"of {outline.size[0]:.0f} × {outline.size[1]:.0f} mm takes a grid of"
            nodes = f"{len(lines)} × {patches_x * patch} cells, above {MAX_NODES:,}"
            raise invalid("piece", f"{message} {nodes}; take a smaller piece, or larger n_stripe")
        return self._case(rows, patches_x, spans, strain)

    def _starts(self, rows: Sequence[Row]) -> np.ndarray:
        """The first row of grid cells of every row of patches, and the number of all."""
        cells = self.case.options.cells_per_period
        return np.append(0, np.cumsum([row.periods * cells for row in rows]))

    def _edges(
        self, outline: Outline, rows: Sequence[Row], width: Along, lines: Along
    ) -> tuple[np.ndarray, np.ndarray]:
        """Columns of the left and the right edge of every row, from the axis of the piece."""
        patch = self.patch
        unit = patch if self.border == "whole" else 1
        left, right = (edge / width for edge in outline.edges(lines))
        if self.border == "whole":
            # Rows of a patch begin and end together.
            starts = self._starts(rows)
            counts = np.diff(starts)
            left, right = (
                np.repeat(np.add.reduceat(edge, starts[:-1]) / counts, counts)
                for edge in (left, right)
            )
        # A piece may have its axis in the middle of a patch.
        columns = float((right - left).max())
        shift = patch / 2 * (round(columns / patch) % 2)
        left, right = (np.rint((edge + shift) / unit).astype(int) * unit for edge in (left, right))
        least = max(unit, MIN_CELLS)
        right = np.maximum(right, left + least)
        return left, right

    def _case(self, rows: Sequence[Row], patches_x: int, spans: Spans, strain: float) -> Case:
        case = self.case
        # Rib and garter alternate, as in the checkerboard of the design.
        of_rows, of_columns = np.indices((len(rows), patches_x))
        knit = np.where((of_rows + of_columns) % 2 == 0, case.pattern[-1][0], case.pattern[-1][1])
        knit[[row.is_plain for row in rows]] = "P"
        if self.border == "plain":
            knit[self._is_cut(rows, patches_x, spans)] = "P"
        grading = Grading(
            row_periods=tuple(row.periods for row in rows[::-1]),
            column_periods=(case.periods,) * patches_x,
            row_stripes=tuple(row.stripe for row in rows[::-1]),
            column_stripes=(case.weft,) * patches_x,
        )
        return self.in_equilibrium(
            pattern=tuple("".join(row) for row in knit[::-1]),
            unit_cells=(1, 1),
            grading=grading,
            cell_patches=(2, 2),
            spans=spans,
            applied_strain=(0.0, strain) if strain else (0.0,),
            options=replace(case.options, boundary="clamped"),
            solver=replace(case.equilibrium_solver, start="flat"),
            plain=self.plain if "P" in knit else None,
        )

    def _is_cut(self, rows: Sequence[Row], patches_x: int, spans: Spans) -> np.ndarray:
        """Which patches have grid cells on both sides of an edge."""
        columns = patches_x * self.patch
        inside = MeshShape(len(spans), columns, periodic=False, spans=spans).has_fabric
        starts = self._starts(rows)
        by_row = np.add.reduceat(inside, starts[:-1], axis=0, dtype=int)
        count = np.add.reduceat(by_row, np.arange(0, columns, self.patch), axis=1)
        return (count > 0) & (count < np.diff(starts)[:, None] * self.patch)


def mm_of_cloth(
    case: Case, gauge: Gauge
) -> tuple[Float[np.ndarray, " grid_x"], Float[np.ndarray, " grid_y"]]:
    """Lengths in cloth over those in the network, of every column and row of grid cells [1]."""
    _, fabric = case.assemble()
    courses, wales = case.stitches_per_cell
    return wales * gauge.stitch_width / fabric.cell_x, courses * gauge.stitch_height / fabric.cell_y


@dataclass(frozen=True, eq=False)
class PlanView:
    """A simulated piece seen from above, in cloth.

    Attributes:
        case: the piece.
        nodes: x and y of its nodes; NaN without fabric [mm].
    """

    case: Case
    nodes: Float[np.ndarray, "node_y node_x 2"]

    @property
    def _columns(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Every row of grid cells with its first column of nodes and its last."""
        first, last = np.array(self.case.spans).T
        return np.arange(len(first)), first, last

    @property
    def outline(self) -> Outline:
        """The line around it, its lowest point at y = 0 and its middle at x = 0."""
        nodes = self.nodes
        rows, first, last = self._columns
        # At a step an edge goes along the line between two rows.
        left, right = (
            np.stack([nodes[rows, at], nodes[rows + 1, at]], axis=1).reshape(-1, 2)
            for at in (first, last)
        )
        bottom = nodes[0, first[0] + 1 : last[0]]
        top = nodes[-1, first[-1] + 1 : last[-1]]
        line = np.concatenate([right, top[::-1], left[::-1], bottom])
        middle = (line[:, 0].min() + line[:, 0].max()) / 2
        return Outline(line - [middle, line[:, 1].min()])

    @property
    def widths(self) -> Along:
        """Width of every row of grid cells [mm]."""
        rows, first, last = self._columns
        across = [self.nodes[line, last] - self.nodes[line, first] for line in (rows, rows + 1)]
        return (across[0] + across[1])[:, 0] / 2

    @property
    def scale(self) -> Scale:
        """Mean size of the grid cells in every row [mm]."""
        rows, first, last = self._columns
        along = [
            (self.nodes[row + 1, start : end + 1, 1] - self.nodes[row, start : end + 1, 1]).mean()
            for row, start, end in zip(rows, first, last, strict=True)
        ]
        return Scale.of_rows(self.widths / (last - first), np.array(along))

    @property
    def places(self) -> Along:
        """Middle of every row along the length, from 0 to 1."""
        height = self.scale.height
        ends = np.cumsum(height)
        return np.asarray((ends - height / 2) / ends[-1])
