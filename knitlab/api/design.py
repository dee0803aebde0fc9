"""A design: one knit of rib and garter patches and its sample."""

from dataclasses import KW_ONLY, dataclass

from pydantic import ValidationError

from knitlab.fabric.settings import Boundary
from knitlab.fabric.stripe import GARTER_STITCHES_PER_RIB_STITCH, Stripe
from knitlab.io.errors import BadInput, Fault, faults_of
from knitlab.sweep.parameters import StripeRow
from knitlab.sweep.patterns import Pattern


@dataclass(frozen=True)
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
        further_stripes: stripes of other sizes than n_stripe, which a pattern with stripes of its
            own may have, in place of those of ``params/stripes.toml``.

    Raises:
        BadInput: if a stripe has the wrong knit or number of stitches, or a parameter out of
            range. :func:`knitlab.simulate` reports all other errors.

    Example:
        >>> import knitlab as kl
        >>> design = kl.Design(4, 16, boundary="periodic")
        >>> design.rib is None
        True
    """

    n_stripe: int
    n_subunit: int
    _: KW_ONLY
    boundary: Boundary = "clamped"
    pattern: tuple[str, ...] | str | Pattern = ("GR", "RG")
    unit_cells: tuple[int, int] | None = None
    needles: int | None = None
    rib: Stripe | None = None
    garter: Stripe | None = None
    further_stripes: tuple[Stripe, ...] = ()

    def __post_init__(self) -> None:
        stitches = {"rib": self.n_stripe, "garter": GARTER_STITCHES_PER_RIB_STITCH * self.n_stripe}
        faults: list[Fault] = []
        given = (("rib", self.rib), ("garter", self.garter))
        for knit, stripe in (*given, *(("further_stripes", each) for each in self.further_stripes)):
            if stripe is None:
                continue
            n = stitches.get(knit)
            if n is not None and (stripe.knit, stripe.n) != (knit, n):
                is_given = f"is a {stripe.knit} stripe of {stripe.n} stitches"
                wanted = f"n_stripe = {self.n_stripe} takes a {knit} stripe of {n}"
                faults.append(Fault(knit, f"{is_given}, and {wanted}"))
            try:
                StripeRow.of(stripe)
            except ValidationError as error:
                faults += faults_of(error, knit)
        if faults:
            raise BadInput(faults)

    @property
    def stripes(self) -> tuple[Stripe, ...]:
        """The stripes that are given."""
        own = (self.rib, self.garter)
        return (*self.further_stripes, *(stripe for stripe in own if stripe is not None))
