"""The grid of unit cells on a fabric, and positions of nodes, also in images of a period."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int

from knitlab.model.network import MeshShape

if TYPE_CHECKING:
    from jaxtyping import Array

    from knitlab.model.fabric import Configuration


@dataclass(frozen=True)
class CellGrid:
    """Grid lines, ascending from 0, between which unit cells lie; these may differ."""

    rows: tuple[int, ...]
    columns: tuple[int, ...]

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
    """The central ones of ``count`` unit cells along a direction: results are their average.

    Their middle is in the middle third; if none is, they are the two next to the middle: 1 of 1, 2
    of 2, 1 of 3, 2 of 4, 1 of 5, 3 of 11, 8 of 22. The paper does not state its number.
    """
    first = min(math.ceil(count / 3 - 0.5), (count - 1) // 2)
    return slice(first, count - first)


def nodes_at(
    shape: MeshShape,
    configuration: "Configuration",
    rows: Int[np.ndarray, " row"],
    columns: Int[np.ndarray, " column"],
) -> "Float[Array | np.ndarray, '*state row column 3']":
    """Positions of nodes [mm]; rows and columns beyond the last are images (periodic fabric)."""
    turns_y, rows = np.divmod(rows, shape.nodes_y)
    turns_x, columns = np.divmod(columns, shape.nodes_x)
    # Of the lengths L_x in x and L_y in y, and of a shear that shifts images along y in x.
    turns = np.zeros((len(rows), len(columns), 3, configuration.lengths.shape[-1]))
    turns[..., 0, 0] = turns_x[None, :]
    turns[..., 1, 1] = turns_y[:, None]
    turns[..., 0, 2:] = turns_y[:, None, None]
    images = (turns * configuration.lengths[..., None, None, None, :]).sum(-1)
    return configuration.positions[..., rows[:, None], columns[None, :], :] + images
