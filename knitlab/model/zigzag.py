"""The two-dimensional model: a zigzag of springs and hinges, and its tension in closed form.

A period is read as four springs, as a row of the sheet has them (paper, Sec. "3D model"): folds of
rest angle θ0 alternate with joints that rest straight. The paper's Sec. "2D model" leaves their
number open.
"""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float

from knitlab.model.fabric import cell_length
from knitlab.model.options import ModelOptions
from knitlab.model.pattern import CELLS_PER_PERIOD
from knitlab.model.spring_curve import SpringCurve
from knitlab.model.spring_law import LINEAR, Linear, SpringLaw, spring_law
from knitlab.model.stripe import Stripe

AS_CALIBRATED = ModelOptions(cell_size="relaxed", hinge_stiffness="per_edge", length_scale=1.0)
"""The model options with which a measured curve is fitted."""


class Zigzag(eqx.Module):
    """Numbers of one stripe's zigzag.

    Attributes:
        period: relaxed peak-to-peak distance [mm].
        k_s: stiffness of a spring [N/mm].
        k_t: stiffness of a hinge [N mm].
        theta_0: interior rest angle of a fold [rad].
        law: how the force of a spring grows.
    """

    period: Float[Array, ""]
    k_s: Float[Array, ""]
    k_t: Float[Array, ""]
    theta_0: Float[Array, ""]
    law: SpringLaw = LINEAR

    @property
    def cell(self) -> Float[Array, ""]:
        """Rest length of a spring, a quarter of the flattened period [mm]."""
        return self.period / (CELLS_PER_PERIOD * jnp.sin(self.theta_0 / 2))


def zigzag(stripe: Stripe, options: ModelOptions = AS_CALIBRATED) -> Zigzag:
    """The zigzag of a calibrated stripe: one row of its pure sheet.

    Args:
        stripe: its numbers.
        options: of the model; by default those that a calibration takes, by which w or h is the
            relaxed period.
    """
    cell = cell_length(stripe, replace(options, cells_per_period=4))
    k_t = stripe.k_t * (cell if options.hinge_stiffness == "per_length" else 1.0)
    period = CELLS_PER_PERIOD * cell * stripe.contraction
    return Zigzag(
        period=jnp.asarray(period, float),
        k_s=jnp.asarray(stripe.k_s, float),
        k_t=jnp.asarray(k_t, float),
        theta_0=jnp.asarray(stripe.theta_0, float),
        law=law_of_one(stripe.stiffening_strain, stripe.spring_curve),
    )


def law_of_one(
    stiffening_strain: Float[Array, ""] | float | None, curve: SpringCurve | None
) -> SpringLaw:
    """The law of the springs of one stripe.

    Args:
        stiffening_strain: e_s, or None [1].
        curve: a measured one, or None.
    """
    strain = None if stiffening_strain is None else jnp.asarray(stiffening_strain, float)
    return spring_law([strain], [curve]).of(np.array(0))


def relaxed_chain(chain: Zigzag, periods: int) -> Float[Array, "node 2"]:
    """Nodes (x, y) of a relaxed zigzag that starts and ends halfway between folds [mm]."""
    steps = np.arange(CELLS_PER_PERIOD * periods + 1)
    height = np.array([0.0, 1.0, 0.0, -1.0])[steps % CELLS_PER_PERIOD]
    along = steps * chain.cell * jnp.sin(chain.theta_0 / 2)
    return jnp.stack([along, height * chain.cell * jnp.cos(chain.theta_0 / 2)], axis=1)


def chain_energy(chain: Zigzag, nodes: Float[Array, "node 2"]) -> Float[Array, ""]:
    """E_tot of a zigzag [N mm] (paper, Eq. 1).

    Args:
        chain: its numbers.
        nodes: positions (x, y) [mm]; folds are at the odd ones, up and down in turn.
    """
    segments = jnp.diff(nodes, axis=0)
    lengths = jnp.linalg.norm(segments, axis=1)
    before, after = segments[:-1], segments[1:]
    turn = jnp.arctan2(
        before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0], jnp.sum(before * after, axis=1)
    )
    # At an upper fold the chain turns clockwise.
    sense = np.array([-1.0, 0.0, 1.0, 0.0])[np.arange(len(nodes) - 2) % CELLS_PER_PERIOD]
    rest = sense * (jnp.pi - chain.theta_0)
    stretch = chain.k_s * jnp.sum(chain.law.stored(lengths, chain.cell))
    return stretch + 0.5 * chain.k_t * jnp.sum((turn - rest) ** 2)


