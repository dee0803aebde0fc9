"""A design: one knit of rib and garter patches and its sample."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from pydantic import ValidationError

from knitlab.io.errors import BadInput, Fault, faults_of
from knitlab.model.options import Boundary
from knitlab.model.stripe import GARTER_STITCHES_PER_RIB_STITCH, SPRING_LAWS, Stripe
from knitlab.study.parameters import QUANTITIES, StripeRow
from knitlab.study.patterns import Pattern
from knitlab.study.single_case import OWN_PATTERN, SingleCase, single_case


@dataclass(frozen=True, kw_only=True)
class Design:
    """One knit: its pattern, its sample, and optionally its stripes.

    Attributes:
        n_stripe: stitches across a rib stripe; the garter stripe has twice as many courses.
        n_subunit: stitches along a garter stripe, a multiple of ``2 * n_stripe``.
        boundary: ``"periodic"`` for fabric without edges, ``"clamped"`` for a sample whose first
            and last row are held, as the paper tests it.
        pattern: the patches that repeat: a map, top course first, with R for rib, G for garter
            and P for plain knit; the name of a pattern of ``params/patterns.toml``; or a
            :class:`knitlab.Pattern` with sizes, stripes or folds of its own.
        unit_cells: repeats of the pattern in the sample along the warp (y) and the weft (x); 1 × 1
            by default.
        needles: needles of the machine, in place of ``unit_cells``: the sample is as wide as
            whole unit cells fit on them, and twice as long.
        rib: stripe of the rib patches; by default that of ``params/stripes.toml`` [mm, N, rad].
        garter: stripe of the garter patches, likewise.

    Raises:
        BadInput: if a stripe has the wrong knit or number of stitches, or a parameter out of
            range. :func:`knitlab.simulate` reports all other errors.

    Example:
        >>> import knitlab as kl
        >>> design = kl.Design(n_stripe=4, n_subunit=16, boundary="periodic")
        >>> design.rib is None
        True
    """

    n_stripe: int
    n_subunit: int
    boundary: Boundary = "clamped"
    pattern: tuple[str, ...] | str | Pattern = ("GR", "RG")
    unit_cells: tuple[int, int] | None = None
    needles: int | None = None
    rib: Stripe | None = None
    garter: Stripe | None = None

    def __post_init__(self) -> None:
        stitches = {"rib": self.n_stripe, "garter": GARTER_STITCHES_PER_RIB_STITCH * self.n_stripe}
        faults: list[Fault] = []
        for knit, n in stitches.items():
            stripe: Stripe | None = getattr(self, knit)
            if stripe is None:
                continue
            if (stripe.knit, stripe.n) != (knit, n):
                given = f"a {stripe.knit} stripe of {stripe.n} stitches"
                wanted = f"n_stripe = {self.n_stripe} takes a {knit} stripe of {n}"
                faults.append(Fault(knit, f"is {given}, and {wanted}"))
            try:
                numbers = asdict(stripe)
                names = (*QUANTITIES, *SPRING_LAWS)
                StripeRow.model_validate({name: numbers[name] for name in names})
            except ValidationError as error:
                faults += faults_of(error, knit)
        if faults:
            raise BadInput(faults)

    @property
    def stripes(self) -> tuple[Stripe, ...]:
        """The stripes that are given."""
        return tuple(stripe for stripe in (self.rib, self.garter) if stripe is not None)


def resolve(
    design: Design, applied_strain: Sequence[float], settings: Mapping[str, Any]
) -> SingleCase:
    """The case of a design.

    Args:
        design: the design.
        applied_strain: strains of its test, ascending from 0 [1].
        settings: settings that replace those of ``params/*.toml``.

    Raises:
        BadInput: with every fault of the design, the strains and the settings.
    """
    return single_case(
        {
            "n_stripe": [design.n_stripe],
            "n_subunit": [design.n_subunit],
            "pattern": _pattern(design),
            **_sample(design),
        },
        design.stripes,
        applied_strain,
        {"boundary": design.boundary, **settings},
        design.pattern if isinstance(design.pattern, Pattern) else None,
    )


def _pattern(design: Design) -> list[str]:
    """The key of a workflow's ``[design]`` that names the pattern, or holds its patches."""
    if isinstance(design.pattern, Pattern):
        return [OWN_PATTERN]
    return [design.pattern] if isinstance(design.pattern, str) else list(design.pattern)


def _sample(design: Design) -> dict[str, Any]:
    """The keys of the ``[design]`` section of a workflow that set the size of the sample."""
    given = {"needles": design.needles, "unit_cells": design.unit_cells}
    return {name: value for name, value in given.items() if value is not None}
