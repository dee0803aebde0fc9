"""Bands of a stitch chart: rows of patches in courses, or columns in wales, by their stripes."""

from itertools import groupby
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool

from knitlab.fabric.stripe import GARTER_STITCHES_PER_RIB_STITCH

PER_RIB_STITCH = {"course": GARTER_STITCHES_PER_RIB_STITCH, "wale": 1}


class Band(NamedTuple):
    """A row or a column of patches: from a course or wale to the next band's."""

    start: int
    stop: int
    stripe: int | None  # courses of its garter stripes or wales of its ribs, None without stripes

    @property
    def size(self) -> int:
        """Number of courses or wales."""
        return self.stop - self.start


def bands_of(
    lines: Bool[np.ndarray, "line stitch"], axis: str, tolerance: int, slender: int
) -> list[Band]:
    """Courses in rows of patches, or wales in columns, whose stripes begin on the front bed."""
    kinds, examples = _kinds(lines, tolerance)
    runs = []  # of lines that are alike: their kind, and from where to where
    for kind, of in groupby(range(len(lines)), key=kinds.__getitem__):
        numbers = list(of)
        runs.append((kind, numbers[0], numbers[-1] + 1))
    bands, k = [], 0
    while k < len(runs):
        kind, start, stop = runs[k]
        if k + 1 == len(runs) or not _are_stripes(runs[k], runs[k + 1], examples, axis, slender):
            bands.append(Band(start, stop, None))
            k += 1
            continue
        other, _, end = runs[k + 1]
        size = end - stop
        begin = stop - size
        if begin > start:
            bands.append(Band(start, begin, None))
        k += 2
        while [(of, b - a) for of, a, b in runs[k : k + 2]] == [(kind, size), (other, size)]:
            end = runs[k + 1][2]
            k += 2
        bands.append(Band(begin, end, size))
    return bands


def _kinds(
    lines: Bool[np.ndarray, "line stitch"], tolerance: int
) -> tuple[list[int], list[Bool[np.ndarray, " stitch"]]]:
    """The kind of every line, and an example of each; lines may differ in a few stitches."""
    if not tolerance:
        _, firsts, exact = np.unique(lines, axis=0, return_index=True, return_inverse=True)
        return exact.ravel().tolist(), list(lines[firsts])
    examples: list[np.ndarray] = []
    kinds = []
    for line in lines:
        alike = (k for k, each in enumerate(examples) if (each != line).sum() <= tolerance)
        kind = next(alike, len(examples))
        if kind == len(examples):
            examples.append(line)
        kinds.append(kind)
    usual = [np.mean(lines[np.array(kinds) == k], axis=0) >= 0.5 for k in range(len(examples))]
    return kinds, usual


def _are_stripes(
    first: tuple[int, int, int],
    second: tuple[int, int, int],
    examples: list[Bool[np.ndarray, " stitch"]],
    axis: str,
    slender: int,
) -> bool:
    """Whether two runs of lines are a front and a back stripe, not shorter than they are wide."""
    front, back = examples[first[0]], examples[second[0]]
    size = second[2] - second[1]
    differ = front & ~back
    if (back & ~front).any() or first[2] - first[1] < size:
        return False
    if differ.all():
        return True
    lengths = [len(list(of)) for changes, of in groupby(differ.tolist()) if changes]
    across = GARTER_STITCHES_PER_RIB_STITCH / PER_RIB_STITCH[axis]  # 2 courses are a wale high
    return slender * size / PER_RIB_STITCH[axis] <= min(lengths, default=0) / across
