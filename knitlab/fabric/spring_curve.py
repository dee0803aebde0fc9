"""A measured spring curve: the shape of a spring's force against its strain, from a table."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator, PPoly


@dataclass(frozen=True)
class SpringCurve:
    """Force against strain of a spring, as a table.

    Only its shape matters: it is scaled to slope 1 at rest, so that k_s is still the stiffness at
    small strain. A table that starts at rest is continued into compression as an odd function.

    Attributes:
        strain: of the spring, increasing, above −1 and including 0 [1].
        force: at each strain, increasing, 0 at rest, in any unit.

    Raises:
        ValueError: if the table is invalid; it lists every fault.

    Example:
        >>> curve = SpringCurve((0.0, 0.1, 0.2), (0.0, 1.0, 3.0))
        >>> spline = curve.spline
        >>> round(float(spline(0.1)), 12), round(float(spline(0.2)), 12)
        (0.1, 0.3)
    """

    strain: tuple[float, ...]
    force: tuple[float, ...]

    def __repr__(self) -> str:
        return f"<SpringCurve: {len(self.strain)} points>"

    def __post_init__(self) -> None:
        """Refuse an invalid table."""
        if problems := _problems(np.asarray(self.strain, float), np.asarray(self.force, float)):
            raise ValueError("; ".join(problems))

    @property
    def spline(self) -> PPoly:
        """Force over k_s times rest length, as a function of strain [1].

        The monotone cubic of Fritsch and Butland (:class:`scipy.interpolate.PchipInterpolator`)
        has continuous first derivatives, so that the energy is smooth to second order. The end
        slopes are those of the last chords, and beyond the table the force is linear.
        """
        return _spline(self)


def _problems(strain: Float[np.ndarray, " point"], force: Float[np.ndarray, " knot"]) -> list[str]:
    if len(strain) != len(force) or len(strain) < 2:
        return [
            f"it has {len(strain)} strains and {len(force)} forces; give the same number of"
            " both, at least two"
        ]
    if not (np.isfinite(strain).all() and np.isfinite(force).all()):
        return ["it has numbers that are not finite; remove them"]
    problems = []
    for name, values in (("strain", strain), ("force", force)):
        falls = np.flatnonzero(np.diff(values) <= 0)
        if len(falls):
            step = falls[0]
            problems.append(
                f"its {name} does not increase from {values[step]:g} to {values[step + 1]:g} at"
                f" point {step + 2}; give increasing values"
            )
    if strain[0] <= -1:
        problems.append(f"its strain begins at {strain[0]:g}; give strains above -1")
    rest = np.flatnonzero(strain == 0)
    if not len(rest) or force[rest[0]] != 0:
        problems.append("it does not contain zero strain and zero force; give the point 0, 0")
    elif rest[0] == len(strain) - 1:
        problems.append("it ends at rest; give points in tension")
    return problems


@lru_cache(maxsize=64)
def _spline(curve: SpringCurve) -> PPoly:
    strain, force = np.array(curve.strain), np.array(curve.force)
    if strain[0] == 0:
        strain = np.concatenate([-strain[:0:-1], strain])
        force = np.concatenate([-force[:0:-1], force])
    chords = np.diff(force) / np.diff(strain)
    slopes = PchipInterpolator(strain, force).derivative()(strain)
    slopes[0], slopes[-1] = chords[0], chords[-1]
    at_rest = slopes[strain == 0]
    ends = np.array([-1.0, 1.0])
    # Two added points with the end slope continue the curve as a line.
    beyond = force[[0, -1]] + ends * slopes[[0, -1]]
    return CubicHermiteSpline(
        np.array([strain[0] - 1, *strain, strain[-1] + 1]),
        np.array([beyond[0], *force, beyond[1]]) / at_rest,
        np.array([slopes[0], *slopes, slopes[-1]]) / at_rest,
    )
