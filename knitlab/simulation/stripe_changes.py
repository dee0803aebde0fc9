"""Changes of stripe and sheet parameters: new values, and factors."""

import math
from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any, TypeVar

from knitlab.fabric.settings import PlainKnit, Sheet
from knitlab.fabric.stripe import Stripe
from knitlab.io.errors import fault

STRIPE_QUANTITIES = ("period", "k_s", "k_t", "theta_0")  # order of siblings' random changes
STIFFENING = "stiffening_strain"
"""Setting for one knit or both, without factors, because the tables have no value."""

Table = TypeVar("Table", Sheet, PlainKnit)


def changed_stripe(stripe: Stripe, changes: Mapping[str, float]) -> Stripe:
    """A stripe with parameters replaced and multiplied.

    Changes are values such as ``rib_k_s``, and factors such as ``rib_k_s_factor`` for one knit or
    ``k_s_factor`` for both; a stiffening strain, for one knit or for both, replaces any other
    spring law. Raises BadInput if the rest angle would reach π, which is flat.
    """
    numbers: dict[str, Any] = {
        name: _changed(getattr(stripe, name), changes, f"{stripe.knit}_{name}", f"{name}_factor")
        for name in STRIPE_QUANTITIES
    }
    if not numbers["theta_0"] < math.pi:
        raise fault(
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
