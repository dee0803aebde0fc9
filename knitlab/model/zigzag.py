"""The two-dimensional model: a zigzag of springs and hinges, and its tension in closed form.

A period consists of four springs, like a row of the sheet (paper, Sec. "3D model"): folds of rest
angle θ0 alternate with joints that are straight at rest.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float

from knitlab.model.pattern import CELLS_PER_PERIOD
from knitlab.model.settings import ModelOptions
from knitlab.model.spring_curve import SpringCurve
from knitlab.model.spring_law import LINEAR, SpringLaw, spring_law
from knitlab.model.stripe import Stripe, cell_length

AS_CALIBRATED = ModelOptions(cell_size="relaxed")  # with which a measured curve is fitted
MAX_LOG_TILT = 40.0  # largest −log(tilt / relaxed tilt) in the search for the root

Length = Float[Array, ""]
Folds = TypeVar("Folds", bound="Zigzag")


class Zigzag(eqx.Module):
    """The zigzag of one stripe."""

    period: Float[Array, ""]  # relaxed [mm]
    k_s: Float[Array, ""]  # of springs across the ridges [N/mm]
    k_t: Float[Array, ""]  # of a fold [N mm]
    theta_0: Float[Array, ""]  # rest angle of a fold [rad]
    law: SpringLaw = LINEAR

    @property
    def cell(self) -> Float[Array, ""]:
        """Rest length of a spring, a quarter of the flattened period [mm]."""
        return self.period / (CELLS_PER_PERIOD * jnp.sin(self.theta_0 / 2))


def zigzag(stripe: Stripe, options: ModelOptions = AS_CALIBRATED) -> Zigzag:
    """The zigzag of a calibrated stripe: one row of its pure sheet, by default as calibrated."""
    cell = cell_length(stripe, replace(options, cells_per_period=4))
    k_t = stripe.k_t * (cell if options.hinge_stiffness == "per_length" else 1.0)
    return Zigzag(
        period=jnp.asarray(CELLS_PER_PERIOD * cell * stripe.contraction, float),
        k_s=jnp.asarray(stripe.k_s, float),
        k_t=jnp.asarray(k_t, float),
        theta_0=jnp.asarray(stripe.theta_0, float),
        law=stripe_law(stripe.stiffening_strain, stripe.spring_curve),
    )


def stripe_law(
    stiffening_strain: Float[Array, ""] | float | None, curve: SpringCurve | None
) -> SpringLaw:
    """The law of the springs of one stripe, with a stiffening strain [1], a curve, or neither."""
    strain = None if stiffening_strain is None else jnp.asarray(stiffening_strain, float)
    return spring_law([strain], [curve]).of(np.array(0))


def relaxed_chain(chain: Zigzag, periods: int) -> Float[Array, "node 2"]:
    """Nodes (x, y) of a relaxed zigzag that starts and ends midway between folds [mm]."""
    steps = np.arange(CELLS_PER_PERIOD * periods + 1)
    height = np.array([0.0, 1.0, 0.0, -1.0])[steps % CELLS_PER_PERIOD]
    along = steps * chain.cell * jnp.sin(chain.theta_0 / 2)
    return jnp.stack([along, height * chain.cell * jnp.cos(chain.theta_0 / 2)], axis=1)


def chain_energy(chain: Zigzag, nodes: Float[Array, "node 2"]) -> Float[Array, ""]:
    """E_tot of a zigzag [N mm] (paper, Eq. 1); folds are at odd nodes, alternately up and down."""
    segments = jnp.diff(nodes, axis=0)
    lengths = jnp.linalg.norm(segments, axis=1)
    before = segments[:-1]
    after = segments[1:]
    turn = jnp.arctan2(
        before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0], jnp.sum(before * after, axis=1)
    )
    # At an upper fold the zigzag turns clockwise.
    sense = np.array([-1.0, 0.0, 1.0, 0.0])[np.arange(len(nodes) - 2) % CELLS_PER_PERIOD]
    rest = sense * (jnp.pi - chain.theta_0)
    stretch = chain.k_s * jnp.sum(chain.law.stored(lengths, chain.cell))
    return stretch + 0.5 * chain.k_t * jnp.sum((turn - rest) ** 2)


def tension(chain: Zigzag, strain: Float[Array, " point"]) -> Float[Array, " point"]:
    """Tension of a zigzag at strains of its period, in closed form except for one root [N].

    All folds open equally and the joints stay straight: the minimum of the energy if k_t / (k_s
    cell²) is small, as for the paper's stripes (at most 0.07). It is differentiable.
    """
    return fold_tension(chain, lambda of, length: of.k_s * of.law.pull(length, of.cell), strain)


def fold_tension(
    folds: Folds, pull: Callable[[Folds, Length], Length], strain: Float[Array, " point"]
) -> Float[Array, " point"]:
    """Tension of folds that open equally, at strains of their period, at least 0 [N].

    ``pull`` is the force with which a segment between fold and joint resists its length. The root
    is the tilt of the segments, θ = π − 2 tilt, at which the tension of a segment of length ℓ, F
    cos(tilt) = pull, is that of the fold, F ℓ sin(tilt) = k_t (θ − θ0).
    """

    def length(of: Folds, tilt: Array, strain: Array) -> Array:
        return of.period * (1 + strain) / (CELLS_PER_PERIOD * jnp.cos(tilt))

    def tilt_at(of: Folds, log_tilt: Array) -> Array:
        # Solved for the logarithm of the tilt: at large strain it falls by orders of magnitude.
        return jnp.exp(-log_tilt) * (jnp.pi - of.theta_0) / 2

    def imbalance(log_tilt: Array, at: tuple[Folds, Array]) -> Array:
        of, strain = at
        tilt = tilt_at(of, log_tilt)
        stretched = length(of, tilt, strain)
        # Negative at the relaxed tilt and positive for tilt → 0.
        turned = jnp.pi - 2 * tilt - of.theta_0
        return turned - pull(of, stretched) * stretched * jnp.tan(tilt) / of.k_t

    def force(strain: Array) -> Array:
        solution: optx.Solution = optx.root_find(
            imbalance,
            optx.Bisection(rtol=1e-14, atol=1e-14),  # type: ignore[call-arg]
            jnp.asarray(1.0),
            args=(folds, strain),
            options={"lower": -1e-9, "upper": MAX_LOG_TILT},
            max_steps=200,
            throw=False,
        )
        tilt = tilt_at(folds, solution.value)
        moment = folds.k_t * (jnp.pi - 2 * tilt - folds.theta_0)
        return moment / (length(folds, tilt, strain) * jnp.sin(tilt))

    return jax.vmap(force)(strain)
