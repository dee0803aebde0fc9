"""Adjoints: derivatives of measures of an equilibrium with respect to its stripe parameters.

They follow from the implicit function theorem. In equilibrium the force g on the free unknowns is
zero, so that a change of anything else displaces them by −K⁻¹ ∂g, with the stiffness K. For a
quantity J one solve K λ = ∂J/∂(free) at the strained state gives the multipliers λ. The derivative
with respect to the held unknowns is pulled back through the loading to the relaxed shape, where a
second solve completes it. One factorisation is used for all quantities of a state, and that of the
relaxed shape for all states.

There is no derivative at the end of a branch of equilibria, where the fabric snaps and K is
singular. At parameters at which a node begins to touch a wall only one-sided derivatives exist; the
result is that with the present contacts.
"""

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from knitlab.equilibrium.linear_response import LinearResponses
from knitlab.equilibrium.loading import all_free, drive_along, free_under_tension, rigidly_aligned
from knitlab.fabric.configuration import Configuration
from knitlab.fabric.energy import energy
from knitlab.fabric.fabric import Fabric, flat_sheet
from knitlab.fabric.layout import FabricLayout
from knitlab.fabric.network import MeshShape, network
from knitlab.fabric.stripe import StripePair

Unknowns = Float[Array, " unknown"]
"""A configuration, flattened [mm]."""
Rows = Float[Array, "quantity unknown"]
Measure = Callable[[Configuration, Configuration, Fabric], Float[Array, "*quantity"]]
"""A function of the relaxed configuration, of the strained one and of the fabric, in pure JAX, that
returns a number or several."""


class Adjoint:
    """Derivatives along the tensile test of one fabric.

    A sample with free edges is rigidly aligned before it is clamped, which also depends on its
    stripes. As long as it touches no wall, its height between the walls is treated as fixed.

    Args:
        layout: the fabric without its parameters.
        stripes: values of the parameters with respect to which is differentiated.
        relaxed: the relaxed shape of that fabric, an equilibrium.

    Raises:
        NoDerivative: if the relaxed shape is not a stable equilibrium.
    """

    def __init__(self, layout: FabricLayout, stripes: StripePair, relaxed: Configuration) -> None:
        shape = self._shape = layout.net.shape
        self._relaxed, self._stripes = np.asarray(relaxed.flattened()), stripes
        self._fabric, self._slope = layout.fabric(stripes), _slope(layout, stripes)
        self._under_tension = LinearResponses(shape, free_under_tension(shape))
        self._at_rest = LinearResponses(shape, all_free(shape)).at(self._fabric, self._relaxed)

    def of_strained(
        self, applied_strain: float, strained: Configuration, measure: Measure
    ) -> StripePair:
        """Derivatives of a measure of the state at one applied strain.

        Args:
            applied_strain: the strain, which is held fixed [1].
            strained: the equilibrium there.
            measure: the function to differentiate, of the relaxed configuration, the strained one
                and the fabric, such as ``lambda relaxed, strained, fabric:
                jnp.ptp(strained.positions[..., 0])``. JAX traces it once, so pass the same
                function object for all fabrics of a mesh shape.

        Returns:
            Derivatives of every value of the measure with respect to every stripe parameter; for a
            graded fabric, with the stripes of a knit along the first axis.

        Raises:
            NoDerivative: if the state is not a stable equilibrium.
        """
        unknowns = np.asarray(strained.flattened())
        by_relaxed, by_strained, by_fabric = _jacobian(
            measure, self._shape, self._relaxed, unknowns, self._fabric
        )
        response = self._under_tension.at(self._fabric, unknowns)
        by_unknowns = np.asarray(by_strained)
        multipliers = response.to(by_unknowns)
        by_fabric = _through_forces(self._shape, self._fabric, unknowns, multipliers, by_fabric)
        by_held = by_unknowns - response.forces_of(multipliers)
        by_held[:, response.free] = 0
        by_relaxed += _through_loading(self._shape, self._relaxed, applied_strain, by_held)
        return self._through_relaxed(np.asarray(by_relaxed), by_fabric)

    def of_relaxed(self, measure: Measure) -> StripePair:
        """The same of a measure of the relaxed shape, which is also passed as the strained one."""
        by_relaxed, by_strained, by_fabric = _jacobian(
            measure, self._shape, self._relaxed, self._relaxed, self._fabric
        )
        return self._through_relaxed(np.asarray(by_relaxed + by_strained), by_fabric)

    def _through_relaxed(
        self, by_relaxed: Float[np.ndarray, "quantity unknown"], by_fabric: Fabric
    ) -> StripePair:
        """Derivatives by stripe parameters, from those by relaxed shape and by the fabric."""
        # Rigid motions, which cost no energy, are determined by the rigid alignment.
        rigid = self._at_rest.rigid_part(by_relaxed)
        by_fabric, aligned_part = _through_alignment(
            self._shape, self._fabric, self._relaxed, rigid, by_fabric
        )
        multipliers = self._at_rest.to(by_relaxed - rigid + np.asarray(aligned_part))
        by_fabric = _through_forces(
            self._shape, self._fabric, self._relaxed, multipliers, by_fabric
        )
        rows = [np.reshape(leaf, (len(by_relaxed), -1)) for leaf in jax.tree.leaves(by_fabric)]
        by_number = np.concatenate(rows, axis=1) @ self._slope
        numbers, structure = jax.tree.flatten(self._stripes)
        ends = np.cumsum([np.size(number) for number in numbers])
        parts = np.split(by_number.T, ends[:-1])
        derivatives: StripePair = jax.tree.unflatten(
            structure,
            [
                part.reshape(*np.shape(number), -1)
                for part, number in zip(parts, numbers, strict=True)
            ],
        )
        return derivatives


