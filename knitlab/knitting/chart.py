"""A stitch chart: the stitches of a fabric, and the patches that they make. Needs no JAX."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Int

from knitlab.knitting.knit_stitches import KnitStitches

Face = Literal["front", "back"]
"""A face of the fabric."""


@dataclass(frozen=True, eq=False)
class StitchChart:
    """The stitches of a fabric, course 0 knitted first and wale 0 leftmost, seen from the front.

    Attributes:
        title: the design in words.
        front: whether a stitch is knitted on the front bed; one of the back bed shows its reverse,
            a purl.
        plated: number of the electrode that a stitch belongs to, 1 for A and 2 for B; 0 where none.
        plated_face: the face of the fabric that the conductor of each electrode lies on.
        knit: knit of every patch, lowest row first: rib, garter or plain.
        row_borders, column_borders: courses and wales at which patches begin and end.
        repeat: courses and wales of the pattern that repeats.
        periodic: whether the model has no edges, so that the chart is a part of periodic fabric.
    """

    title: str
    front: Bool[np.ndarray, "course wale"]
    plated: Int[np.ndarray, "course wale"]
    plated_face: tuple[Face, Face]
    knit: np.ndarray
    row_borders: Int[np.ndarray, " border_y"]
    column_borders: Int[np.ndarray, " border_x"]
    repeat: tuple[int, int]
    periodic: bool

    def __repr__(self) -> str:
        return f"<StitchChart {self.size}>"

    @property
    def size(self) -> str:
        """The design and its size in words."""
        return f"{self.title}: {self.courses} courses, {self.wales} wales"

    @property
    def courses(self) -> int:
        """Its courses."""
        return int(self.front.shape[0])

    @property
    def wales(self) -> int:
        """Its wales, and the needles that it takes."""
        return int(self.front.shape[1])

    @property
    def repeats(self) -> tuple[int, int]:
        """How often the pattern repeats along (y, x)."""
        return self.courses // self.repeat[0], self.wales // self.repeat[1]

    @property
    def is_whole_sample(self) -> bool:
        """Whether it is a whole sample with edges, of which nothing repeats."""
        return self.repeats == (1, 1) and not self.periodic

    @property
    def electrodes(self) -> tuple[int, ...]:
        """Numbers of the electrodes that it has."""
        return tuple(np.unique(self.plated[self.plated > 0]).tolist())

    @property
    def transfers(self) -> int:
        """Stitches that change the bed between two of its courses."""
        return int((self.front[1:] != self.front[:-1]).sum())

    @property
    def stitches(self) -> KnitStitches:
        """Bed and conductor of every stitch."""
        on_back = np.array([0, *(face == "back" for face in self.plated_face)], bool)
        return KnitStitches(self.front, np.where(on_back[self.plated], -self.plated, self.plated))
