"""Calibrated stripes: the four fitted parameters of one n × n rib or garter fabric."""

import math
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import PositiveFloat

from knitlab.fabric.setting_types import RestAngle, Unit
from knitlab.fabric.spring_curve import SpringCurve

Knit = Literal["rib", "garter"]
SpringKind = Literal["linear", "stiffening"] | SpringCurve
"""The kind of a spring law, without its parameters. Springs of one kind are computed together."""

SPRING_LAWS = ("stiffening_strain", "spring_curve")
"""The fields of a stripe that define the law of its springs; linear springs have neither."""
GARTER_STITCHES_PER_RIB_STITCH = 2
"""A stitch is about twice as wide as it is high, so an n × n rib pairs with a 2n × 2n garter
(paper, Sec. "Relaxation of a pattern of rib and garter patches")."""


@dataclass(frozen=True)
class Stripe:
    """Parameters of an ``n`` × ``n`` stripe fabric (paper, Tables 1 and 2).

    Attributes:
        knit: ``"rib"`` (ridges along the wales) or ``"garter"`` (ridges along the courses).
        n: stitches across one stripe.
        period: measured peak-to-peak distance of the relaxed corrugation, w^weft or h^warp [mm].
        k_s: stiffness of the extensional springs across the ridges [N/mm].
        theta_0: interior rest angle of a fold; π is flat [rad].
        k_t: stiffness of the torsional springs, as tabulated [N].
        stiffening_strain: strain of a spring at which its force is twice that of a linear one;
            None for another law [1].
        spring_curve: table of a measured curve of the springs, instead of a stiffening strain.
            With neither, springs are linear, as in the paper.
    """

    knit: Knit
    n: int
    period: Annotated[PositiveFloat, Unit("mm")]
    k_s: Annotated[PositiveFloat, Unit("N/mm")]
    theta_0: RestAngle
    k_t: Annotated[PositiveFloat, Unit("N")]
    stiffening_strain: PositiveFloat | None = None
    spring_curve: SpringCurve | None = None

    def __post_init__(self) -> None:
        """Refuse a stripe with two laws."""
        if self.stiffening_strain is not None and self.spring_curve is not None:
            raise ValueError(
                f"{self.knit} {self.n} has both stiffening_strain and spring_curve; give one"
            )

    @property
    def spring_kind(self) -> SpringKind:
        """The kind of its springs' law."""
        if self.spring_curve is not None:
            return self.spring_curve
        return "linear" if self.stiffening_strain is None else "stiffening"

    @property
    def fold(self) -> float:
        """Magnitude of the rest fold angle, π − θ0 [rad]."""
        return math.pi - self.theta_0

    @property
    def contraction(self) -> float:
        """Relaxed over flat length of the pure stripe, sin(θ0/2); exact, with zero energy."""
        return math.sin(self.theta_0 / 2)


def periods_per_patch(n_stripe: int, n_subunit: int) -> int:
    """Periods (one front and one back stripe) across a patch, P = n_subunit / (2 n_stripe).

    Raises:
        ValueError: if ``n_subunit`` is not a positive multiple of ``2 * n_stripe``.
    """
    periods, rest = divmod(n_subunit, 2 * n_stripe)
    if rest or periods < 1:
        raise ValueError(
            f"n_subunit = {n_subunit} is not a positive multiple of 2 × n_stripe = {2 * n_stripe};"
            f" choose {2 * n_stripe}, {4 * n_stripe}, {6 * n_stripe}, …"
        )
    return periods
