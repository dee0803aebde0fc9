"""Tension of the two-dimensional zigzag by minimising its energy (paper, Sec. "2D model")."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float
from scipy.optimize import minimize, root

from knitlab.model.zigzag import Zigzag, chain_energy, relaxed_chain

MAX_RESIDUAL = 1e-12  # force on a free node in equilibrium [N]
GRADIENT_ROUND_OFF = 1e-8  # force below which round-off hides the energy change of a step [N]


@dataclass(frozen=True)
class ChainState:
    """Equilibrium of a zigzag: nodes [mm], reaction at the right, largest force left [N]."""

    nodes: Float[np.ndarray, "node 2"]
    force: float
    residual: float
    iterations: int
    converged: bool


def pull_chain(chain: Zigzag, periods: int, applied_strain: Sequence[float]) -> list[ChainState]:
    """Stretch a zigzag of several periods: the leftmost node is fixed, the rightmost displaced.

    The energy is minimised at every strain over the relaxed length; a root finder then reduces the
    largest force on a free node to :data:`MAX_RESIDUAL`, which comparing energies cannot.
    """
    nodes = np.asarray(relaxed_chain(chain, periods))
    length = nodes[-1, 0]
    energy, gradient, hessian, on_nodes = _derivatives()
    states: list[ChainState] = []
    for strain in applied_strain:
        stretched = nodes * np.array([length * (1 + strain) / nodes[-1, 0], 1.0])
        stretched[-1] = length * (1 + strain), 0.0
        system = chain, jnp.asarray(stretched)
        rough = minimize(
            energy,
            stretched[1:-1].ravel(),
            system,
            method="trust-exact",
            jac=gradient,
            hess=hessian,
            options={"gtol": GRADIENT_ROUND_OFF, "initial_trust_radius": 0.1 * float(chain.cell)},
        )
        polished = root(gradient, rough.x, system, jac=hessian, tol=1e-14)
        nodes = np.asarray(_whole(polished.x, stretched))
        force = float(on_nodes(chain, nodes)[-1, 0])
        residual = float(np.abs(polished.fun).max())
        iterations = int(rough.nit + polished.nfev)
        states.append(ChainState(nodes, force, residual, iterations, residual <= MAX_RESIDUAL))
    return states


def _whole(
    free: Float[ArrayLike, " free"], ends: Float[ArrayLike, "node 2"]
) -> Float[Array, "node 2"]:
    return jnp.asarray(ends).at[1:-1].set(jnp.reshape(free, (-1, 2)))


@cache
def _derivatives() -> tuple[Callable[..., np.ndarray], ...]:
    """Compiled energy, gradient and Hessian of the free nodes, and gradient of all nodes."""

    def energy(free: Array, chain: Zigzag, ends: Array) -> Array:
        return chain_energy(chain, _whole(free, ends))

    of_all = jax.grad(chain_energy, argnums=1)
    compiled = map(jax.jit, (energy, jax.grad(energy), jax.hessian(energy), of_all))
    return tuple(lambda *x, call=call: np.asarray(call(*x)) for call in compiled)
