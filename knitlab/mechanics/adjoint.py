"""Adjoints: derivatives of what is read off an equilibrium by the numbers of its stripes.

By the implicit function theorem: an equilibrium has no force g left on its free unknowns, so that
these move with whatever else changes as the stiffness K lets them. For a quantity J one solve
K λ = ∂J/∂(free) at the strained state says how J feels forces there; what that makes of the held
unknowns goes back through the loading to the relaxed shape, and one solve at the relaxed shape
does the rest. A factorisation serves all quantities of a state, that of the relaxed shape all
states.

There is no derivative where a branch of equilibria ends, for there the fabric snaps and K is
singular, nor at numbers at which a node comes to touch a wall or leaves it: on either side there
is one, and what comes out is that with the walls as they are touched.
"""

from collections.abc import Callable
from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from knitlab.mechanics.linear_response import LinearResponses
from knitlab.mechanics.loading import all_free, drive_along, free_under_tension, rigidly_aligned
from knitlab.model.configuration import Configuration
from knitlab.model.energy import energy
from knitlab.model.fabric import Fabric, FabricLayout, StripePair, flat_sheet
from knitlab.model.network import MeshShape, network

Unknowns = Float[Array, " unknown"]
"""A configuration, flattened [mm]."""
Rows = Float[Array, "quantity unknown"]
Measure = Callable[[Configuration, Configuration, Fabric], Float[Array, "*quantity"]]
"""A function of the relaxed configuration, of that under strain and of the fabric, in pure JAX;
it gives a number or several."""


class Adjoint:
    """Derivatives along the tensile test of one fabric.

    A sample with free edges is squared up before it is clamped, in a way that follows its stripes
    too. Its height between the walls is taken to stay as long as it touches none.

    Args:
        layout: the fabric but for its numbers.
        stripes: the numbers to take derivatives by, at their values.
        relaxed: the relaxed shape of that fabric, an equilibrium.
        method: of factorisation; nested dissection by default.

    Raises:
        NoDerivative: if the relaxed shape is no stable equilibrium.
    """

    def __init__(
        self,
        layout: FabricLayout,
        stripes: StripePair,
        relaxed: Configuration,
        method: str | None = None,
    ) -> None:
        self._shape, self._relaxed = layout.net.shape, np.asarray(relaxed.flattened())
        self._fabric, self._slope = (
            layout.fabric(stripes),
            _slope(layout, stripes),
        )
        self._numbers = jax.tree.structure(stripes)
        self._pulled = LinearResponses.of(self._shape, free_under_tension(self._shape), method)
        at_rest = LinearResponses.of(self._shape, all_free(self._shape), method)
        self._rest = at_rest.at(self._fabric, self._relaxed)

    def of_relaxed(self, measure: Measure) -> StripePair:
        """Derivatives of a measure of the relaxed shape, which is given as the strained one too.

        Args:
            measure: what to take derivatives of, see :meth:`of_strained`.

        Returns:
            Of every number that the measure gives, by each number of the stripes.
        """
        by_relaxed, by_strained, by_fabric = _jacobian(measure, self._shape)(
            self._relaxed, self._relaxed, self._fabric
        )
        return self._through_relaxed(np.asarray(by_relaxed + by_strained), by_fabric)

    def of_strained(
        self,
        applied_strain: float,
        strained: Configuration,
        measure: Measure,
    ) -> StripePair:
        """Derivatives of a measure of the state at one applied strain.

        Args:
            applied_strain: the strain, held as the stripes change [1].
            strained: the equilibrium there.
            measure: what to take derivatives of: a function of the relaxed configuration, the
                strained one and the fabric, such as ``lambda relaxed, strained, fabric:
                jnp.ptp(strained.positions[..., 0])``. JAX traces it once, so give one and the same
                function for all fabrics of a mesh shape.

        Returns:
            Of every number that the measure gives, by each number of the stripes.

        Raises:
            NoDerivative: if the state is no stable equilibrium.
        """
        unknowns = np.asarray(strained.flattened())
        by_relaxed, by_strained, by_fabric = _jacobian(measure, self._shape)(
            self._relaxed, unknowns, self._fabric
        )
        felt, response = np.asarray(by_strained), self._pulled.at(self._fabric, unknowns)
        yielding = response.to(felt)
        by_fabric = _forced_back(self._shape)(self._fabric, unknowns, yielding, by_fabric)
        by_held = felt - response.forces_of(yielding)
        by_held[:, response.free] = 0
        by_relaxed += _placed_back(self._shape)(self._relaxed, applied_strain, by_held)
        return self._through_relaxed(np.asarray(by_relaxed), by_fabric)

    def _through_relaxed(
        self, by_relaxed: Float[np.ndarray, "quantity unknown"], by_fabric: Fabric
    ) -> StripePair:
        """The derivatives, from those by the relaxed shape and by the fabric."""
        # How a sample lies is decided by squaring it up, where no force decides it.
        rigid = self._rest.rigid_part(by_relaxed)
        by_fabric, squared = _aligned_back(self._shape)(
            self._fabric, self._relaxed, rigid, by_fabric
        )
        yielding = self._rest.to(by_relaxed - rigid + np.asarray(squared))
        by_fabric = _forced_back(self._shape)(self._fabric, self._relaxed, yielding, by_fabric)
        felt = [np.reshape(leaf, (len(by_relaxed), -1)) for leaf in jax.tree.leaves(by_fabric)]
        derivatives: StripePair = jax.tree.unflatten(
            self._numbers, (np.concatenate(felt, axis=1) @ self._slope).T
        )
        return derivatives


