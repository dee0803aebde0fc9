"""Adjoints: derivatives of what is read off an equilibrium by the numbers of its stripes.

By the implicit function theorem: an equilibrium has no force g left on its free unknowns, so that
these move with whatever else changes as the stiffness K lets them. For a quantity J one solve
K λ = ∂J/∂(free) at the strained state says how J feels forces there; what that makes of the held
unknowns goes back through the loading to the relaxed shape, and one solve at the relaxed shape
does the rest. A factorisation serves all quantities of a state, that of the relaxed shape all
states.

There is no derivative where a branch of equilibria ends, for there the fabric snaps and K is
singular, nor at parameters at which a node comes to touch a wall or leaves it, though the
one-sided ones are there and what is returned is that of the walls as they are touched.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jaxtyping import Array, Float, Int

from knitlab.mechanics.evaluation import WHOLE, hessian_evaluator
from knitlab.mechanics.factorisation import Factoriser, Factors, factoriser
from knitlab.mechanics.loading import all_free, drive_along, free_under_tension, squared_up
from knitlab.mechanics.stiffness import FreeStiffness, free_stiffness
from knitlab.model.energy import energy
from knitlab.model.fabric import Fabric, StripePair, Weave, flat_sheet
from knitlab.model.network import MeshShape, Network, network

Configuration = Float[Array, " unknown"]
Quantities = Callable[[Configuration, Configuration, Fabric], Float[Array, "*quantity"]]
"""What is read off the relaxed configuration, that under strain and the fabric, in pure JAX: a
number or several."""

SHIFT = 1e-9
"""Added to K so that rigid motions do not make it singular [N/mm]."""
RIGID = 1e-7
"""Stiffness below which a rigid motion costs no energy; one node at a wall gives far more."""
REFINEMENTS = 20
ACCURACY = 1e-11
"""Largest residual of a solve over its right side."""


class NoDerivative(ArithmeticError):
    """The state is not a stable equilibrium, or so nearly not that K cannot be solved."""


class Adjoint:
    """Derivatives along the tensile test of one fabric.

    A sample of free edges is squared up before it is clamped, which follows its stripes too. Its
    height between the walls, where it touches none, is taken to stay.

    Args:
        weave: the fabric but for its numbers.
        stripes: the numbers to take derivatives by, at their values.
        relaxed: the relaxed shape of that fabric, an equilibrium [mm].
        method: of factorisation; by default the fastest that is installed.

    Raises:
        NoDerivative: if the relaxed shape is no stable equilibrium.
    """

    def __init__(
        self,
        weave: Weave,
        stripes: StripePair,
        relaxed: Float[np.ndarray, " unknown"],
        method: str | None = None,
    ) -> None:
        self._shape, self._relaxed = weave.net.shape, relaxed
        self._fabric, self._to_stripes = jax.vjp(weave.fabric, stripes)
        self._at_rest, self._held = (
            _Solvable(free, factoriser(free, method))
            for free in (
                free_stiffness(self._shape, all_free(self._shape)),
                free_stiffness(self._shape, free_under_tension(self._shape)),
            )
        )
        self._rest = self._at_rest.equilibrium(self._fabric, relaxed)

    def of_relaxed(self, quantities: Quantities) -> StripePair:
        """Derivatives of quantities of the relaxed shape, which is given as the strained one too.

        Returns:
            Of every quantity by each number of the stripes.
        """
        by_relaxed, by_strained, by_fabric = _jacobian(quantities)(
            self._relaxed, self._relaxed, self._fabric
        )
        return self._through_relaxed(np.asarray(by_relaxed + by_strained), by_fabric)

    def of_strained(
        self,
        applied_strain: float,
        strained: Float[np.ndarray, " unknown"],
        quantities: Quantities,
    ) -> StripePair:
        """Derivatives of quantities of the state at one applied strain.

        Args:
            applied_strain: the strain, held as the stripes change [1].
            strained: the equilibrium there [mm].
            quantities: what to take derivatives of. JAX traces it once, so give one and the same
                function for all fabrics of a mesh shape.

        Returns:
            Of every quantity by each number of the stripes.

        Raises:
            NoDerivative: if the state is no stable equilibrium.
        """
        by_relaxed, by_strained, by_fabric = _jacobian(quantities)(
            self._relaxed, strained, self._fabric
        )
        here = self._held.equilibrium(self._fabric, strained)
        for_free = [here.solve(row) for row in np.asarray(by_strained)[:, here.unknowns]]
        fabric_bar, left = _pulled_back(self._shape)(
            self._fabric, strained, here.spread(for_free), by_strained, by_fabric
        )
        to_held = np.delete(np.arange(self._shape.unknowns), here.unknowns)
        for_held = np.zeros(left.shape)
        for_held[:, to_held] = np.asarray(left)[:, to_held]
        back = _placed_back(self._shape)(self._relaxed, applied_strain, for_held)
        return self._through_relaxed(np.asarray(by_relaxed + back), fabric_bar)

    def _through_relaxed(
        self, by_relaxed: Float[np.ndarray, "quantity unknown"], by_fabric: Fabric
    ) -> StripePair:
        """The derivatives, from those by the relaxed shape and by the fabric."""
        rest = self._rest
        # Of how a sample lies, squaring up decides what no force does.
        rigid = rest.spread(by_relaxed[:, rest.unknowns] @ rest.rigid @ rest.rigid.T)
        by_fabric, squared = _squared_back(self._shape)(
            self._fabric, self._relaxed, rigid, by_fabric
        )
        right = by_relaxed - rigid + np.asarray(squared)
        forces = rest.spread([rest.solve(row) for row in right[:, rest.unknowns]])
        by_fabric, _ = _pulled_back(self._shape)(
            self._fabric, self._relaxed, forces, right, by_fabric
        )
        return jax.vmap(lambda row: self._to_stripes(row)[0])(by_fabric)


@dataclass(frozen=True, eq=False)
class _Solvable:
    """One choice of free unknowns, and what factors their stiffness."""

    free: FreeStiffness
    factorise: Factoriser

    def equilibrium(
        self, fabric: Fabric, configuration: Float[np.ndarray, " unknown"]
    ) -> "_Equilibrium":
        """A state of these; the one before can no longer be solved with."""
        hessians = hessian_evaluator(self.free.shape)(fabric, WHOLE, configuration)
        entries = self.free.entries(jax.tree.map(np.asarray, hessians))
        lower = self.free.lower(entries)
        stiffness = lower + sp.tril(lower, -1).T
        factors = self.factorise(self.free.shifted(entries, SHIFT))
        if factors is None:
            raise NoDerivative("the stiffness is not positive definite")
        motions = np.linalg.qr(rigid_motions(configuration)[self.free.unknowns])[0]
        energies, combined = np.linalg.eigh(motions.T @ (stiffness @ motions))
        rigid = motions @ combined[:, energies < RIGID]
        return _Equilibrium(len(configuration), self.free.unknowns, stiffness, factors, rigid)


@dataclass(frozen=True, eq=False)
class _Equilibrium:
    """The stiffness of a state, ready to be solved with.

    Attributes:
        size: length of a configuration.
        unknowns: places of the free unknowns.
        stiffness: K of these [N/mm].
        factors: of K + ``SHIFT``.
        rigid: rigid motions of the free unknowns that cost no energy, orthonormal.
    """

    size: int
    unknowns: Int[np.ndarray, " free"]
    stiffness: sp.csc_array
    factors: Factors
    rigid: Float[np.ndarray, "free motion"]

    def solve(self, right: Float[np.ndarray, " free"]) -> Float[np.ndarray, " free"]:
        """The x of K x = ``right``, both without rigid motion."""
        right = self._held(right)
        found, left = np.zeros_like(right), right
        for _ in range(REFINEMENTS):
            if np.abs(left).max(initial=0.0) <= ACCURACY * np.abs(right).max(initial=0.0):
                return found
            found = self._held(found + self.factors.solve(left))
            left = self._held(right - self.stiffness @ found)
        raise NoDerivative("the stiffness is singular, or nearly so")

    def spread(
        self, rows: list[np.ndarray] | Float[np.ndarray, "row free"]
    ) -> Float[np.ndarray, "row unknown"]:
        """Vectors of the free unknowns as vectors of all, 0 where held."""
        whole = np.zeros((len(rows), self.size))
        whole[:, self.unknowns] = rows
        return whole

    def _held(self, vector: Float[np.ndarray, " free"]) -> Float[np.ndarray, " free"]:
        return vector - self.rigid @ (self.rigid.T @ vector)


def rigid_motions(
    configuration: Float[np.ndarray, " unknown"],
) -> Float[np.ndarray, "unknown 6"]:
    """Three translations and three rotations about the middle, as velocities of the unknowns."""
    nodes = configuration[:-2].reshape(-1, 3)
    arms = nodes - nodes.mean(axis=0)
    moves = [np.broadcast_to(axis, arms.shape) for axis in np.eye(3)]
    turns = [np.cross(axis, arms) for axis in np.eye(3)]
    motions = np.array([motion.ravel() for motion in (*moves, *turns)]).T
    return np.concatenate([motions, np.zeros((2, 6))])


@lru_cache(maxsize=16)
def _jacobian(quantities: Quantities) -> Callable[..., tuple[Array, Array, Fabric]]:
    return jax.jit(jax.jacrev(lambda *of: jnp.ravel(quantities(*of)), argnums=(0, 1, 2)))


Rows = Float[Array, "quantity unknown"]


@lru_cache(maxsize=16)
def _pulled_back(shape: MeshShape) -> Callable[..., tuple[Fabric, Rows]]:
    """Program that takes solved forces λ off what J feels of the fabric and of every unknown."""

    def back(
        fabric: Fabric, at: Configuration, forces: Rows, by_unknowns: Rows, by_fabric: Fabric
    ) -> tuple[Fabric, Rows]:
        def work(of: Fabric, q: Configuration, force: Configuration) -> Array:
            return jax.jvp(lambda moved: energy(net, of, moved).total, (q,), (force,))[1]

        each = jax.vmap(jax.grad(work, argnums=(0, 1)), (None, None, 0))
        felt_by_fabric, felt = each(fabric, at, forces)
        return jax.tree.map(jnp.subtract, by_fabric, felt_by_fabric), by_unknowns - felt

    net: Network = network(shape)
    return jax.jit(back)


@lru_cache(maxsize=16)
def _placed_back(shape: MeshShape) -> Callable[..., Rows]:
    """Program from what J feels of the held unknowns to what it feels of the relaxed shape."""

    def back(relaxed: Configuration, applied_strain: Array, by_held: Rows) -> Rows:
        _, pull = jax.vjp(lambda q: q + applied_strain * drive_along(shape, q)[0], relaxed)
        return jax.vmap(pull)(by_held)[0]

    return jax.jit(back)


@lru_cache(maxsize=16)
def _squared_back(shape: MeshShape) -> Callable[..., tuple[Fabric, Rows]]:
    """Program that takes what J feels of rigid motion back through the squaring up."""

    def square(fabric: Fabric, relaxed: Configuration) -> Configuration:
        return squared_up(shape, flat_sheet(net, fabric), relaxed)

    def back(
        fabric: Fabric, relaxed: Configuration, rigid: Rows, by_fabric: Fabric
    ) -> tuple[Fabric, Rows]:
        _, pull = jax.vjp(square, fabric, relaxed)
        felt_by_fabric, felt = jax.vmap(pull)(rigid)
        return jax.tree.map(jnp.add, by_fabric, felt_by_fabric), felt

    net: Network = network(shape)
    return jax.jit(back)
