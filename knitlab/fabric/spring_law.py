"""Spring laws: the force of an extensional spring as a function of its length.

F = k_s ℓ0 f(e) with the strain e = ℓ/ℓ0 − 1 of the spring, f(0) = 0 and f′(0) = 1, so that k_s is
the stiffness at small strain for every law. Laws are functions of strain and not of length, so that
one law applies to springs of every length, including diagonals.
"""

from abc import abstractmethod
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from knitlab.fabric.array_library import array_library
from knitlab.fabric.spring_curve import SpringCurve

Each = Float[Array | np.ndarray, "*#spring"]
"""A value of every spring, or one of all springs."""


class SpringLaw(eqx.Module):
    """The law of some springs; its parameters, if it has any, are along the first axis.

    All its results are divided by the stiffness k_s.
    """

    @abstractmethod
    def stored(self, length: Each, rest_length: Each) -> Each:
        """Energy over k_s [mm²]."""

    @abstractmethod
    def pull(self, length: Each, rest_length: Each) -> Each:
        """Force over k_s [mm]."""

    @abstractmethod
    def slope(self, length: Each, rest_length: Each) -> Each:
        """Derivative of the force with respect to length, over k_s [1]."""

    def pull_over_length(self, length: Each, rest_length: Each) -> Each:
        """Force over k_s and length: stiffness across the spring, over k_s [1]."""
        return self.pull(length, rest_length) / length

    def of(self, springs: Int[Array | np.ndarray, "*spring"]) -> "SpringLaw":
        """The law of some of the springs, by their indices."""
        return jax.tree.map(lambda numbers: numbers[springs], self)


class Linear(SpringLaw):
    """f = e: the paper's springs (Eq. 1)."""

    def stored(self, length: Each, rest_length: Each) -> Each:
        """½ (ℓ − ℓ0)² [mm²]."""
        return 0.5 * (length - rest_length) ** 2

    def pull(self, length: Each, rest_length: Each) -> Each:
        """ℓ − ℓ0 [mm]."""
        return length - rest_length

    def slope(self, length: Each, rest_length: Each) -> Each:
        """1."""
        return jnp.ones_like(length)

    def pull_over_length(self, length: Each, rest_length: Each) -> Each:
        """1 − ℓ0/ℓ [1]."""
        return 1 - rest_length / length


LINEAR = Linear()


class Stiffening(SpringLaw):
    """f = e + e³/e_s²: the cubic hardening spring (Duffing's).

    At the stiffening strain e_s the force is twice that of a linear spring. The law is
    a polynomial and thus smooth. It stiffens in compression as in tension, so that no cell of the
    network softens when it is crushed, and its energy does not overflow in a long step of a solver,
    as that of an exponential law would. With e_s → ∞ it is linear.

    Attributes:
        rate: 1/e_s², 0 for a linear spring [1].
    """

    rate: Float[Array | np.ndarray, "*spring"]

    def stored(self, length: Each, rest_length: Each) -> Each:
        """½ (ℓ − ℓ0)² (1 + ½ e²/e_s²) [mm²]."""
        stretch = length - rest_length
        return 0.5 * stretch**2 * (1 + 0.5 * self.rate * (stretch / rest_length) ** 2)

    def pull(self, length: Each, rest_length: Each) -> Each:
        """(ℓ − ℓ0) (1 + e²/e_s²) [mm]."""
        stretch = length - rest_length
        return stretch * (1 + self.rate * (stretch / rest_length) ** 2)

    def slope(self, length: Each, rest_length: Each) -> Each:
        """1 + 3 e²/e_s² [1]."""
        return 1 + 3 * self.rate * ((length - rest_length) / rest_length) ** 2


class Tabulated(SpringLaw):
    """Springs of which some have measured curves; the others are linear or stiffening.

    Attributes:
        rate: 1/e_s² of stiffening springs, 0 of the others [1].
        shares: 1 where a spring has the curve, else 0.
        curves: the curves.
    """

    rate: Float[Array | np.ndarray, "*spring"]
    shares: Float[Array | np.ndarray, "*spring curve"]
    curves: tuple[SpringCurve, ...] = eqx.field(static=True)

    def stored(self, length: Each, rest_length: Each) -> Each:
        """Energy over k_s: ℓ0² times the integral of f over strain [mm²]."""
        return rest_length**2 * self._of_shape(-1, (length - rest_length) / rest_length)

    def pull(self, length: Each, rest_length: Each) -> Each:
        """ℓ0 f [mm]."""
        return rest_length * self._of_shape(0, (length - rest_length) / rest_length)

    def slope(self, length: Each, rest_length: Each) -> Each:
        """f′ [1]."""
        return self._of_shape(1, (length - rest_length) / rest_length)

    def _of_shape(self, order: int, strain: Each) -> Each:
        """A derivative of f with respect to strain; order −1 is the integral."""
        linear, cubic = {
            -1: (0.5 * strain**2, 0.25 * strain**4),
            0: (strain, strain**3),
            1: (jnp.ones_like(strain), 3 * strain**2),
        }[order]
        total = (1 - self.shares.sum(-1)) * linear + self.rate * cubic
        for place, curve in enumerate(self.curves):
            total = total + self.shares[..., place] * _on_curve(curve, order, strain)
        return total


def _on_curve(curve: SpringCurve, order: int, strain: Each) -> Each:
    """A derivative of a curve's force with respect to strain, or its integral from rest."""
    spline = curve.spline
    polynomials = spline.antiderivative() if order < 0 else spline.derivative(order)
    piece = jnp.searchsorted(jnp.asarray(spline.x[1:-1]), strain, side="right")
    along = strain - jnp.asarray(spline.x)[piece]
    highest, *lower = jnp.asarray(polynomials.c)
    value = highest[piece]
    for coefficients in lower:
        value = value * along + coefficients[piece]
    return value - float(polynomials(0.0)) if order < 0 else value


def spring_law(
    stiffening_strains: Sequence[Float[Array | np.ndarray, ""] | None],
    curves: Sequence[SpringCurve | None],
) -> SpringLaw:
    """One law object for several springs, each with a law of its own.

    Args:
        stiffening_strains: e_s of each spring, or None [1].
        curves: measured curve of each spring, or None.
    """
    if all(given is None for given in (*stiffening_strains, *curves)):
        return LINEAR
    xp = array_library(stiffening_strains)
    rates = [np.zeros(()) if strain is None else 1 / strain**2 for strain in stiffening_strains]
    known = tuple(dict.fromkeys(curve for curve in curves if curve is not None))
    if not known:
        return Stiffening(xp.stack(rates))
    shares = [[float(curve == each) for each in known] for curve in curves]
    return Tabulated(xp.stack(rates), np.array(shares), known)
