"""Stripe tables: schemas of the stripes of one yarn, as parameter and material files hold them."""

from collections.abc import Iterable
from dataclasses import asdict
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, PositiveFloat, model_validator

from knitlab.fabric.spring_law import SpringCurve
from knitlab.fabric.stripe import (
    GARTER_STITCHES_PER_RIB_STITCH,
    SPRING_LAWS,
    Knit,
    Stripe,
    periods_per_patch,
)
from knitlab.io.errors import fault
from knitlab.io.toml import StrictModel
from knitlab.sweep.declared_fields import (
    declared,
    required,
    unit_of,
    units,
    with_defaults,
    with_fields,
)

KNITS: tuple[Knit, ...] = ("rib", "garter")
QUANTITIES = declared(Stripe, without=("knit", "n", *SPRING_LAWS))
"""Fitted numbers of a stripe, by their types."""
UNITS = {name: unit_of(kind) for name, kind in QUANTITIES.items()}


@with_fields(units(QUANTITIES))
class StripeUnits(StrictModel):
    """Units of a stripe table."""

    stiffening_strain: Literal["1"] | None = None


@with_fields(with_defaults(SpringCurve))
class SpringCurveRow(StrictModel):
    """The table of a :class:`~knitlab.fabric.spring_law.SpringCurve`."""

    @model_validator(mode="after")
    def _is_a_curve(self) -> "SpringCurveRow":
        self.curve  # noqa: B018  (it raises)
        return self

    @property
    def curve(self) -> SpringCurve:
        """The curve of this table."""
        return SpringCurve(**dict(self))


@with_fields(required(QUANTITIES))
class StripeRow(StrictModel):
    """Fitted values of one stripe (paper, Tables 1 and 2), and the law of its springs.

    A source of its own replaces that of the table. The covariance of the fit is that of
    ``ln k_s``, ``ln k_t`` and ``theta_0``.
    """

    stiffening_strain: PositiveFloat | None = None
    spring_curve: SpringCurveRow | None = None
    source: str | None = Field(default=None, exclude=True)
    covariance: dict[str, dict[str, float]] | None = Field(default=None, exclude=True)

    @classmethod
    def of(cls, stripe: Stripe) -> "StripeRow":
        """The row of a stripe; ValidationError if a number of it is out of range."""
        numbers = asdict(stripe)
        return cls.model_validate({name: numbers[name] for name in (*QUANTITIES, *SPRING_LAWS)})

    @model_validator(mode="after")
    def _has_one_law(self) -> "StripeRow":
        if self.stiffening_strain is not None and self.spring_curve is not None:
            raise ValueError("has both stiffening_strain and spring_curve; give one")
        return self


def _stitches(text: str) -> str:
    if not (text.isascii() and text.isdigit() and int(text) > 0):
        raise ValueError(f"a stripe is named by its number of stitches, but is {text!r}")
    return text


class StripeTable(StrictModel):
    """All stripes of one knit, by stitches across a stripe."""

    source: str = Field(min_length=1)
    unit: StripeUnits
    n: dict[Annotated[str, AfterValidator(_stitches)], StripeRow] = Field(min_length=1)


class StripeTables(StrictModel):
    """The stripes of one yarn: ``stripes.toml``, or those of a material.

    With ``interpolate`` there are also stripes of every number of stitches between two of a table:
    their periods and angles are interpolated linearly, their stiffnesses geometrically.
    """

    rib: StripeTable | None = None
    garter: StripeTable | None = None
    interpolate: bool = Field(default=False, exclude=True)

    def rows(self, knit: Knit) -> dict[int, StripeRow]:
        """The tabulated stripes of one knit by their number of stitches, ascending."""
        table = self.rib if knit == "rib" else self.garter
        return {} if table is None else {n: table.n[str(n)] for n in sorted(map(int, table.n))}

    def sizes(self, knit: Knit) -> list[int]:
        """Numbers of stitches of the stripes that there are of one knit, ascending."""
        sizes = list(self.rows(knit))
        return list(range(sizes[0], sizes[-1] + 1)) if self.interpolate and sizes else sizes

    def stripe(self, knit: Knit, stitches: int) -> Stripe:
        """One stripe; KeyError if there is none, BadInput between two with springs not linear."""
        rows = self.rows(knit)
        if stitches not in self.sizes(knit):
            raise KeyError(stitches)
        if row := rows.get(stitches):
            numbers: dict[str, Any] = {name: getattr(row, name) for name in QUANTITIES}
            numbers["stiffening_strain"] = row.stiffening_strain
            numbers["spring_curve"] = row.spring_curve and row.spring_curve.curve
            return Stripe(knit, stitches, **numbers)
        smaller, larger = max(n for n in rows if n < stitches), min(n for n in rows if n > stitches)
        if any(getattr(rows[n], law) is not None for n in (smaller, larger) for law in SPRING_LAWS):
            problem = f"lies between {smaller} and {larger}, whose springs are not both linear"
            raise fault(f"{knit} {stitches}", f"{problem}; calibrate it")
        fraction = (stitches - smaller) / (larger - smaller)
        interpolated: dict[str, Any] = {}
        for name in QUANTITIES:
            first, last = getattr(rows[smaller], name), getattr(rows[larger], name)
            value = first + (last - first) * fraction
            if name in ("k_s", "k_t"):
                value = first * (last / first) ** fraction
            interpolated[name] = value
        return Stripe(knit, stitches, **interpolated)

    def with_stripes(self, stripes: Iterable[Stripe]) -> "StripeTables":
        """The tables, to which stripes are added, or whose stripes they replace."""
        tables = dict(self)
        for stripe in stripes:
            table = tables[stripe.knit] or StripeTable.model_construct(
                source="knitlab.Stripe", unit=StripeUnits.model_validate(UNITS), n={}
            )
            rows = table.n | {str(stripe.n): StripeRow.of(stripe)}
            tables[stripe.knit] = table.model_copy(update={"n": rows})
        return StripeTables(**tables)

    def impossible(self, n_stripe: int, n_subunit: int) -> str | None:
        """Why a design is impossible with these stripes, or None if it is possible."""
        ribs, garters = self.sizes("rib"), self.sizes("garter")
        pairing = [n for n in ribs if GARTER_STITCHES_PER_RIB_STITCH * n in garters]
        if n_stripe not in pairing:
            garter = f"garter stripe of {GARTER_STITCHES_PER_RIB_STITCH * n_stripe} to pair with"
            missing = garter if n_stripe in ribs else "rib stripe"
            return f"n_stripe = {n_stripe} has no {missing}; choose from {pairing}"
        try:
            periods_per_patch(n_stripe, n_subunit)
        except ValueError as error:
            return str(error)
        return None
