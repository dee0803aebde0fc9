"""Nodes by grid indices, including images beyond periodic boundaries."""

import numpy as np
from jaxtyping import Array, Float, Int

from knitlab.fabric.configuration import Configuration
from knitlab.fabric.network import MeshShape


def nodes_at(
    shape: MeshShape,
    configuration: Configuration,
    rows: Int[np.ndarray, " row"],
    columns: Int[np.ndarray, " column"],
) -> Float[Array | np.ndarray, "*state row column 3"]:
    """Positions of the nodes at rows and columns of the grid [mm].

    Args:
        shape: mesh of the configuration.
        configuration: configuration of one state or several; in periodic fabric nodes beyond the
            last are images of the first.
        rows: indices of rows, 0 at the bottom.
        columns: indices of columns, 0 on the left.
    """
    turns_y, rows = np.divmod(rows, shape.nodes_y)
    turns_x, columns = np.divmod(columns, shape.nodes_x)
    # Numbers of periods L_x in x, and L_y in y.
    turns = np.zeros((len(rows), len(columns), 3, 2))
    turns[..., 0, 0], turns[..., 1, 1] = turns_x[None, :], turns_y[:, None]
    images = (turns * configuration.lengths[..., None, None, None, :]).sum(-1)
    return configuration.positions[..., rows[:, None], columns[None, :], :] + images
