"""Electrodes: conductors plated on a fabric, as rectangles of its flat chart.

The chart counts grid cells: x along the weft from the left edge, y along the warp from the bottom.
"""

from dataclasses import dataclass
from itertools import combinations, pairwise
from typing import Literal

import numpy as np

from knitlab.fabric.network import MeshShape

Along = Literal["wale", "course"]
"""Direction of electrodes: along a wale, up the warp, or along a course, in the weft."""
NAMES = ("A", "B")


@dataclass(frozen=True)
class Strip:
    """A plated rectangle of the chart [grid cells].

    Attributes:
        left, right: its extent along the weft.
        bottom, top: its extent along the warp.
    """

    left: float
    right: float
    bottom: float
    top: float

    def __str__(self) -> str:
        """Its place in words."""
        return (
            f"columns {self.left:g} to {self.right:g}, rows {self.bottom:g} to {self.top:g}"
            " (grid cells)"
        )

    @property
    def extents(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Start and end along x, and along y."""
        return (self.left, self.right), (self.bottom, self.top)

    def shared(self, other: "Strip") -> "Strip | None":
        """The intersection with another strip, possibly an edge or a corner; ``None`` if empty."""
        common = Strip(
            max(self.left, other.left),
            min(self.right, other.right),
            max(self.bottom, other.bottom),
            min(self.top, other.top),
        )
        return common if common.left <= common.right and common.bottom <= common.top else None

    @property
    def area(self) -> float:
        """Its area [grid cells]."""
        return (self.right - self.left) * (self.top - self.bottom)


@dataclass(frozen=True)
class Electrodes:
    """The two conductors of a capacitor.

    Attributes:
        strips: the plated rectangles of each; strips of one electrode share whole edges or nothing.
        along: direction of the electrodes. On periodic fabric they are periodic in this direction,
            and have no images in the other.
    """

    strips: tuple[tuple[Strip, ...], tuple[Strip, ...]]
    along: Along

    @property
    def axis(self) -> int:
        """The axis of the electrodes, 0 for x and 1 for y."""
        return 0 if self.along == "course" else 1

    def faults(self, shape: MeshShape) -> list[str]:
        """All faults of the electrodes on a mesh, each with its place."""
        found = []
        for name, strips in zip(NAMES, self.strips, strict=True):
            found += [
                f"electrode {name} extends beyond the fabric: {strip} of"
                f" {shape.cells_x} × {shape.cells_y}"
                for strip in strips
                if self._leaves(strip, shape)
            ]
            found += [
                f"electrode {name} overlaps itself: {common}"
                for one, other in combinations(strips, 2)
                for image in self._images(other, shape)
                if (common := one.shared(image)) and common.area > 0
            ]
        found += [
            f"the electrodes touch, a short circuit: {common}"
            for one in self.strips[0]
            for other in self.strips[1]
            for image in self._images(other, shape)
            if (common := one.shared(image))
        ]
        return found

    def _images(self, strip: Strip, shape: MeshShape) -> list[Strip]:
        """A strip and, on periodic fabric, its images before and after it along the electrodes."""
        if not shape.periodic:
            return [strip]
        x, y = (shape.cells_x, 0) if self.axis == 0 else (0, shape.cells_y)
        return [
            Strip(
                strip.left + turn * x,
                strip.right + turn * x,
                strip.bottom + turn * y,
                strip.top + turn * y,
            )
            for turn in (-1, 0, 1)
        ]

    def _leaves(self, strip: Strip, shape: MeshShape) -> bool:
        for axis, (extent, cells) in enumerate(
            zip(strip.extents, (shape.cells_x, shape.cells_y), strict=True)
        ):
            within = extent[0] >= 0 and extent[1] <= cells
            around = extent[1] - extent[0] < cells
            if not (within or (shape.periodic and axis != self.axis and around)):
                return True
        return False


def split_by_cells(strip: Strip) -> list[Strip]:
    """Parts of a strip, one for each grid cell that it covers."""
    x, y = (
        [low, *np.arange(np.floor(low) + 1, np.ceil(high)).tolist(), high]
        for low, high in strip.extents
    )
    return [
        Strip(left, right, bottom, top)
        for left, right in pairwise(x)
        for bottom, top in pairwise(y)
    ]
