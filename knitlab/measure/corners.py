"""Corners of the unit cells of a simulated configuration."""

import numpy as np
from jaxtyping import Array, Float

from knitlab.fabric.configuration import Configuration
from knitlab.fabric.network import MeshShape
from knitlab.measure.cell_grid import CellGrid
from knitlab.measure.grid_nodes import nodes_at


def unit_cell_corners(
    shape: MeshShape,
    cells: CellGrid,
    configuration: Configuration,
) -> Float[Array | np.ndarray, "*state corner_y corner_x 2"]:
    """Positions (x, y) of the corners of the unit cells [mm].

    Args:
        shape: mesh of the configuration.
        cells: the unit cells.
        configuration: configuration of one state or several; in periodic fabric the last corners
            are images of the first.
    """
    return nodes_at(shape, configuration, np.array(cells.rows), np.array(cells.columns))[..., :2]
