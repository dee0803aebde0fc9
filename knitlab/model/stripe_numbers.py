"""The numbers of stripes as pytrees, by which a fabric can be differentiated."""

from collections.abc import Sequence

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from knitlab.model.spring_curve import SpringCurve
from knitlab.model.stripe import STIFFENING, STRIPE_QUANTITIES, Stripe


class StripeNumbers(eqx.Module):
    """The parameters of one stripe, or of several along an axis, as variables of derivatives."""

    k_s: Float[Array | np.ndarray, "*quantity"]
    k_t: Float[Array | np.ndarray, "*quantity"]
    theta_0: Float[Array | np.ndarray, "*quantity"]
    period: Float[Array | np.ndarray, "*quantity"]
    stiffening_strain: Float[Array | np.ndarray, "*quantity"] | None = None  # or infinite
    spring_curves: tuple[SpringCurve | None, ...] = eqx.field(static=True, default=(None,))
    row_widths: tuple[float | None, ...] = eqx.field(static=True, default=(None,))
    stretches_along: tuple[float | None, ...] = eqx.field(static=True, default=(None,))
    curves_along: tuple[SpringCurve | None, ...] = eqx.field(static=True, default=(None,))

    @classmethod
    def of(cls, stripes: Sequence[Stripe]) -> "StripeNumbers":
        """The parameters of stripes."""

        def numbers(name: str) -> Float[np.ndarray, "*stripe"]:
            values = [getattr(stripe, name) or np.inf for stripe in stripes]
            return np.array(values if len(stripes) > 1 else values[0], float)

        strain = numbers(STIFFENING)
        return cls(
            **{name: numbers(name) for name in STRIPE_QUANTITIES},
            stiffening_strain=strain if np.isfinite(strain).any() else None,
            spring_curves=tuple(stripe.spring_curve for stripe in stripes),
            row_widths=tuple(stripe.row_width for stripe in stripes),
            stretches_along=tuple(stripe.stretch_along for stripe in stripes),
            curves_along=tuple(stripe.curve_along for stripe in stripes),
        )


class StripePair(eqx.Module):
    """Rib and garter stripes of a fabric, or derivatives by them; equal in a pure fabric."""

    weft: StripeNumbers
    warp: StripeNumbers

    @classmethod
    def of(cls, weft: Sequence[Stripe], warp: Sequence[Stripe]) -> "StripePair":
        """The parameters of rib and garter stripes."""
        return cls(StripeNumbers.of(weft), StripeNumbers.of(warp))
