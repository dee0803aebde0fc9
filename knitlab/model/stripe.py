"""Calibrated stripes: the four fitted parameters of one n × n rib or garter fabric."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar

from pydantic import Field, PositiveFloat

from knitlab.io.errors import invalid
from knitlab.model.array_library import array_library
from knitlab.model.checked import Checked
from knitlab.model.settings import CellSize, ModelOptions, PlainKnit, RestAngle, Sheet, Unit
from knitlab.model.spring_curve import SpringCurve

if TYPE_CHECKING:
    from knitlab.model.stripe_numbers import StripeNumbers

Knit = Literal["rib", "garter"]
Table = TypeVar("Table", Sheet, PlainKnit)
SpringKind = Literal["linear", "stiffening"] | SpringCurve
"""The kind of a spring law, without its parameters. Springs of one kind are computed together."""
SpringKinds = tuple[SpringKind, SpringKind]

SPRING_LAWS = ("stiffening_strain", "spring_curve")
"""The fields of a stripe that define the law of its springs; linear springs have neither."""
YARN_FIELDS = ("row_width", "stretch_along", "curve_along")
"""Fields that the paper's stripes do not have."""
STRIPE_QUANTITIES = ("period", "k_s", "k_t", "theta_0")  # order of random changes of copies
STIFFENING = "stiffening_strain"
"""Setting for one knit or both, without factors, because the tables have no value."""
GARTER_STITCHES_PER_RIB_STITCH = 2
"""A stitch is about twice as wide as it is high, so an n × n rib pairs with a 2n × 2n garter
(paper, Sec. "Relaxation of a pattern of rib and garter patches")."""


@dataclass(frozen=True)
class Stripe(Checked):
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
        row_width: flat width of the row of springs and hinges that k_s and k_t belong to; in a
            wider or narrower row they are in proportion. None if they apply to every row, as in
            the paper [mm].
        stretch_along: stiffness of springs along the ridges, their force over flat width and
            strain, without that of diagonals. None if they are those of the other stripe of the
            fabric, as in the paper [N/mm].
        curve_along: table of a measured curve of the springs along the ridges; None if linear.
    """

    knit: Knit
    n: Annotated[int, Field(gt=0, lt=10_000)]
    period: Annotated[PositiveFloat, Unit("mm")]
    k_s: Annotated[PositiveFloat, Unit("N/mm")]
    theta_0: RestAngle
    k_t: Annotated[PositiveFloat, Unit("N")]
    stiffening_strain: PositiveFloat | None = None
    spring_curve: SpringCurve | None = None
    row_width: Annotated[PositiveFloat, Unit("mm")] | None = None
    stretch_along: Annotated[PositiveFloat, Unit("N/mm")] | None = None
    curve_along: SpringCurve | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        name = f"{self.knit} {self.n}"
        if self.stiffening_strain is not None and self.spring_curve is not None:
            raise invalid(name, "has both stiffening_strain and spring_curve; give one")
        if self.curve_along is not None and self.stretch_along is None:
            raise invalid(name, "has curve_along alone; give stretch_along too")

    @property
    def spring_kind(self) -> SpringKinds:
        """The kinds of its springs' laws, across the ridges and along them."""
        across: SpringKind = "linear" if self.stiffening_strain is None else "stiffening"
        return self.spring_curve or across, self.curve_along or "linear"

    @property
    def contraction(self) -> float:
        """Relaxed over flat length of the pure stripe, sin(θ0/2); exact, with zero energy."""
        return math.sin(self.theta_0 / 2)


def cell_length(stripe: "Stripe | StripeNumbers", options: ModelOptions) -> Any:
    """Flat length of a grid cell across a stripe's ridges, by the option ``cell_size`` [mm]."""
    xp = array_library(stripe)
    length = xp.asarray(options.length_scale * stripe.period / options.cells_per_period)
    return length if options.cell_size == "flat" else length / xp.sin(stripe.theta_0 / 2)


def flat_stitch(stripe: Stripe, cell_size: CellSize) -> float:
    """Flat length of a stitch across the ridges [mm]; a period has 2n stitches."""
    flat = stripe.period if cell_size == "flat" else stripe.period / stripe.contraction
    return flat / (2 * stripe.n)


def lengths_ratio(stripe: Stripe, sheet: Sheet, options: ModelOptions) -> float:
    """Flat length of a stitch in the network over that in the cloth; 1 if not given."""
    rib = stripe.knit == "rib"
    cloth = sheet.cloth_stitch_width if rib else sheet.cloth_stitch_height
    # Keep this order of operations: identifiers of cases depend on its last digit.
    flat_period = options.cells_per_period * float(cell_length(stripe, options))
    return flat_period / (2 * stripe.n * cloth) if cloth else 1.0


def periods_per_patch(n_stripe: int, n_subunit: int) -> int:
    """Periods across a patch, n_subunit / (2 n_stripe); a ValueError if that is not whole."""
    periods, rest = divmod(n_subunit, 2 * n_stripe)
    if rest or periods < 1:
        raise ValueError(
            f"n_subunit = {n_subunit} is not a positive multiple of 2 × n_stripe = {2 * n_stripe};"
            f" choose {2 * n_stripe}, {4 * n_stripe}, {6 * n_stripe}, …"
        )
    return periods


def changed_stripe(stripe: Stripe, changes: Mapping[str, float]) -> Stripe:
    """A stripe with parameters replaced and multiplied.

    Changes are values such as ``rib_k_s``, and factors such as ``rib_k_s_factor`` for one knit or
    ``k_s_factor`` for both; a stiffening strain replaces any other spring law. Raises InputError if
    the rest angle would reach π, which is flat.
    """
    numbers: dict[str, Any] = {
        name: _changed(getattr(stripe, name), changes, f"{stripe.knit}_{name}", f"{name}_factor")
        for name in STRIPE_QUANTITIES
    }
    if not numbers["theta_0"] < math.pi:
        raise invalid(
            "model: theta_0",
            f"the changes make theta_0 of {stripe.knit} {stripe.n}"
            f" {numbers['theta_0']:.3g} rad; keep it below pi, which is flat",
        )
    for name in (f"{stripe.knit}_{STIFFENING}", STIFFENING):
        if name in changes:
            return replace(stripe, **numbers, stiffening_strain=changes[name], spring_curve=None)
    return replace(stripe, **numbers)


def changed_table(table: Table, changes: Mapping[str, float]) -> Table:
    """Walls or plain knit with values such as ``z_max`` and factors such as ``z_max_factor``."""
    names = [field.name for field in fields(table)]
    return replace(table, **{name: _changed(getattr(table, name), changes, name) for name in names})


def _changed(value: float, changes: Mapping[str, float], name: str, *more_factors: str) -> float:
    factors = [changes[each] for each in (f"{name}_factor", *more_factors) if each in changes]
    return math.prod([changes.get(name, value), *factors])
