"""Changes: stripe and sheet parameters that a workflow gives anew, or multiplies."""

import math
from dataclasses import replace
from typing import Any

from pydantic import PositiveFloat

from knitlab.io.errors import fault
from knitlab.io.strict_model import StrictModel
from knitlab.model.stripe import Stripe

STRIPE_QUANTITIES = ("period", "k_s", "k_t", "theta_0")
SHEET_QUANTITIES = ("z_max", "k_wall", "surface_density", "damping")


class Changes(StrictModel):
    """What a ``[model]`` may say of stripes and sheet; factors multiply what else is said."""

    period_factor: PositiveFloat | None = None
    k_s_factor: PositiveFloat | None = None
    k_t_factor: PositiveFloat | None = None
    theta_0_factor: PositiveFloat | None = None

    rib_period: PositiveFloat | None = None
    rib_k_s: PositiveFloat | None = None
    rib_k_t: PositiveFloat | None = None
    rib_theta_0: PositiveFloat | None = None
    rib_period_factor: PositiveFloat | None = None
    rib_k_s_factor: PositiveFloat | None = None
    rib_k_t_factor: PositiveFloat | None = None
    rib_theta_0_factor: PositiveFloat | None = None

    garter_period: PositiveFloat | None = None
    garter_k_s: PositiveFloat | None = None
    garter_k_t: PositiveFloat | None = None
    garter_theta_0: PositiveFloat | None = None
    garter_period_factor: PositiveFloat | None = None
    garter_k_s_factor: PositiveFloat | None = None
    garter_k_t_factor: PositiveFloat | None = None
    garter_theta_0_factor: PositiveFloat | None = None

    z_max: PositiveFloat | None = None
    k_wall: PositiveFloat | None = None
    surface_density: PositiveFloat | None = None
    damping: PositiveFloat | None = None
    z_max_factor: PositiveFloat | None = None
    k_wall_factor: PositiveFloat | None = None
    surface_density_factor: PositiveFloat | None = None
    damping_factor: PositiveFloat | None = None


def changed_stripe(stripe: Stripe, changes: Changes) -> Stripe:
    """The stripe with what the changes say of its knit.

    Raises:
        BadInput: if its rest angle would reach π, which is flat.
    """
    numbers = {name: getattr(stripe, name) for name in STRIPE_QUANTITIES}
    numbers = {
        name: _changed(number, changes, f"{stripe.knit}_{name}", f"{name}_factor")
        for name, number in numbers.items()
    }
    if not numbers["theta_0"] < math.pi:
        raise fault(
            "model: theta_0",
            f"the changes make theta_0 of {stripe.knit} {stripe.n}"
            f" {numbers['theta_0']:.3g} rad; keep it below pi, which is flat",
        )
    return replace(stripe, **numbers)


def changed_sheet(values: dict[str, float], changes: Changes) -> dict[str, float]:
    """The values of ``sheet.toml`` with what the changes say of them."""
    return {name: _changed(value, changes, name) for name, value in values.items()}


def _changed(value: float, changes: Any, name: str, *more_factors: str) -> float:
    own = getattr(changes, name)
    factors = [getattr(changes, factor) for factor in (f"{name}_factor", *more_factors)]
    given = value if own is None else own
    return math.prod([given, *(factor for factor in factors if factor is not None)])
