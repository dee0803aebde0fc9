"""Boundaries between unit cells, traced on simulated fabric (paper, Fig. "wavelength analysis")."""

from typing import Literal

import numpy as np
from jaxtyping import Float

from knitlab.fabric.configuration import Configuration
from knitlab.fabric.network import MeshShape
from knitlab.measure.cell_grid import CellGrid
from knitlab.measure.wavelength import FEWEST_WAVES, Wave, wave_of

PERIODIC_CELLS = 8
"""Number of unit cells over which the boundary of periodic fabric is traced."""

Direction = Literal["x", "y"]


def boundary_line(
    shape: MeshShape,
    unit_cells: CellGrid,
    configuration: Configuration,
    direction: Direction,
) -> Float[np.ndarray, "point 2"]:
    """The boundary between unit cells nearest the middle of the fabric, from edge to edge [mm].

    Args:
        shape: mesh of the configuration.
        unit_cells: the unit cells.
        configuration: configuration of one state. In periodic fabric the boundary is followed
            across :data:`PERIODIC_CELLS` cells.
        direction: direction of the boundary, the weft x or the warp y.

    Returns:
        Coordinates along that direction and across it, seen from above.
    """
    nodes, sides = np.asarray(configuration.positions)[..., :2], configuration.lengths
    if direction == "x":
        line = nodes[unit_cells.rows[unit_cells.count[0] // 2]]
        length = sides[0]
    else:
        line = nodes[:, unit_cells.columns[unit_cells.count[1] // 2], ::-1]
        length = sides[1]
    if not shape.periodic:
        return line
    turns = np.stack([length * np.arange(PERIODIC_CELLS), np.zeros(PERIODIC_CELLS)], axis=-1)
    return (turns[:, None] + line).reshape(-1, 2)


def boundary_wave(
    shape: MeshShape,
    unit_cells: CellGrid,
    configuration: Configuration,
    direction: Direction,
) -> Wave | None:
    """The wave of that boundary; ``None`` if it crosses too few unit cells.

    Arguments as for :func:`boundary_line`.
    """
    cells = unit_cells.count[1 if direction == "x" else 0]
    if shape.periodic:
        cells *= PERIODIC_CELLS
    if cells < FEWEST_WAVES:
        return None
    return wave_of(boundary_line(shape, unit_cells, configuration, direction), cells)
