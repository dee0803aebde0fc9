"""Panels: electrodes of the flat chart, divided and mapped onto the deformed fabric."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Array, Float, Int

from knitlab.fabric.configuration import Configuration
from knitlab.fabric.electrodes import Electrodes, Strip, split_by_cells
from knitlab.fabric.network import MeshShape
from knitlab.measure.grid_nodes import nodes_at


@dataclass(frozen=True, eq=False)
class PanelChart:
    """Panels on the flat chart; none crosses the border of a grid cell.

    Attributes:
        cell: grid cell (y, x) of each panel, which may lie beyond a periodic boundary.
        corners: corners of each panel in order around it: (x, y) within its cell, from 0 to 1.
        electrode: number of the electrode that each panel belongs to.
    """

    cell: Int[np.ndarray, "panel 2"]
    corners: Float[np.ndarray, "panel 4 2"]
    electrode: Int[np.ndarray, " panel"]

    @property
    def membership(self) -> Float[np.ndarray, "panel electrode"]:
        """1 if a panel belongs to an electrode, else 0."""
        return np.eye(self.electrode.max() + 1)[self.electrode]


def panel_chart(electrodes: Electrodes, shape: MeshShape, level: int) -> PanelChart:
    """Divide electrodes into panels, narrower towards their edges, where charge concentrates.

    Along each direction a grid cell is divided into ``level`` panels, twice as many if the
    electrode ends at one side of it, and four times as many if it ends at both.

    Args:
        electrodes: the plated cells.
        shape: mesh of the fabric, which determines where periodic electrodes continue.
        level: level of refinement.
    """
    cells: list[tuple[int, int]] = []
    corners: list[list[tuple[float, float]]] = []
    electrode: list[int] = []
    for number, strips in enumerate(electrodes.strips):
        plated = [part for strip in strips for part in split_by_cells(strip)]
        sides = _Sides(plated, electrodes.axis, shape)
        for part in plated:
            origin = int(np.floor(part.left)), int(np.floor(part.bottom))
            x, y = (
                low - origin[axis] + (high - low) * graded(level, *sides.free(part, axis))
                for axis, (low, high) in enumerate(part.extents)
            )
            for left, right in pairwise(x):
                for bottom, top in pairwise(y):
                    cells.append(origin[::-1])
                    corners.append([(left, bottom), (right, bottom), (right, top), (left, top)])
                    electrode.append(number)
    return PanelChart(np.array(cells), np.array(corners), np.array(electrode))


def graded(level: int, low_free: bool, high_free: bool) -> Float[np.ndarray, " line"]:
    """Lines from 0 to 1 that divide a cell into panels, denser where charge concentrates.

    If the electrode ends at one side of a cell, the other side is usually the ridge of a fold: also
    an outer edge, with lines as dense.
    """
    count = level * 2 ** (low_free + high_free)
    lines = np.linspace(0, 1, count + 1)
    return (1 - np.cos(np.pi * lines)) / 2 if low_free or high_free else lines


def panels_on(
    chart: PanelChart,
    shape: MeshShape,
    configuration: Configuration,
) -> Float[Array | np.ndarray, "*state panel 4 3"]:
    """Corners of the panels on a deformed fabric, bilinear between the nodes of each cell [mm].

    Args:
        chart: the panels.
        shape: mesh of the configuration.
        configuration: configuration of one state or several.
    """
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
    """Points of the flat chart on a deformed fabric, bilinear between nodes [mm].

    Args:
        places: coordinates (x, y) of the points on the chart [grid cells].
        cells: grid cell (y, x) of each point, which is ambiguous on a border.
        shape: mesh of the configuration.
        configuration: configuration of one state or several.
    """
    first, last = cells.min(axis=0), cells.max(axis=0)
    rows, columns = (np.arange(low, high + 2) for low, high in zip(first, last, strict=True))
    nodes = nodes_at(shape, configuration, rows, columns)
    row, column = (cells - first).T
    u, v = (places - cells[:, ::-1]).T[..., None]
    low = (1 - u) * nodes[..., row, column, :] + u * nodes[..., row, column + 1, :]
    top = (1 - u) * nodes[..., row + 1, column, :] + u * nodes[..., row + 1, column + 1, :]
    return (1 - v) * low + v * top


class _Sides:
    """Sides at which the parts of one electrode meet."""

    def __init__(self, plated: list[Strip], wrapped_axis: int, shape: MeshShape) -> None:
        self.wrapped_axis = wrapped_axis
        self.around = (shape.cells_x, shape.cells_y)[wrapped_axis] if shape.periodic else None
        self.begin = {self._side(part, axis, 0) for part in plated for axis in (0, 1)}
        self.end = {self._side(part, axis, 1) for part in plated for axis in (0, 1)}

    def free(self, part: Strip, axis: int) -> tuple[bool, bool]:
        """Whether the electrode ends at the lower and at the upper side of a part."""
        return (
            self._side(part, axis, 0) not in self.end,
            self._side(part, axis, 1) not in self.begin,
        )

    def _side(self, part: Strip, axis: int, end: int) -> tuple[int, float, float, float]:
        position = part.extents[axis][end]
        low, high = part.extents[1 - axis]
        if self.around is not None and axis == self.wrapped_axis:
            position %= self.around
        return axis, round(position, 9), round(low, 9), round(high, 9)
