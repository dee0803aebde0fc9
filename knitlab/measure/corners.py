"""Corners of the unit cells of a simulated configuration."""

import numpy as np
from jaxtyping import Array, Float

from knitlab.measure.grid_nodes import nodes_at
from knitlab.model.configuration import Configuration
from knitlab.model.network import MeshShape


def unit_cell_corners(
    shape: MeshShape,
    unit_cells: tuple[int, int],
    configuration: Configuration,
) -> Float[Array | np.ndarray, "*state corner_y corner_x 2"]:
    """Positions (x, y) of the corners of the unit cells [mm].

    Args:
        shape: mesh of the configuration.
        unit_cells: number of unit cells along (y, x).
        configuration: configuration of one state or several; in periodic fabric the last corners
            are images of the first.
    """
    steps = shape.cells_y // unit_cells[0], shape.cells_x // unit_cells[1]
    rows = steps[0] * np.arange(unit_cells[0] + 1)
    columns = steps[1] * np.arange(unit_cells[1] + 1)
    return nodes_at(shape, configuration, rows, columns)[..., :2]
