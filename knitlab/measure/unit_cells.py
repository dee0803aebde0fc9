"""Unit cells of a fabric on the grid of its nodes, between whose corners strains are measured."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Array, Float, Int

from knitlab.fabric.fabric import Configuration
from knitlab.fabric.network import MeshShape


@dataclass(frozen=True)
class CellGrid:
    """Grid lines, ascending from 0, between which unit cells lie; these may differ."""

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
        row, column = ((count - 1) // 2 for count in self.count)
        return (
            slice(self.rows[row], self.rows[row + 1] + 1),
            slice(self.columns[column], self.columns[column + 1] + 1),
        )


def central(count: int) -> slice:
    """The central ones of ``count`` unit cells along one direction, over which is averaged.

    Their middle is in the middle third; if none is, they are the two next to the middle: 1 of 1,
    2 of 2, 1 of 3, 2 of 4, 1 of 5, 3 of 11, 8 of 22. The paper does not state its number.
    """
    first = min(math.ceil(count / 3 - 0.5), (count - 1) // 2)
    return slice(first, count - first)


def nodes_at(
    shape: MeshShape,
    configuration: Configuration,
    rows: Int[np.ndarray, " row"],
    columns: Int[np.ndarray, " column"],
) -> Float[Array | np.ndarray, "*state row column 3"]:
    """Positions of nodes; beyond the last of periodic fabric, images of the first [mm]."""
    turns_y, rows = np.divmod(rows, shape.nodes_y)
    turns_x, columns = np.divmod(columns, shape.nodes_x)
    # Numbers of periods L_x in x, and L_y in y.
    turns = np.zeros((len(rows), len(columns), 3, 2))
    turns[..., 0, 0], turns[..., 1, 1] = turns_x[None, :], turns_y[:, None]
    images = (turns * configuration.lengths[..., None, None, None, :]).sum(-1)
    return configuration.positions[..., rows[:, None], columns[None, :], :] + images


def unit_cell_corners(
    shape: MeshShape, cells: CellGrid, configuration: Configuration
) -> Float[Array | np.ndarray, "*state corner_y corner_x 2"]:
    """Positions (x, y) of the corners of the unit cells, in one state or several [mm]."""
    return nodes_at(shape, configuration, np.array(cells.rows), np.array(cells.columns))[..., :2]
