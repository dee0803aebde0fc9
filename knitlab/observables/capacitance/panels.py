"""Panels: electrodes of the flat chart, divided and mapped onto the deformed fabric."""

from dataclasses import dataclass
from itertools import pairwise, product

import numpy as np
from jaxtyping import Array, Float, Int

from knitlab.model.cell_grid import nodes_at
from knitlab.model.electrodes import Electrodes, Strip, split_by_cells
from knitlab.model.fabric import Configuration
from knitlab.model.network import MeshShape


@dataclass(frozen=True, eq=False)
class PanelChart:
    """Panels on the flat chart; none crosses the border of a grid cell.

    Grid cells (y, x) may lie beyond a periodic boundary; corners (x, y) are from 0 to 1 in their
    cell.
    """

    cell: Int[np.ndarray, "panel 2"]
    corners: Float[np.ndarray, "panel 4 2"]
    electrode: Int[np.ndarray, " panel"]


def panel_chart(electrodes: Electrodes, shape: MeshShape, level: int) -> PanelChart:
    """Divide electrodes into panels, narrower towards their edges, where charge concentrates.

    A grid cell is divided into ``level`` panels, twice as many along a direction if the electrode
    ends at one side of it, and four times as many if it ends at both.
    """
    wrapped: list[int | None] = [None, None]
    if shape.periodic:
        wrapped[electrodes.axis] = (shape.cells_x, shape.cells_y)[electrodes.axis]
    panels = []
    for number, strips in enumerate(electrodes.strips):
        plated = [part for strip in strips for part in split_by_cells(strip)]
        begin, end = (
            {_side(part, axis, side, wrapped[axis]) for part in plated for axis in (0, 1)}
            for side in (0, 1)
        )
        for part in plated:
            origin = int(np.floor(part.left)), int(np.floor(part.bottom))
            lines = []
            for axis, (low, high) in enumerate(part.extents):
                low_free = _side(part, axis, 0, wrapped[axis]) not in end
                high_free = _side(part, axis, 1, wrapped[axis]) not in begin
                steps = graded(level, low_free, high_free)
                lines.append(low - origin[axis] + (high - low) * steps)
            for (left, right), (bottom, top) in product(*map(pairwise, lines)):
                corners = (left, bottom), (right, bottom), (right, top), (left, top)
                panels.append((origin[::-1], corners, number))
    return PanelChart(*map(np.array, zip(*panels, strict=True)))


def _side(part: Strip, axis: int, end: int, wrapped: int | None) -> tuple[int, float, float, float]:
    """Axis, position and extent of the lower or upper side of a part; equal for two that meet."""
    position = part.extents[axis][end]
    low, high = part.extents[1 - axis]
    if wrapped is not None:
        position %= wrapped
    return axis, round(position, 9), round(low, 9), round(high, 9)


def graded(level: int, low_free: bool, high_free: bool) -> Float[np.ndarray, " line"]:
    """Lines from 0 to 1 that divide a cell into panels, denser where charge concentrates."""
    lines = np.linspace(0, 1, level * 2 ** (low_free + high_free) + 1)
    return (1 - np.cos(np.pi * lines)) / 2 if low_free or high_free else lines


def panels_on(
    chart: PanelChart, shape: MeshShape, configuration: Configuration
) -> Float[Array | np.ndarray, "*state panel 4 3"]:
    """Corners of the panels on a fabric in one state or several, as :func:`points_on` [mm]."""
    places = chart.cell[:, None, ::-1] + chart.corners
    cells = np.repeat(chart.cell, 4, axis=0)
    corners = points_on(places.reshape(-1, 2), cells, shape, configuration)
    return corners.reshape(*corners.shape[:-2], -1, 4, 3)


def points_on(
    places: Float[np.ndarray, "point 2"],
    cells: Int[np.ndarray, "point 2"],
    shape: MeshShape,
    configuration: Configuration,
) -> Float[Array | np.ndarray, "*state point 3"]:
    """Points of the flat chart on a fabric in one state or several, bilinear between nodes [mm].

    Points are given as (x, y) in grid cells, with the cell (y, x) that is ambiguous on a border.
    """
    first = cells.min(axis=0)
    last = cells.max(axis=0)
    rows, columns = (np.arange(low, high + 2) for low, high in zip(first, last, strict=True))
    nodes = nodes_at(shape, configuration, rows, columns)
    row, column = (cells - first).T
    u, v = (places - cells[:, ::-1]).T[..., None]
    low = (1 - u) * nodes[..., row, column, :] + u * nodes[..., row, column + 1, :]
    top = (1 - u) * nodes[..., row + 1, column, :] + u * nodes[..., row + 1, column + 1, :]
    return (1 - v) * low + v * top
