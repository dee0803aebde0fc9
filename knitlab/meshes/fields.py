"""Fields: what a fabric has at its nodes and in its grid cells, by name and unit."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from jaxtyping import Float, Int

if TYPE_CHECKING:
    from knitlab.fabric.electrodes import Strip
    from knitlab.fabric.pattern import Knit, PatchGrid
    from knitlab.simulation.case import Case

KNITS: tuple["Knit", ...] = ("rib", "garter", "plain")
CONDUCTORS = ("none", "A", "B")


def _with_legend(name: str, words: Sequence[str]) -> str:
    return f"{name} ({', '.join(f'{code} {word}' for code, word in enumerate(words))})"


HEIGHT = "height [mm]"
FOLD_ANGLE = "fold_angle [rad]"
APPLIED_STRAIN = "applied_strain [1]"
KNIT = _with_legend("knit", KNITS)
PATCH = "patch"
ELECTRODE = _with_legend("electrode", CONDUCTORS)
PLATED = "plated [1]"
STRETCHES = {"stretch_weft [1]": 1, "stretch_warp [1]": 0}
"""Fields of the stretch of grid cells, and the axis of the grid that they are along."""
UNIT_CELL_STRAINS = ("strain_xx", "strain_yy")


def knit_of_cells(pattern: "PatchGrid") -> Int[np.ndarray, "cell_y cell_x"]:
    """The knit of every grid cell, as its place among :data:`KNITS`."""
    of_knits = [pattern.cells_of(knit) for knit in KNITS]
    return np.argmax(of_knits, axis=0)


def patch_of_cells(pattern: "PatchGrid") -> Int[np.ndarray, "cell_y cell_x"]:
    """The patch of every grid cell, counted from 0 at the bottom left along the courses."""
    across = pattern.knit.shape[1]
    return pattern.patch_of_row[:, None] * across + pattern.patch_of_column


def plated_part(case: "Case") -> Float[np.ndarray, "electrode cell_y cell_x"]:
    """The part of every grid cell that each of the two electrodes of a case covers [1]."""
    shape = case.mesh_shape
    return np.stack(
        [
            sum(
                (_covered(strip, shape.cells_y, shape.cells_x, shape.periodic) for strip in strips),
                np.zeros((shape.cells_y, shape.cells_x)),
            )
            for strips in case.electrodes.strips
        ]
    )


def _covered(
    strip: "Strip", cells_y: int, cells_x: int, periodic: bool
) -> Float[np.ndarray, "cell_y cell_x"]:
    across, along = (
        _overlap(extent, cells, periodic)
        for extent, cells in zip(strip.extents, (cells_x, cells_y), strict=True)
    )
    return along[:, None] * across


def _overlap(extent: tuple[float, float], cells: int, periodic: bool) -> Float[np.ndarray, " cell"]:
    """Length of an extent within every cell of a line; over a seam it goes on at the other end."""
    low, high = extent
    start = np.arange(cells)
    turns = (-cells, 0, cells) if periodic else (0,)
    return sum(
        np.clip(np.minimum(high + turn, start + 1) - np.maximum(low + turn, start), 0, 1)
        for turn in turns
    )


def stretch_of_cells(
    relaxed: Float[np.ndarray, "node_y node_x 3"],
    nodes: Float[np.ndarray, "node_y node_x 3"],
    axis: int,
) -> Float[np.ndarray, "cell_y cell_x"]:
    """Change of the mean length of two opposite sides of every grid cell, over the relaxed one [1].

    Args:
        relaxed: nodes of the relaxed fabric [mm].
        nodes: nodes of the stretched fabric [mm].
        axis: along the courses if 1, along the wales if 0.
    """
    return _sides(nodes, axis) / _sides(relaxed, axis) - 1


def _sides(
    nodes: Float[np.ndarray, "node_y node_x 3"], axis: int
) -> Float[np.ndarray, "cell_y cell_x"]:
    length = np.linalg.norm(np.diff(nodes, axis=axis), axis=-1)
    one, other = np.delete(length, -1, 1 - axis), np.delete(length, 0, 1 - axis)
    return (one + other) / 2


def unit_cell_strain(
    case: "Case", case_file: xr.Dataset, name: str
) -> Float[np.ndarray, "strain cell_y cell_x"]:
    """A strain of unit cells, as the case file has it, on the grid cells of each [1]."""
    rows, columns = (np.diff(lines) for lines in (case.cell_grid.rows, case.cell_grid.columns))
    values = case_file[name].transpose("applied_strain", "cell_y", "cell_x").values
    return values.repeat(rows, axis=1).repeat(columns, axis=2)


def fold_angle_at_nodes(
    case: "Case", case_file: xr.Dataset
) -> Float[np.ndarray, "strain node_y node_x"]:
    """Signed fold angle of the fold lines at every node, positive for a mountain [rad].

    The mean over the edges of fold lines that meet at a node; 0 where none does.

    Args:
        case: the case.
        case_file: its contents, at strains that were reached.
    """
    from knitlab.cube.case_file import configurations
    from knitlab.measure.folds import fold_angles

    layout, states = case.layout, configurations(case_file)
    net, shape = layout.net, layout.net.shape
    fabric = layout.fabric(case.stripe_pair)
    # State by state, one compiled program serves any number of them.
    angles = np.stack(
        [fold_angles(net, fabric, states[k]) for k in range(case_file.sizes["applied_strain"])]
    )
    total = np.zeros((len(angles), shape.nodes_y, shape.nodes_x))
    edges = np.zeros((shape.nodes_y, shape.nodes_x))
    folded = layout.fold_sense != 0
    for wale, (up, right) in ((True, (1, 0)), (False, (0, 1))):
        # A hinge turns about the left or the lower side of its cell.
        kind = np.flatnonzero(folded & (net.wale == wale))
        row, column = net.hinge_cells[kind].T
        for end in (0, 1):
            # No two hinges of a kind begin, or end, at one node.
            at = (row + end * up) % shape.nodes_y, (column + end * right) % shape.nodes_x
            total[:, *at] += angles[:, kind]
            edges[at] += 1
    return total / np.maximum(edges, 1)
