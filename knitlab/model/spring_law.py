"""Spring laws: the force of an extensional spring as a function of its length.

F = k_s ℓ0 f(e) with the strain e = ℓ/ℓ0 − 1 of the spring, f(0) = 0 and f′(0) = 1, so that k_s is
the stiffness at small strain for every law, and one law applies to springs of every length.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from knitlab.model.array_library import array_library
from knitlab.model.spring_curve import SpringCurve

Each = Float[Array | np.ndarray, "*#spring"]  # of every spring, or one of all


class SpringLaw(eqx.Module):
    """The law of some springs; its parameters, if it has any, are along the first axis.

    Without parameters f = e: the paper's linear springs (Eq. 1). With a stiffening strain e_s, f =
    e + e³/e_s², in compression as in tension, so that no cell softens when crushed.
    """

    rate: Float[Array | np.ndarray, "*spring"] | None = None  # 1/e_s²; None if all are linear
    shares: Float[Array | np.ndarray, "*spring curve"] | None = None  # 1 for its curve
    curves: tuple[SpringCurve, ...] = eqx.field(static=True, default=())  # measured

    def stored(self, length: Each, rest_length: Each) -> Each:
        """Energy over k_s: ℓ0² times the integral of f over strain [mm²]."""
        return self._derivative(-1, length, rest_length)

    def pull(self, length: Each, rest_length: Each) -> Each:
        """Force over k_s: ℓ0 f [mm]."""
        return self._derivative(0, length, rest_length)

    def slope(self, length: Each, rest_length: Each) -> Each:
        """Derivative of the force with respect to length, over k_s: f′ [1]."""
        return self._derivative(1, length, rest_length)

    def pull_over_length(self, length: Each, rest_length: Each) -> Each:
        """Force over k_s and length: stiffness across the spring, over k_s [1]."""
        if self.rate is None:
            return 1 - rest_length / length
        return self.pull(length, rest_length) / length

    def of(self, springs: Int[Array | np.ndarray, "*spring"]) -> "SpringLaw":
        """The law of some of the springs, by their indices."""
        return jax.tree.map(lambda numbers: numbers[springs], self)

    def mixed_with(
        self, other: "SpringLaw", part: Float[Array | np.ndarray, " spring"]
    ) -> "SpringLaw":
        """The law of springs of which a part has another law of the same curves."""

        def mixed(mine: Each, others: Each) -> Each:
            of_other = part.reshape(part.shape + (1,) * (mine.ndim - 1))
            return mine + of_other * (others - mine)

        return jax.tree.map(mixed, self, other)

    def _derivative(self, order: int, length: Each, rest_length: Each) -> Each:
        """A derivative of the force over k_s with respect to length; order −1 is the energy."""
        stretch = length - rest_length
        linear, cubic, scale = {
            -1: (0.5 * stretch**2, 0.5, rest_length**2),
            0: (stretch, 1.0, rest_length),
            1: (jnp.ones_like(stretch), 3.0, 1.0),
        }[order]
        if self.rate is None:
            return linear
        strain = stretch / rest_length
        factor = 1 + cubic * self.rate * strain**2
        if self.shares is None:
            return linear * factor
        value = linear * (factor - self.shares.sum(-1))
        for number, curve in enumerate(self.curves):
            value = value + scale * self.shares[..., number] * _on_curve(curve, order, strain)
        return value


LINEAR = SpringLaw()


class CurveLaw(eqx.Module):
    """The force of springs of one curve; programs are not compiled anew for another curve."""

    breaks: Float[Array, " knot"]  # strains [1]
    coefficients: Float[Array, "power piece"]

    @classmethod
    def of(cls, curve: SpringCurve) -> "CurveLaw":
        """The law of a curve."""
        return cls(jnp.asarray(curve.spline.x), jnp.asarray(curve.spline.c))

    def pull(self, length: Each, rest_length: Each) -> Each:
        """Force over k_s: ℓ0 f [mm]."""
        strain = length / rest_length - 1
        return rest_length * _piecewise(self.breaks, self.coefficients, strain)


def _on_curve(curve: SpringCurve, order: int, strain: Each) -> Each:
    """A derivative of a curve's force with respect to strain, or its integral from rest."""
    spline = curve.spline
    polynomials = spline.antiderivative() if order < 0 else spline.derivative(order)
    value = _piecewise(jnp.asarray(spline.x), jnp.asarray(polynomials.c), strain)
    return value - float(polynomials(0.0)) if order < 0 else value


def _piecewise(
    breaks: Float[Array, " knot"], coefficients: Float[Array, "power piece"], at: Each
) -> Each:
    """A piecewise polynomial, the highest power first; its ends continue."""
    piece = jnp.searchsorted(breaks[1:-1], at, side="right")
    along = at - breaks[piece]
    highest, *lower = coefficients
    value = highest[piece]
    for power in lower:
        value = value * along + power[piece]
    return value


def spring_law(
    stiffening_strains: Sequence[Float[Array | np.ndarray, ""] | float | None],
    curves: Sequence[SpringCurve | None],
) -> SpringLaw:
    """The law of several springs, each with a stiffening strain [1], a measured curve, or None."""
    if all(given is None for given in (*stiffening_strains, *curves)):
        return LINEAR
    rates = [np.zeros(()) if strain is None else 1 / strain**2 for strain in stiffening_strains]
    rate = array_library(stiffening_strains).stack(rates)
    known = tuple(dict.fromkeys(curve for curve in curves if curve is not None))
    if not known:
        return SpringLaw(rate)
    shares = np.array([[float(curve == each) for each in known] for curve in curves])
    return SpringLaw(rate, shares, known)