def force_at(chain: Zigzag, lean: Float[Array, ""]) -> Float[Array, ""]:
    """Tension of a zigzag of linear springs whose segments lean from the line of pull [N].

    The moment of the force about a fold meets the hinge, k_t (θ − θ0) = F ℓ cos(θ/2), with
    θ = π − 2 lean and the stretched spring ℓ = cell + F sin(θ/2) / k_s: a quadratic in F.
    """
    sine, cosine = jnp.sin(lean), jnp.cos(lean)
    moment = chain.k_t * (jnp.pi - 2 * lean - chain.theta_0)
    half = chain.cell * sine
    # The root in the form that does not cancel where the springs hardly stretch.
    return 2 * moment / (half + jnp.sqrt(half**2 + 4 * sine * cosine * moment / chain.k_s))


def period_at(chain: Zigzag, lean: Float[Array, ""]) -> Float[Array, ""]:
    """Its peak-to-peak distance under that tension, 4 ℓ sin(θ/2) [mm]; see :func:`force_at`."""
    length = chain.cell + force_at(chain, lean) * jnp.cos(lean) / chain.k_s
    return CELLS_PER_PERIOD * length * jnp.cos(lean)


def length_at(chain: Zigzag, lean: Float[Array, ""], strain: Float[Array, ""]) -> Float[Array, ""]:
    """Length that a spring must have for its lean at a strain of the period [mm]."""
    return chain.period * (1 + strain) / (CELLS_PER_PERIOD * jnp.cos(lean))


def imbalance(chain: Zigzag, lean: Float[Array, ""], strain: Float[Array, ""]) -> Float[Array, ""]:
    """What is left of the balance of a spring with its fold, whatever the law [1].

    The tension F is that of the spring, F cos(lean) = k_s ℓ0 f, and that of the fold,
    F ℓ sin(lean) = k_t (θ − θ0). Without F: k_t (θ − θ0) − k_s ℓ0 f ℓ tan(lean) = 0, over k_t. It
    is negative at the relaxed lean and positive as the lean vanishes.
    """
    length = length_at(chain, lean, strain)
    pull = chain.k_s * chain.law.pull(length, chain.cell)
    return jnp.pi - 2 * lean - chain.theta_0 - pull * length * jnp.tan(lean) / chain.k_t


def force_from_moment(
    chain: Zigzag, lean: Float[Array, ""], strain: Float[Array, ""]
) -> Float[Array, ""]:
    """Tension that holds the folds open at a lean and a strain of the period [N]."""
    moment = chain.k_t * (jnp.pi - 2 * lean - chain.theta_0)
    return moment / (length_at(chain, lean, strain) * jnp.sin(lean))


def tension(chain: Zigzag, strain: Float[Array, " point"]) -> Float[Array, " point"]:
    """Tension of a zigzag at strains of its period, in closed form but for one root [N].

    All folds open alike and the joints stay straight. That is the minimum of the energy while
    k_t / (k_s cell²) is small; it is 0.07 at most for the paper's stripes. Differentiable by the
    numbers of the zigzag and by strain, which must not be negative.
    """
    relaxed_lean = (jnp.pi - chain.theta_0) / 2
    linear = isinstance(chain.law, Linear)

    def excess(part: Array, of: tuple[Zigzag, Array]) -> Array:
        numbers, target = of
        # Solved for the logarithm of the lean: at large strain it falls by orders of magnitude.
        lean = jnp.exp(-part) * (jnp.pi - numbers.theta_0) / 2
        if linear:
            return period_at(numbers, lean) / numbers.period - 1 - target
        return imbalance(numbers, lean, target)

    def lean_at(target: Array) -> Array:
        found: optx.Solution = optx.root_find(
            excess,
            optx.Bisection(rtol=1e-14, atol=1e-14),  # type: ignore[call-arg]
            jnp.asarray(1.0),
            args=(chain, target),
            options={"lower": -1e-9, "upper": LARGEST_LOG_TILT},
            max_steps=200,
            throw=False,
        )
        return jnp.exp(-found.value) * relaxed_lean

    def force(target: Array) -> Array:
        lean = lean_at(target)
        return force_at(chain, lean) if linear else force_from_moment(chain, lean, target)

    return jax.vmap(force)(strain)


LARGEST_LOG_TILT = 40.0
"""Largest −log(lean / relaxed lean) searched."""
