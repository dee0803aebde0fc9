"""Springs along the ridges of a stripe, by the measured force of a sheet along them."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.interpolate import PchipInterpolator

from knitlab.fabric.pure_stripe import PureStripe, tension_along
from knitlab.fabric.spring_law import CurveLaw, SpringCurve

KNOTS = 12  # of the curve of the springs
SWEEPS = 60  # in which the curve settles
SHORTENED = 20  # steps of Newton's method in each, for lengths across the ridges
LEAST_SLOPE = 1e-3  # of the curve between knots, over its mean slope

Points = Float[np.ndarray, " point"]


@dataclass(frozen=True)
class AlongRidges:
    """Springs along the ridges, and the force of their sheet beside the measured one.

    Forces are over the width of the relaxed sheet [N/mm], or on one column of cells [N].
    """

    stretch: float  # force over flat width and strain, diagonals not counted [N/mm]
    curve: SpringCurve
    strain: Points
    force: Points  # as measured
    fitted_force: Points

    @property
    def misfit(self) -> float:
        """Root mean square difference between curve and fit."""
        return float(np.sqrt(np.mean((self.force - self.fitted_force) ** 2)))


def springs_along(
    sheet: PureStripe, strain: Points, force: Points, *, per_width: bool
) -> AlongRidges:
    """The springs along the ridges that give a sheet its measured force along them.

    They are the softer springs of a cell, so that diagonals have their law and take part of the
    force. The part of the springs is found at some strains by iteration. Measured forces that do
    not increase with strain are evened out, because a spring's force must increase.
    """
    cell, k_s = float(sheet.cell), float(sheet.k_s)
    column = float(np.sin(sheet.theta_0 / 2)) if per_width else 1 / cell
    over_flat_width = force * column
    at = np.unique(
        np.concatenate([[0.0], np.quantile(strain[strain > 0], np.arange(1, KNOTS) / (KNOTS - 1))])
    )
    whole = np.interp(at, np.append(0.0, strain), np.append(0.0, over_flat_width))
    height, springs = 1 + at, _increasing(at, whole / 2)
    for _ in range(SWEEPS):
        pulled = PchipInterpolator(at, springs, extrapolate=True)
        length = _lengths(pulled, k_s, height)
        diagonal = np.hypot(length, height)
        share = 2 * np.sqrt(2) * pulled(diagonal / np.sqrt(2) - 1) * height / diagonal
        springs = _increasing(at, (springs + whole - share) / 2)
    curve = SpringCurve(tuple(at.tolist()), tuple(springs.tolist()))
    stretch = float(springs[-1] / curve.spline(at[-1]))
    own = PureStripe(
        sheet.period,
        sheet.k_s,
        sheet.k_t,
        sheet.theta_0,
        sheet.law,
        jnp.asarray(stretch),
        CurveLaw.of(curve),
    )
    fitted = _tension_along(own, strain) / (cell * column)
    return AlongRidges(stretch, curve, strain, force, np.asarray(fitted))


def _lengths(pulled: PchipInterpolator, k_s: float, height: Points) -> Points:
    """Lengths across the ridges of cells in balance, over that of the flat cell."""
    slope, length = pulled.derivative(), np.ones_like(height)
    for _ in range(SHORTENED):
        diagonal = np.hypot(length, height)
        strain = diagonal / np.sqrt(2) - 1
        pull, steep = 2 * np.sqrt(2) * pulled(strain), 2 * slope(strain)
        left = k_s * (length - 1) + pull * length / diagonal
        rise = k_s + pull * height**2 / diagonal**3 + steep * (length / diagonal) ** 2
        length = length - left / rise
    return length


def _increasing(strain: Points, force: Points) -> Points:
    """Forces from 0 at rest that increase everywhere."""
    least = LEAST_SLOPE * force.max() / strain[-1] * strain
    return np.append(0.0, (np.maximum.accumulate(np.maximum(force - least, 0.0)) + least)[1:])


_tension_along = jax.jit(tension_along)
