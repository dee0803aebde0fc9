"""Nodes at places of the grid, beyond the seam of periodic fabric too."""

import numpy as np
from jaxtyping import Array, Float, Int

from knitlab.model.configuration import Configuration
from knitlab.model.network import MeshShape


def nodes_at(
    shape: MeshShape,
    configuration: Configuration,
    rows: Int[np.ndarray, " row"],
    columns: Int[np.ndarray, " column"],
) -> Float[Array | np.ndarray, "*state row column 3"]:
    """Positions of the nodes where rows and columns of the grid cross [mm].

    Args:
        shape: mesh of the configuration.
        configuration: of one state or several; in periodic fabric nodes beyond the last are
            images of the first.
        rows: numbers of rows, 0 at the bottom.
        columns: numbers of columns, 0 on the left.
    """
    turns_y, rows = np.divmod(rows, shape.nodes_y)
    turns_x, columns = np.divmod(columns, shape.nodes_x)
    # How often L_x moves x, and L_y moves y.
    turns = np.zeros((len(rows), len(columns), 3, 2))
    turns[..., 0, 0], turns[..., 1, 1] = turns_x[None, :], turns_y[:, None]
    images = (turns * configuration.lengths[..., None, None, None, :]).sum(-1)
    return configuration.positions[..., rows[:, None], columns[None, :], :] + images
