"""Patches: their contraction at the centre and at the edges (paper, "Relaxation")."""

import numpy as np
from jaxtyping import Float

from knitlab.fabric.configuration import Configuration
from knitlab.fabric.network import MeshShape
from knitlab.fabric.pattern import KNIT_OF_LETTER, PatchGrid
from knitlab.measure.cell_grid import CellGrid
from knitlab.measure.grid_nodes import nodes_at


def central_cell(
    shape: MeshShape, cells: CellGrid, configuration: Configuration
) -> Float[np.ndarray, "row column 3"]:
    """Nodes of the unit cell nearest the middle, including its last row and column [mm].

    Args:
        shape: mesh of the configuration.
        cells: the unit cells.
        configuration: configuration of one state; the last nodes of the cell of periodic fabric
            are images of its first nodes.
    """
    rows, columns = (np.arange(lines.start, lines.stop) for lines in cells.middle)
    return np.asarray(nodes_at(shape, configuration, rows, columns))


def widths_across_folds(
    shape: MeshShape, pattern: PatchGrid, cells: CellGrid, configuration: Configuration
) -> dict[str, tuple[float, float]]:
    """Width of the patches of a unit cell across their folds, at the centre and at the edges [mm].

    The width of a rib patch is the distance of its borders along the weft. At its centre it is
    measured on its middle row, at its edges it is the mean of its first and last row. The width of
    a garter patch is measured in the same way along the warp. Patches of a knit in the unit cell
    nearest the middle are averaged.

    Args:
        shape: mesh of the configuration.
        pattern: pattern of the whole fabric.
        cells: its unit cells.
        configuration: configuration of one state.

    Returns:
        (centre, edge) of ``rib`` and ``garter``, if the unit cell has such patches.
    """
    middle = central_cell(shape, cells, configuration)
    rows, columns = cells.middle
    found: dict[str, list[tuple[float, float]]] = {}
    for row, column in np.ndindex(pattern.knit.shape):
        low, high = pattern.row_borders[row : row + 2] - rows.start
        left, right = pattern.column_borders[column : column + 2] - columns.start
        inside = low >= 0 and left >= 0 and high < middle.shape[0] and right < middle.shape[1]
        knit = KNIT_OF_LETTER[str(pattern.knit[row, column])]
        if not inside or knit == "plain":
            continue
        nodes = middle[low : high + 1, left : right + 1]
        across = nodes[:, -1, 0] - nodes[:, 0, 0]
        width = across if knit == "rib" else nodes[-1, :, 1] - nodes[0, :, 1]
        centre, edge = width[len(width) // 2], (width[0] + width[-1]) / 2
        found.setdefault(knit, []).append((float(centre), float(edge)))
    means = {knit: np.mean(widths, axis=0) for knit, widths in found.items()}
    return {knit: (float(mean[0]), float(mean[1])) for knit, mean in means.items()}
