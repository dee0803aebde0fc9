"""A stitch chart: the stitches of a fabric, and the patches that they make. Needs no JAX."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
import pandas as pd
from jaxtyping import Bool, Int

if TYPE_CHECKING:
    from knitlab.model.stitches import Gauge

Face = Literal["front", "back"]  # a face of the fabric


def electrode_name(number: int) -> str:
    """Name of an electrode by its number in a chart, from 1."""
    return "AB"[number - 1]


def stitch_in_words(front: bool, electrode: int, face: Face) -> str:
    """A stitch of the front or back bed, and the face that its electrode, if any, lies on."""
    knit = f"a {'front' if front else 'back'} knit"
    if not electrode:
        return knit
    return f"{knit} of electrode {electrode_name(electrode)}, conductor on the {face}"


@dataclass(frozen=True, eq=False)
class StitchChart:
    """The stitches of a fabric, course 0 knitted first and wale 0 leftmost, seen from the front."""

    title: str  # the design in words
    front: Bool[np.ndarray, "course wale"]  # a stitch of the back bed shows its reverse, a purl
    plated: Int[np.ndarray, "course wale"]  # number of the electrode: 1 A, 2 B, 0 none
    plated_face: tuple[Face, Face]  # of the fabric, that the conductor of each lies on
    knit: np.ndarray  # of every patch, lowest row first: rib, garter, plain or panel (of folds)
    row_borders: Int[np.ndarray, " border_y"]  # courses at which patches begin and end
    column_borders: Int[np.ndarray, " border_x"]  # wales at which they do
    repeat: tuple[int, int]  # courses and wales of the pattern that repeats
    periodic: bool  # whether the model has no edges: the chart is a part of the fabric
    # Of a shaped piece: the first wale of every course, and the one after its last; consecutive
    # courses share a wale. None: all courses have all wales.
    spans: Int[np.ndarray, "course 2"] | None = None

    def __repr__(self) -> str:
        return f"<StitchChart {self.size}>"

    @property
    def size(self) -> str:
        """The design and its size in words."""
        return f"{self.title}: {self.courses} courses, {self.wales} wales"

    @property
    def courses(self) -> int:
        """Number of courses."""
        return int(self.front.shape[0])

    @property
    def wales(self) -> int:
        """Number of wales, and of the needles that it takes."""
        return int(self.front.shape[1])

    @property
    def edges(self) -> Int[np.ndarray, "course 2"]:
        """The first wale of every course, and the one after its last."""
        return np.tile([0, self.wales], (self.courses, 1)) if self.spans is None else self.spans

    @property
    def present(self) -> Bool[np.ndarray, "course wale"]:
        """Whether a course has a stitch in a wale."""
        starts, stops = self.edges.T[..., None]
        wales = np.arange(self.wales)
        return (wales >= starts) & (wales < stops)

    @property
    def repeats(self) -> tuple[int, int]:
        """How often the pattern repeats along (y, x)."""
        return self.courses // self.repeat[0], self.wales // self.repeat[1]

    @property
    def repeats_in_words(self) -> str:
        """How often which pattern repeats."""
        size = "{} courses and {} wales".format(*self.repeat)
        return "{} × {} (warp × weft) of {}".format(*self.repeats, size)

    @property
    def is_whole_sample(self) -> bool:
        """Whether it is a whole sample with edges, without repeats."""
        return self.repeats == (1, 1) and not self.periodic

    @property
    def electrodes(self) -> list[int]:
        """Numbers of the electrodes that it has."""
        return np.unique(self.plated[(self.plated > 0) & self.present]).tolist()

    @property
    def transfers(self) -> int:
        """Stitches that change the bed between two of its courses."""
        both = self.present[1:] & self.present[:-1]
        return int((both & (self.front[1:] != self.front[:-1])).sum())

    @property
    def stitches(self) -> np.ndarray:
        """Every stitch in words, (course, wale); empty where there is none."""
        faces = np.array(["front", *self.plated_face])[self.plated]
        words = np.vectorize(stitch_in_words)(self.front, self.plated, faces)
        return np.where(self.present, words, "")

    def flat_size(self, gauge: "Gauge") -> tuple[float, float]:
        """Width and length in cloth before it folds, by the size of a stitch [mm].

        Of a shaped piece, those of the rectangle around it.
        """
        return self.wales * gauge.stitch_width, self.courses * gauge.stitch_height

    def difference(self, knitted: np.ndarray) -> str | None:
        """The first stitch in words that differs from a knitted one; None if all are equal."""
        stitches = self.stitches
        for course, wale in np.argwhere(stitches != knitted).tolist():
            here = stitches[course, wale]
            return f"course {course + 1}, wale {wale + 1} is {knitted[course, wale]}, not {here}"
        return None

    def table(self, marks: Iterable[tuple[int, int, str]] = ()) -> str:
        """The chart as comma-separated knits (k) and purls (p), the last course first.

        ``marks`` are added to the letters of stitches, each at its course and wale from 0.
        """
        letters = np.where(self.front, "k", "p").astype(object)
        for number in self.electrodes:
            letters[self.plated == number] += electrode_name(number)
        letters[~self.present] = ""
        for course, wale, mark in marks:
            letters[course, wale] += mark
        rows = pd.DataFrame(letters, range(1, self.courses + 1), range(1, self.wales + 1))
        return rows[::-1].to_csv(index_label="course", lineterminator="\n")
