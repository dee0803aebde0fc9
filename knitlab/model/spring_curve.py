"""A measured curve of a spring: its force as a function of its strain."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

if TYPE_CHECKING:
    from scipy.interpolate import PPoly


@dataclass(frozen=True)
class SpringCurve:
    """A measured curve: force against strain of a spring, as a table.

    Only its shape matters: it is scaled to slope 1 at rest, so that k_s is still the stiffness at
    small strain. A table that starts at rest is continued into compression as an odd function.

    Attributes:
        strain: of the spring, increasing, above −1 and including 0 [1].
        force: at each strain, increasing, 0 at rest, in any unit.

    Raises:
        ValueError: if the table is invalid; it lists every mistake.

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
        if messages := _problems(np.asarray(self.strain, float), np.asarray(self.force, float)):
            raise ValueError("; ".join(messages))

    @cached_property
    def spline(self) -> "PPoly":
        """Force over k_s times rest length, as a function of strain [1].

        A monotone cubic with end slopes of the last chords, linear beyond the table.
        """
        from scipy.interpolate import CubicHermiteSpline, PchipInterpolator  # slow to import

        strain = np.array(self.strain)
        force = np.array(self.force)
        if strain[0] == 0:
            strain = np.concatenate([-strain[:0:-1], strain])
            force = np.concatenate([-force[:0:-1], force])
        chords = np.diff(force) / np.diff(strain)
        slopes = PchipInterpolator(strain, force).derivative()(strain)
        slopes[0] = chords[0]
        slopes[-1] = chords[-1]
        at_rest = slopes[strain == 0]
        # Two added points with the end slope continue the curve as a line.
        beyond = force[[0, -1]] + np.array([-1.0, 1.0]) * slopes[[0, -1]]
        return CubicHermiteSpline(
            np.array([strain[0] - 1, *strain, strain[-1] + 1]),
            np.array([beyond[0], *force, beyond[1]]) / at_rest,
            np.array([slopes[0], *slopes, slopes[-1]]) / at_rest,
        )


def _problems(strain: Float[np.ndarray, " point"], force: Float[np.ndarray, " knot"]) -> list[str]:
    if len(strain) != len(force) or len(strain) < 2:
        return [
            f"it has {len(strain)} strains and {len(force)} forces; give the same number of"
            " both, at least two"
        ]
    if not (np.isfinite(strain).all() and np.isfinite(force).all()):
        return ["it has numbers that are not finite; remove them"]
    messages = []
    for name, values in (("strain", strain), ("force", force)):
        falls = np.flatnonzero(np.diff(values) <= 0)
        if len(falls):
            step = falls[0]
            messages.append(
                f"its {name} does not increase from {values[step]:g} to {values[step + 1]:g} at"
                f" point {step + 2}; give increasing values"
            )
    if strain[0] <= -1:
        messages.append(f"its strain begins at {strain[0]:g}; give strains above -1")
    rest = np.flatnonzero(strain == 0)
    if not len(rest) or force[rest[0]] != 0:
        messages.append("it does not contain zero strain and zero force; give the point 0, 0")
    elif rest[0] == len(strain) - 1:
        messages.append("it ends at rest; give points in tension")
    return messages
