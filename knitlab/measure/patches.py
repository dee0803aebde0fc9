"""Patches: their contraction at the centre and at the edges (paper, "Relaxation")."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from knitlab.measure.grid_nodes import nodes_at
from knitlab.model.configuration import Configuration
from knitlab.model.network import MeshShape


def central_cell(
    shape: MeshShape,
    unit_cells: tuple[int, int],
    configuration: Configuration,
) -> Float[np.ndarray, "row column 3"]:
    """Nodes of the unit cell nearest the middle, including its last row and column [mm].

    Args:
        shape: mesh of the configuration.
        unit_cells: number of unit cells along (y, x).
        configuration: configuration of one state; the cell of periodic fabric is closed by images
            of its first nodes.
    """
    ranges = []
    for cells, count in zip((shape.cells_y, shape.cells_x), unit_cells, strict=True):
        span = cells // count
        ranges.append(span * ((count - 1) // 2) + np.arange(span + 1))
    return np.asarray(nodes_at(shape, configuration, *ranges))


def widths_across_folds(
    cell: Float[np.ndarray, "row column 3"], pattern: Sequence[str]
) -> dict[str, tuple[float, float]]:
    """Width of the patches of a unit cell across their folds, at the centre and at the edges [mm].

    The width of a rib patch is the distance of its borders along the weft: on its middle row at the
    centre, and averaged over its first and last row at the edges. That of a garter patch is along
    the warp. Patches of each knit are averaged.

    Args:
        cell: nodes of a unit cell, including the last row and column.
        pattern: its patch map, top course first.

    Returns:
        (centre, edge) of ``rib`` and ``garter``, if the pattern has them.
    """
    span_y = (cell.shape[0] - 1) // len(pattern)
    span_x = (cell.shape[1] - 1) // len(pattern[0])
    found: dict[str, list[tuple[float, float]]] = {}
    for place_y, letters in enumerate(reversed(pattern)):
        for place_x, letter in enumerate(letters):
            nodes = cell[
                place_y * span_y : (place_y + 1) * span_y + 1,
                place_x * span_x : (place_x + 1) * span_x + 1,
            ]
            rib = letter in "Rr"
            width = nodes[:, -1, 0] - nodes[:, 0, 0] if rib else nodes[-1, :, 1] - nodes[0, :, 1]
            centre, edge = width[len(width) // 2], (width[0] + width[-1]) / 2
            found.setdefault("rib" if rib else "garter", []).append((float(centre), float(edge)))
    means = {kind: np.mean(widths, axis=0) for kind, widths in found.items()}
    return {kind: (float(mean[0]), float(mean[1])) for kind, mean in means.items()}
