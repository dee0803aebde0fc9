"""Fold lines: which hinges of a patch fold, by which share of a fold, and how stiff they are.

With four grid cells per period, the paper's grid, a fold is one hinge. On a finer grid it is
distributed over the hinges of a rounded ridge of constant curvature, which covers
``ridge_fraction`` of the stripe: each has the share of the fold angle, and of the compliance, that
lies within half a cell of it.
"""

from functools import lru_cache
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from knitlab.model.array_library import array_library
from knitlab.model.pattern import CELLS_PER_PERIOD, PatchGrid
from knitlab.model.settings import FoldPhase, ModelOptions

SENSE_BY_LINE = {
    "stripe_border": np.array([-1.0, 0.0, 1.0, 0.0]),
    "stripe_centre": np.array([0.0, 1.0, 0.0, -1.0]),
}
"""Sense of the fold at a line of the paper's grid, by its position in the period of four cells."""

Like = Bool[np.ndarray, "line cell"]  # which cells are of one knit; axis 1 runs across its folds
ByEdge = Float[np.ndarray, "line cell"]  # at k of axis 1: edge between cells k − 1 and k


class Ridge:
    """Distribution of a fold over the hinges of a fine grid; the ridge is a fraction of a stripe.

    ``refinement`` is the number of grid cells along one cell of the paper's grid, ``fold_shares``
    the share of each hinge up to that many cells from the middle of the ridge.
    """

    def __init__(self, cells_per_period: int, fraction: float) -> None:
        self.refinement = cells_per_period // CELLS_PER_PERIOD
        self.fold_shares = _shares(self.refinement, fraction)
        self._flank_shares = _shares(self.refinement, 1 - fraction)

    def stiffness_by_position(self, fold_phase: FoldPhase) -> Float[np.ndarray, " cell"]:
        """Factor on k_t of a hinge, by its position in the period; all 1 on the paper's grid.

        A hinge with the share s of a fold's compliance is 1/s times as stiff, and its edge is
        shorter.
        """
        shares = np.zeros(CELLS_PER_PERIOD * self.refinement)
        for line, sense in enumerate(SENSE_BY_LINE[fold_phase]):
            around = self.fold_shares if sense else self._flank_shares
            for offset, share in enumerate(around, -self.refinement):
                shares[(line * self.refinement + offset) % len(shares)] += share
        return 1 / (self.refinement * shares)

    def rest_fold(self, theta_0: Any) -> Any:
        """Total fold angle at rest [rad] of a ridge whose sharp fold has the rest angle θ0.

        On a finer grid than the paper's it is chosen so that a pure stripe also relaxes to
        sin(θ0/2) of its flat length, the mean cosine of the tilt of its cells.
        """
        sharp = np.pi - theta_0
        if self.refinement == 1:
            return sharp
        import jax.numpy as jnp  # slow to import
        import optimistix as optx

        middle = self.refinement
        # Tilt of the cells from the middle of the ridge to that of the flank, over the fold angle.
        tilts = self.fold_shares[middle] / 2 + np.concatenate(
            [[0.0], np.cumsum(self.fold_shares[middle + 1 : 2 * middle])]
        )

        def excess(fold: Any, contraction: Any) -> Any:
            return jnp.mean(jnp.cos(fold[..., None] * tilts), axis=-1) - contraction

        solution: optx.Solution = optx.root_find(
            excess,
            optx.Newton(rtol=1e-14, atol=1e-14),
            jnp.asarray(sharp),
            args=jnp.cos(sharp / 2),
            max_steps=50,
            throw=False,
        )
        return array_library(theta_0).asarray(solution.value)


def _shares(refinement: int, fraction: float) -> Float[np.ndarray, " offset"]:
    """Shares of an arc over a fraction of a stripe that lie within half a cell of each line."""
    offsets = np.arange(-refinement, refinement + 1)
    half = fraction * refinement
    if refinement == 1 or half <= 0.5:
        return np.where(offsets == 0, 1.0, 0.0)
    within = np.minimum(offsets + 0.5, half) - np.maximum(offsets - 0.5, -half)
    return np.maximum(within, 0.0) / (2 * half)


PAPER_RIDGE = Ridge(CELLS_PER_PERIOD, 0.5)


@lru_cache(maxsize=16)
def model_ridge(options: ModelOptions) -> Ridge:
    """The ridge that the model options define."""
    return Ridge(options.cells_per_period, options.ridge_fraction)


def inside_runs(like: Like, periodic: bool) -> Bool[np.ndarray, "line cell"]:
    """Whether the edge before each cell lies inside a run of like cells, along axis 1."""
    inside = like & np.roll(like, 1, axis=1)
    if not periodic:
        inside[:, 0] = False
    return inside


def _number_in_run(like: Like, periodic: bool) -> Int[np.ndarray, "line cell"]:
    """Cells of its run that come before each cell, along axis 1; a full ring starts at 0."""
    lines, cells = like.shape
    start = np.where(like.all(axis=1) | (not periodic), 0, np.argmin(like, axis=1))
    order = (start[:, None] + np.arange(cells)) % cells
    unrolled = np.take_along_axis(like, order, axis=1)
    last_other = np.maximum.accumulate(np.where(unrolled, -1, np.arange(cells)), axis=1)
    number = np.empty((lines, cells), int)
    np.put_along_axis(number, order, np.arange(cells) - last_other - 1, axis=1)
    return number


def fold_senses(
    like: Like, fold_phase: FoldPhase, periodic: bool, ridge: Ridge = PAPER_RIDGE
) -> ByEdge:
    """Share of a fold on the edge before each cell: +1 and −1 alternately, 0 if it is flat at rest.

    Lines are counted from the start of each run of like cells; no fold lies on its border.
    """
    inside = inside_runs(like, periodic)
    line, between = np.divmod(_number_in_run(like, periodic), ridge.refinement)
    middles = SENSE_BY_LINE[fold_phase][line % CELLS_PER_PERIOD]
    middles = np.where(inside & (between == 0), middles, 0.0)
    shares = sum(
        share * np.roll(middles, offset, axis=1)
        for offset, share in enumerate(ridge.fold_shares, -ridge.refinement)
        if share
    )
    return np.where(inside, shares, 0.0)


def patch_senses(pattern: PatchGrid, options: ModelOptions) -> tuple[ByEdge, ByEdge]:
    """Shares of the folds of rib, left of grid cells, and of garter, below; > 0 in mountains."""
    periodic = options.boundary == "periodic"
    ridge = model_ridge(options)
    rib, garter = (
        fold_senses(like, options.fold_phase, periodic, ridge)
        for like in (pattern.knit_cells("rib"), pattern.knit_cells("garter").T)
    )
    return rib, (garter if options.garter_start == "mountain" else -garter).T


def fold_stiffness_factors(pattern: PatchGrid, options: ModelOptions) -> tuple[ByEdge, ByEdge]:
    """Factors on k_t of hinges inside rib patches, and inside garter patches; 1 elsewhere."""
    periodic = options.boundary == "periodic"
    by_position = model_ridge(options).stiffness_by_position(options.fold_phase)

    def factors(like: Like) -> ByEdge:
        position = _number_in_run(like, periodic) % len(by_position)
        return np.where(inside_runs(like, periodic), by_position[position], 1.0)

    return factors(pattern.knit_cells("rib")), factors(pattern.knit_cells("garter").T).T
