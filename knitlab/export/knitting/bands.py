"""Bands of a stitch chart: rows of patches in courses, or columns in wales, by their stripes."""

from itertools import groupby
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Bool

from knitlab.model.stripe import GARTER_STITCHES_PER_RIB_STITCH

Axis = Literal["course", "wale"]


class Band(NamedTuple):
    """A row or a column of patches: from a course or wale to the next band's."""

    axis: Axis
    start: int
    stop: int
    stripe: int | None  # courses of its garter stripes or wales of its ribs, None without stripes

    @property
    def size(self) -> int:
        """Number of courses or wales."""
        return self.stop - self.start

    @property
    def per_stitch(self) -> int:
        """Courses or wales that are as long as a stitch is wide."""
        return 1 if self.axis == "wale" else GARTER_STITCHES_PER_RIB_STITCH


def bands_of(
    lines: Bool[np.ndarray, "line stitch"], axis: Axis, tolerance: int, slender: int
) -> list[Band]:
    """Courses in rows of patches, or wales in columns, whose stripes begin on the front bed."""
    kinds, examples = _kinds(lines, tolerance)
    # Runs of lines that are alike, by their kind and number of lines.
    runs = [(kind, len(list(of))) for kind, of in groupby(kinds)]
    bands, k, start = list[Band](), 0, 0
    while k < len(runs):
        (kind, first), (other, size) = runs[k], (*runs, (-1, 0))[k + 1]
        k += 1
        if size > first or not _are_stripes(examples, kind, other, axis, slender * size):
            size = 0
        if first > size:
            bands.append(Band(axis, start, start + first - size, None))
        start += first
        if size:
            stop, k = start + size, k + 1
            while runs[k : k + 2] == [(kind, size), (other, size)]:
                stop, k = stop + 2 * size, k + 2
            bands.append(Band(axis, start - size, stop, size))
            start = stop
    return bands


def _kinds(
    lines: Bool[np.ndarray, "line stitch"], tolerance: int
) -> tuple[list[int], list[Bool[np.ndarray, " stitch"]]]:
    """The kind of every line, and an example of each; lines may differ in a few stitches."""
    if not tolerance:
        _, firsts, exact = np.unique(lines, axis=0, return_index=True, return_inverse=True)
        return exact.ravel().tolist(), list(lines[firsts])
    examples, kinds = list[np.ndarray](), []
    for line in lines:
        alike = (k for k, each in enumerate(examples) if (each != line).sum() <= tolerance)
        kind = next(alike, len(examples))
        if kind == len(examples):
            examples.append(line)
        kinds.append(kind)
    usual = [np.mean(lines[np.array(kinds) == k], axis=0) >= 0.5 for k in range(len(examples))]
    return kinds, usual


def _are_stripes(
    examples: list[Bool[np.ndarray, " stitch"]], first: int, second: int, axis: Axis, least: int
) -> bool:
    """Whether two kinds of lines are front and back stripes, as long as some lines are high."""
    if second < 0 or (examples[second] & ~examples[first]).any():
        return False
    differ = examples[first] & ~examples[second]
    lengths = [len(list(of)) for changes, of in groupby(differ.tolist()) if changes]
    # 2 courses are a wale high.
    scale = GARTER_STITCHES_PER_RIB_STITCH ** (1 if axis == "course" else -1)
    return bool(differ.all()) or least <= scale * min(lengths, default=0)
