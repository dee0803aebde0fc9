"""The endless sheet of one stripe, pulled across its ridges or along them, with three unknowns.

A pure stripe folds alike everywhere: its state is the interior angle θ of its folds, and the length
ℓ across the ridges and the height h along them of a grid cell (paper, Sec. "3D model"). Two
diagonals, with the stiffness and the law of the softer spring, couple ℓ and h; without them the
sheet is the zigzag of the paper's 2D model.
"""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from knitlab.model.pattern import CELLS_PER_PERIOD
from knitlab.model.spring_law import LINEAR, CurveLaw, SpringLaw
from knitlab.model.stripe import Stripe
from knitlab.model.zigzag import Zigzag, fold_tension, stripe_law

NEWTON_STEPS = 15  # to the side of a cell in balance; the last ones change nothing

Value = Float[Array, ""]


class PureStripe(Zigzag):
    """The numbers of an endless sheet of one stripe: a zigzag, and springs along the ridges."""

    stretch_along: Value | None = None  # of springs along the ridges; None: as across [N/mm]
    law_along: SpringLaw | CurveLaw = LINEAR

    @classmethod
    def of(cls, stripe: Stripe) -> "PureStripe":
        """A stripe whose period is that of the relaxed sheet."""
        along = stripe.stretch_along
        cell = stripe.period / (CELLS_PER_PERIOD * stripe.contraction)
        row = 1.0 if stripe.row_width is None else cell / stripe.row_width
        return cls(
            jnp.asarray(stripe.period, float),
            jnp.asarray(row * stripe.k_s, float),
            jnp.asarray(row * stripe.k_t, float),
            jnp.asarray(stripe.theta_0, float),
            stripe_law(stripe.stiffening_strain, stripe.spring_curve),
            None if along is None else jnp.asarray(along, float),
            LINEAR if stripe.curve_along is None else CurveLaw.of(stripe.curve_along),
        )

    def forces(self, length: Value, height: Value) -> tuple[Value, Value]:
        """Forces with which a cell resists its length across and height along the ridges [N]."""
        cell = self.cell
        diagonal = jnp.hypot(length, height)
        across = self.k_s * self.law.pull(length, cell)
        if self.stretch_along is None:
            along = self.k_s * self.law.pull(height, cell)
            inclined = self.k_s * self.law.pull(diagonal, jnp.sqrt(2.0) * cell)
        else:
            along = self.stretch_along * self.law_along.pull(height, cell)
            inclined = jnp.where(
                self.k_s <= self.stretch_along,
                self.k_s * self.law.pull(diagonal, jnp.sqrt(2.0) * cell),
                self.stretch_along * self.law_along.pull(diagonal, jnp.sqrt(2.0) * cell),
            )
        both = 2 * inclined / diagonal
        return across + both * length, along + both * height


def tension_across(sheet: PureStripe, strain: Float[Array, " point"]) -> Float[Array, " point"]:
    """Force across the ridges on one row, as wide as a cell, at strains of the period [N].

    All folds open equally, as in :func:`knitlab.model.zigzag.fold_tension`, and at every length the
    height is that of a cell in balance. It is differentiable; the strain must not be negative.
    """

    def pull(of: PureStripe, length: Value) -> Value:
        height = _balanced(lambda height, at: at[0].forces(at[1], height)[1], (of, length), of.cell)
        return of.forces(length, height)[0]

    return fold_tension(sheet, pull, strain)


def tension_along(sheet: PureStripe, strain: Float[Array, " point"]) -> Float[Array, " point"]:
    """Force along the ridges on one column of cells at strains of its height [N].

    Folds keep their rest angle; a column is cell × sin(θ0/2) wide while it is relaxed.
    """

    def force(strain: Value) -> Value:
        height = sheet.cell * (1 + strain)
        length = _balanced(lambda x, at: at[0].forces(x, at[1])[0], (sheet, height), sheet.cell)
        return sheet.forces(length, height)[1]

    return jax.vmap(force)(strain)


def _balanced(force: Any, at: tuple[PureStripe, Value], begin: Value) -> Value:
    """The side of a cell at which a force vanishes, by Newton's method [mm]."""
    slope = jax.grad(force)

    def newton(side: Value, at: tuple[PureStripe, Value]) -> Value:
        return side - force(side, at) / slope(side, at)

    fixed, side = jax.lax.stop_gradient((at, begin))
    root = jax.lax.fori_loop(0, NEWTON_STEPS, lambda _, side: newton(side, fixed), side)
    # A last step from the root has its derivatives.
    return newton(jax.lax.stop_gradient(root), at)
