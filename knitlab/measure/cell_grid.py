"""The grid of unit cells over a fabric, between whose corners strains are measured."""

from dataclasses import dataclass

from knitlab.fabric.network import MeshShape


@dataclass(frozen=True)
class CellGrid:
    """Grid lines between which the unit cells of a fabric lie; cells need not be equal.

    Attributes:
        rows: lines along the weft, ascending from 0 to the last one.
        columns: lines along the warp, ascending from 0 to the last one.
    """

    rows: tuple[int, ...]
    columns: tuple[int, ...]

    @classmethod
    def even(cls, shape: MeshShape, unit_cells: tuple[int, int]) -> "CellGrid":
        """Equal unit cells, with their numbers along (y, x)."""
        along_y, along_x = unit_cells
        rows = range(0, shape.cells_y + 1, shape.cells_y // along_y)
        columns = range(0, shape.cells_x + 1, shape.cells_x // along_x)
        return cls(tuple(rows), tuple(columns))

    @property
    def count(self) -> tuple[int, int]:
        """Number of unit cells along (y, x)."""
        return len(self.rows) - 1, len(self.columns) - 1

    @property
    def middle(self) -> tuple[slice, slice]:
        """Nodes (rows, columns) of the unit cell nearest the middle, including its last lines."""
        spans = []
        for lines, count in zip((self.rows, self.columns), self.count, strict=True):
            first = (count - 1) // 2
            spans.append(slice(lines[first], lines[first + 1] + 1))
        return spans[0], spans[1]
