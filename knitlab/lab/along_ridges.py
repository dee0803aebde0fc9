"""Springs along the ridges of a stripe, by the measured force of a sheet along them."""

from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.interpolate import PchipInterpolator

from knitlab.lab.tension_record import TensionRecord
from knitlab.model.pure_stripe import PureStripe, tension_along
from knitlab.model.spring_curve import SpringCurve
from knitlab.model.spring_law import CurveLaw

KNOTS = 12  # of the curve of the springs
SWEEPS = 60  # in which the curve settles
SHORTENED = 20  # steps of Newton's method in each, for lengths across the ridges
MIN_SLOPE = 1e-3  # of the curve between knots, over its mean slope
MIN_POINTS = 4  # of a record
TABULATED = np.linspace(-0.6, 1.5, 211)  # strains of diagonals

Points = Float[np.ndarray, " point"]


@dataclass(frozen=True)
class AlongRidges:
    """Springs along the ridges, and forces over width [N/mm], or on one column of cells [N]."""

    stretch: float  # force over flat width and strain, diagonals not counted [N/mm]
    curve: SpringCurve
    strain: Points
    force: Points  # as measured
    fitted_force: Points

    @property
    def misfit(self) -> float:
        """Root mean square difference between curve and fit."""
        return float(np.sqrt(np.mean((self.force - self.fitted_force) ** 2)))


def springs_along(sheet: PureStripe, record: TensionRecord) -> AlongRidges:
    """The springs along the ridges that give a sheet its measured force along them, by iteration.

    Diagonals have the law of a cell's softer springs. Forces that do not increase are evened out.
    """
    order = np.argsort(record.strain, kind="stable")
    strain, force = record.strain[order], record.mean_force[order]
    cell, k_s = float(sheet.cell), float(sheet.k_s)
    column = float(np.sin(sheet.theta_0 / 2)) if record.per_width else 1 / cell
    over_flat_width = force * column
    at = np.unique(
        np.concatenate([[0.0], np.quantile(strain[strain > 0], np.arange(1, KNOTS) / (KNOTS - 1))])
    )
    whole = np.interp(at, np.append(0.0, strain), np.append(0.0, over_flat_width))
    height, springs = 1 + at, _increasing(at, whole / 2)
    across = _across(sheet)
    for _ in range(SWEEPS):
        own = PchipInterpolator(at, springs, extrapolate=True)
        # As in the network, the softer springs are those of the smaller stiffness at rest.
        diagonals = across if k_s <= _stretch(at, springs)[0] else own
        diagonal = np.hypot(_lengths(diagonals, k_s, height), height)
        share = 2 * np.sqrt(2) * diagonals(diagonal / np.sqrt(2) - 1) * height / diagonal
        springs = _increasing(at, (springs + whole - share) / 2)
    stretch, curve = _stretch(at, springs)
    found = replace(sheet, stretch_along=jnp.asarray(stretch), law_along=CurveLaw.of(curve))
    fitted = _tension_along(found, strain) / (cell * column)
    return AlongRidges(stretch, curve, strain, force, np.asarray(fitted))


def check_along(strain: Points, force: Points) -> None:
    """ValueError if a curve along the ridges has too few points, or no tension."""
    if len(strain) < MIN_POINTS:
        raise ValueError(f"has {len(strain)} points; give {MIN_POINTS} at least")
    if not (np.isfinite(strain).all() and np.isfinite(force).all()):
        raise ValueError("has numbers that are not finite; remove them")
    if (least := strain.min()) < 0:
        raise ValueError(f"has a strain of {least:g}; give strains from 0 up")
    if not np.sum(strain * force) > 0:
        end = f"is {force[-1]:g} at its end, a strain of {strain[-1]:g}"
        raise ValueError(f"its force {end}, and does not rise; give tension as positive")


def _stretch(strain: Points, force: Points) -> tuple[float, SpringCurve]:
    curve = SpringCurve(tuple(strain.tolist()), tuple(force.tolist()))
    return float(force[-1] / curve.spline(strain[-1])), curve


def _across(sheet: PureStripe) -> PchipInterpolator:
    """Force of the springs across the ridges over flat width, as a function of strain [N/mm]."""
    force = sheet.k_s * sheet.law.pull(1 + TABULATED, np.ones(1))
    return PchipInterpolator(TABULATED, np.asarray(force), extrapolate=True)


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
    least = MIN_SLOPE * force.max() / strain[-1] * strain
    return np.append(0.0, (np.maximum.accumulate(np.maximum(force - least, 0.0)) + least)[1:])


_tension_along = jax.jit(tension_along)
