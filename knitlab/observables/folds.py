"""Folds: their angles, those beyond ±π, and the widths of patches across them."""

import numpy as np
from jaxtyping import Int

from knitlab.model.cell_grid import CellGrid, nodes_at
from knitlab.model.energy import fold_angles
from knitlab.model.fabric import Configuration, Fabric
from knitlab.model.network import MeshShape, Network
from knitlab.model.pattern import KNIT_OF_LETTER, PatchGrid


def hinges_past_pi(
    net: Network, fabric: Fabric, configuration: Configuration
) -> Int[np.ndarray, "*state"]:
    """Number of hinges with stiffness folded beyond ±π, where the fabric passes through itself."""
    past = np.abs(fold_angles(net, fabric, configuration)) > np.pi
    return (past & (np.asarray(fabric.fold_stiffness) > 0)).sum(axis=-1)


def widths_across_folds(
    shape: MeshShape, pattern: PatchGrid, cells: CellGrid, configuration: Configuration
) -> dict[str, tuple[float, float]]:
    """Width of the patches across their folds (paper, "Relaxation"), at centre and edges [mm].

    The width of a rib patch is the distance of its borders along the weft, on its middle row and,
    as a mean, on its first and last; that of a garter patch likewise along the warp. Patches of a
    knit in the unit cell nearest the middle are averaged.
    """
    rows, columns = cells.middle
    widths: dict[str, list[tuple[float, float]]] = {}
    for row, column in np.ndindex(pattern.knit.shape):
        low, high = pattern.row_borders[row : row + 2]
        left, right = pattern.column_borders[column : column + 2]
        inside = rows.start <= low < high < rows.stop
        inside &= columns.start <= left < right < columns.stop
        knit = KNIT_OF_LETTER[str(pattern.knit[row, column])]
        if not inside or knit == "plain":
            continue
        patch = np.arange(low, high + 1), np.arange(left, right + 1)
        nodes = np.asarray(nodes_at(shape, configuration, *patch))
        across = nodes[:, -1, 0] - nodes[:, 0, 0]
        width = across if knit == "rib" else nodes[-1, :, 1] - nodes[0, :, 1]
        widths.setdefault(knit, []).append((width[len(width) // 2], (width[0] + width[-1]) / 2))
    return {
        knit: (float(centre), float(edge))
        for knit, (centre, edge) in ((knit, np.mean(each, axis=0)) for knit, each in widths.items())
    }