def _slope(
    layout: FabricLayout, stripes: StripePair
) -> Float[np.ndarray, "fabric_number stripe_number"]:
    """Derivatives of all parameters of a fabric with respect to those of its stripes."""
    numbers, pair = ravel_pytree(stripes)
    return np.asarray(jax.jacfwd(lambda x: ravel_pytree(layout.fabric(pair(x)))[0])(numbers))


@partial(jax.jit, static_argnums=(0, 1))
def _jacobian(
    measure: Measure, shape: MeshShape, relaxed: Unknowns, strained: Unknowns, fabric: Fabric
) -> tuple[Rows, Rows, Fabric]:
    """Derivatives of a measure by both vectors of unknowns and by the fabric."""

    def numbers(relaxed: Unknowns, strained: Unknowns, fabric: Fabric) -> Float[Array, " quantity"]:
        pair = Configuration.of(relaxed, shape), Configuration.of(strained, shape)
        return jnp.ravel(measure(*pair, fabric))

    return jax.jacrev(numbers, argnums=(0, 1, 2))(relaxed, strained, fabric)


@partial(jax.jit, static_argnums=0)
def _through_forces(
    shape: MeshShape, fabric: Fabric, at: Unknowns, multipliers: Rows, by_fabric: Fabric
) -> Fabric:
    """Adds −λᵀ ∂g/∂(fabric) to the derivative by the fabric."""

    def stored(unknowns: Unknowns, varied: Fabric) -> Array:
        return energy(network(shape), varied, Configuration.of(unknowns, shape)).total

    def work(varied: Fabric, along: Unknowns) -> Array:
        return jax.jvp(lambda q: stored(q, varied), (at,), (along,))[1]

    change = jax.vmap(jax.grad(work), (None, 0))(fabric, multipliers)
    return jax.tree.map(jnp.subtract, by_fabric, change)


@partial(jax.jit, static_argnums=0)
def _through_loading(
    shape: MeshShape, relaxed: Unknowns, applied_strain: Array, by_held: Rows
) -> Rows:
    """From the derivative by the held unknowns to that by the relaxed shape."""

    def loaded(unknowns: Unknowns) -> Unknowns:
        drive, _ = drive_along(shape, Configuration.of(unknowns, shape))
        return unknowns + applied_strain * drive

    return jax.vmap(jax.vjp(loaded, relaxed)[1])(by_held)[0]


@partial(jax.jit, static_argnums=0)
def _through_alignment(
    shape: MeshShape, fabric: Fabric, relaxed: Unknowns, rigid: Rows, by_fabric: Fabric
) -> tuple[Fabric, Rows]:
    """Pulls the derivative along rigid motions back through the rigid alignment."""

    def aligned(fabric: Fabric, relaxed: Unknowns) -> Unknowns:
        flat = flat_sheet(network(shape), fabric)
        level = rigidly_aligned(shape, flat, Configuration.of(relaxed, shape))
        return jnp.asarray(level.flattened())

    more_by_fabric, by_unknowns = jax.vmap(jax.vjp(aligned, fabric, relaxed)[1])(rigid)
    return jax.tree.map(jnp.add, by_fabric, more_by_fabric), by_unknowns
