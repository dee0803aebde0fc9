"""Tension of the two-dimensional zigzag by minimising its energy (paper, Sec. "2D model")."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float
from scipy.optimize import minimize, root

from knitlab.fabric.zigzag import Zigzag, chain_energy, relaxed_chain

GRADIENT_ROUND_OFF = 1e-8
"""Force below which round-off hides the energy change of a step [N]."""


@dataclass(frozen=True)
class ChainState:
    """Equilibrium of a zigzag at one strain.

    Attributes:
        nodes: positions (x, y) [mm].
        force: reaction at the right node, along x [N].
        residual: largest residual force on a free coordinate [N].
        iterations: iterations of the minimiser and the root finder.
        converged: whether the residual is within tolerance.
    """

    nodes: Float[np.ndarray, "node 2"]
    force: float
    residual: float
    iterations: int
    converged: bool


def pull_chain(
    chain: Zigzag, periods: int, applied_strain: Sequence[float], tolerance: float = 1e-12
) -> list[ChainState]:
    """Stretch a zigzag: the leftmost node is fixed, the rightmost displaced along x.

    At every strain the energy is minimised over the free nodes by :func:`scipy.optimize.minimize`
    (trust-region Newton, exact JAX gradient and Hessian), starting from the previous state
    stretched to the new length. The minimiser compares energies, which limits its accuracy to half
    of the digits; :func:`scipy.optimize.root` then improves the result to full accuracy.

    Args:
        chain: the zigzag.
        periods: its length in periods.
        applied_strain: displacement over the relaxed length, ascending from 0.
        tolerance: largest residual force on a free node [N].
    """
    start = np.asarray(relaxed_chain(chain, periods))
    length = start[-1, 0]
    energy, gradient, hessian = _derivatives(len(start))
    states: list[ChainState] = []
    nodes = start
    for strain in applied_strain:
        stretched = nodes * np.array([length * (1 + strain) / nodes[-1, 0], 1.0])
        stretched[-1] = length * (1 + strain), 0.0
        system = chain, jnp.asarray(stretched)
        found = minimize(
            energy,
            stretched[1:-1].ravel(),
            system,
            method="trust-exact",
            jac=gradient,
            hess=hessian,
            options={"gtol": GRADIENT_ROUND_OFF, "initial_trust_radius": 0.1 * float(chain.cell)},
        )
        polished = root(gradient, found.x, system, jac=hessian, tol=1e-14)
        nodes = np.asarray(_whole(polished.x, stretched))
        residual = float(np.abs(polished.fun).max())
        states.append(
            ChainState(
                nodes=nodes,
                force=float(jax.grad(chain_energy, argnums=1)(chain, jnp.asarray(nodes))[-1, 0]),
                residual=residual,
                iterations=int(found.nit + polished.nfev),
                converged=residual <= tolerance,
            )
        )
    return states


def _whole(
    free: Float[ArrayLike, " free"], ends: Float[ArrayLike, "node 2"]
) -> Float[Array, "node 2"]:
    return jnp.asarray(ends).at[1:-1].set(jnp.reshape(free, (-1, 2)))


@lru_cache(maxsize=8)
def _derivatives(_: int) -> tuple[Callable[..., np.ndarray], ...]:
    """Compiled energy, gradient and Hessian of the free nodes, for a number of nodes."""

    def energy(free: Array, chain: Zigzag, ends: Array) -> Array:
        return chain_energy(chain, _whole(free, ends))

    derivatives = energy, jax.grad(energy), jax.hessian(energy)
    compiled = [jax.jit(derivative) for derivative in derivatives]
    return tuple(lambda *x, call=call: np.asarray(call(*x)) for call in compiled)
