"""Patterns: which patch is rib, which garter, and the folds that follow from it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from knitlab.model.options import FoldPhase

CELLS_PER_PERIOD = 4
"""Grid cells along one period: two a stripe (paper, Fig. 1F: grid of size w/4)."""


@dataclass(frozen=True, eq=False)
class Pattern:
    """A map of rib and garter patches, each ``periods`` periods wide and high.

    Attributes:
        rib: True where a patch is rib, False where it is garter; row 0 is the bottom course.
        periods: P, periods of a stripe that fill a patch.
    """

    rib: Bool[np.ndarray, "patch_y patch_x"]
    periods: int

    @property
    def cells_per_patch(self) -> int:
        """Grid cells along each side of a patch, 4P."""
        return CELLS_PER_PERIOD * self.periods

    @property
    def rib_cells(self) -> Bool[np.ndarray, "grid_y grid_x"]:
        """True for each grid cell that lies in a rib patch."""
        return np.kron(self.rib, np.ones((self.cells_per_patch,) * 2, dtype=bool)).astype(bool)


def patch_map(rows: Sequence[str], periods: int) -> Pattern:
    """Pattern from text, top course first: ``R`` is a rib patch, ``G`` a garter patch.

    Raises:
        ValueError: if the rows differ in length, are empty, or hold another letter.
    """
    widths = {len(row) for row in rows}
    if not rows or len(widths) != 1 or widths == {0}:
        raise ValueError(f"patch map {list(rows)} is not a rectangle; give rows of equal length")
    if unknown := sorted(set("".join(rows).upper()) - set("RG")):
        raise ValueError(f"patch map holds {unknown}; use R for rib and G for garter")
    rib = np.array([[letter in "Rr" for letter in row] for row in rows[::-1]])
    return Pattern(rib, periods)


def inside_runs(
    like: Bool[np.ndarray, "line cell"], periodic: bool
) -> Bool[np.ndarray, "line cell"]:
    """Whether the edge before each cell lies inside a run of like cells, along axis 1."""
    inside = like & np.roll(like, 1, axis=1)
    if not periodic:
        inside[:, 0] = False
    return inside


SENSE_BY_LINE = {
    "stripe_border": np.array([-1.0, 0.0, 1.0, 0.0]),
    "stripe_centre": np.array([0.0, 1.0, 0.0, -1.0]),
}
"""Sense of the fold at a grid line, by its place in the period of four cells."""


def fold_senses(
    like: Bool[np.ndarray, "line cell"], fold_phase: FoldPhase, periodic: bool
) -> Float[np.ndarray, "line cell"]:
    """Sense of the fold on the edge before each cell: +1 and −1 in turn, 0 where it rests flat.

    Lines are counted from the start of each run of like cells, so neighbouring patches of one
    knit fold together and no fold lies on the border between two knits. In periodic fabric
    a run may wrap around; one that fills the whole line is counted from line 0.

    Args:
        like: which cells are of this knit; axis 1 runs across its folds.
        fold_phase: whether the folds lie on the odd or the even lines of a run.
        periodic: whether axis 1 wraps around.

    Returns:
        At index k of axis 1 the sense of the edge between cells k − 1 and k.
    """
    lines, cells = like.shape
    start = np.where(like.all(axis=1), 0, np.argmin(like, axis=1)) if periodic else np.zeros(lines)
    order = (start[:, None].astype(int) + np.arange(cells)) % cells
    unrolled = np.take_along_axis(like, order, axis=1)
    last_other = np.maximum.accumulate(np.where(unrolled, -1, np.arange(cells)), axis=1)
    place = np.empty((lines, cells), dtype=int)
    np.put_along_axis(place, order, np.arange(cells) - last_other - 1, axis=1)
    return np.where(
        inside_runs(like, periodic), SENSE_BY_LINE[fold_phase][place % CELLS_PER_PERIOD], 0.0
    )