def _slope(
    layout: FabricLayout, stripes: StripePair
) -> Float[np.ndarray, "fabric_number stripe_number"]:
    """Derivatives of all numbers of a fabric by those of its stripes."""
    numbers, pair = ravel_pytree(stripes)
    return np.asarray(jax.jacfwd(lambda of: ravel_pytree(layout.fabric(pair(of)))[0])(numbers))


@lru_cache(maxsize=16)
def _jacobian(measure: Measure, shape: MeshShape) -> Callable[..., tuple[Rows, Rows, Fabric]]:
    """Program for the derivatives of a measure by both vectors of unknowns and by the fabric."""

    def numbers(relaxed: Unknowns, strained: Unknowns, fabric: Fabric) -> Float[Array, " quantity"]:
        pair = Configuration.of(relaxed, shape), Configuration.of(strained, shape)
        return jnp.ravel(measure(*pair, fabric))

    return jax.jit(jax.jacrev(numbers, argnums=(0, 1, 2)))


@lru_cache(maxsize=16)
def _forced_back(shape: MeshShape) -> Callable[..., Fabric]:
    """Program that takes −λᵀ ∂g/∂(fabric) into what J feels of the fabric."""
    net = network(shape)

    def back(fabric: Fabric, at: Unknowns, yielding: Rows, by_fabric: Fabric) -> Fabric:
        def stored(unknowns: Unknowns, of: Fabric) -> Array:
            return energy(net, of, Configuration.of(unknowns, shape)).total

        def work(of: Fabric, along: Unknowns) -> Array:
            return jax.jvp(lambda q: stored(q, of), (at,), (along,))[1]

        felt = jax.vmap(jax.grad(work), (None, 0))(fabric, yielding)
        return jax.tree.map(jnp.subtract, by_fabric, felt)

    return jax.jit(back)


@lru_cache(maxsize=16)
def _placed_back(shape: MeshShape) -> Callable[..., Rows]:
    """Program from what J feels of the held unknowns to what it feels of the relaxed shape."""

    def back(relaxed: Unknowns, applied_strain: Array, by_held: Rows) -> Rows:
        def placed(unknowns: Unknowns) -> Unknowns:
            drive, _ = drive_along(shape, Configuration.of(unknowns, shape))
            return unknowns + applied_strain * drive

        _, pull = jax.vjp(placed, relaxed)
        return jax.vmap(pull)(by_held)[0]

    return jax.jit(back)


@lru_cache(maxsize=16)
def _aligned_back(shape: MeshShape) -> Callable[..., tuple[Fabric, Rows]]:
    """Program that takes what J feels of rigid motion back through the squaring up."""
    net = network(shape)

    def aligned(fabric: Fabric, relaxed: Unknowns) -> Unknowns:
        configuration = Configuration.of(relaxed, shape)
        return rigidly_aligned(shape, flat_sheet(net, fabric), configuration).flattened()

    def back(
        fabric: Fabric, relaxed: Unknowns, rigid: Rows, by_fabric: Fabric
    ) -> tuple[Fabric, Rows]:
        _, pull = jax.vjp(aligned, fabric, relaxed)
        felt_of_fabric, felt = jax.vmap(pull)(rigid)
        return jax.tree.map(jnp.add, by_fabric, felt_of_fabric), felt

    return jax.jit(back)
