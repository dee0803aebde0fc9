"""Unusual values: settings that are valid but far from those of real fabrics."""

from collections.abc import Iterable

from knitlab.simulation.case import Case
from knitlab.simulation.stripe_changes import STRIPE_QUANTITIES
from knitlab.sweep.parameters import Parameters

USUAL_STRAIN = 2.0
"""Largest usual applied strain: that of pure stripes, which unfold furthest."""
FAR = 10.0
"""Factor above the largest, or below the smallest, value of the tables of an unusual value."""


def unusual_values(cases: Iterable[Case], parameters: Parameters) -> tuple[str, ...]:
    """A sentence for every value that may be a mistake, with the usual range.

    Args:
        cases: the cases of a plan.
        parameters: the stripe tables, whose values are usual.
    """
    found: dict[str, None] = {}
    for case in cases:
        if (strain := case.applied_strain[-1]) > USUAL_STRAIN:
            found[
                f"strain_max = {strain:g} is {strain:.0%} of the length; usual are 0.2 to 0.6,"
                " and 0.15 is 15 %"
            ] = None
        for stripe in (case.weft, case.warp):
            table = parameters.stripes.table(stripe.knit)
            for name in STRIPE_QUANTITIES:
                value = getattr(stripe, name)
                usual = [getattr(row, name) for row in table.n.values()]
                if not min(usual) / FAR <= value <= max(usual) * FAR:
                    unit = getattr(table.unit, name)
                    found[
                        f"{name} of {stripe.knit} {stripe.n} is {value:.4g} {unit}; usual are"
                        f" {min(usual):g} to {max(usual):g} {unit}"
                    ] = None
    return tuple(found)
