"""Adjoints: derivatives of measures of an equilibrium with respect to its stripe parameters.

In equilibrium the force g on the free unknowns is zero, so that a change of anything else displaces
them by −K⁻¹ ∂g, with the stiffness K. For a quantity J one solve K λ = ∂J/∂(free) at the strained
state gives the multipliers λ. The derivative by the held unknowns is pulled back through the
loading to the relaxed shape, where a second solve completes it.

Of the parameters the energy of contact depends on the mean area of a grid cell alone, to which it
is proportional. Where the fabric snaps, K is singular and there is no derivative; where a node
begins to touch a wall, the result is the one-sided one with the present contacts.
"""

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, Int

from knitlab.model.energy import COMPLETE, energy
from knitlab.model.fabric import Configuration, Fabric, flat_sheet
from knitlab.model.layout import FabricLayout
from knitlab.model.network import MeshShape, network
from knitlab.model.stripe_numbers import StripePair
from knitlab.solvers.element_chunks import ChunkedFabric
from knitlab.solvers.equilibrium.alignment import rigidly_aligned
from knitlab.solvers.equilibrium.stiffness import free_stiffness
from knitlab.solvers.equilibrium.system import one_thread_of_blas
from knitlab.solvers.factorisation.multifrontal import Multifrontal
from knitlab.solvers.factorisation.symbolic_factorisation import planned
from knitlab.solvers.loads import WARP
from knitlab.solvers.loads.loading import all_free, free_under

if TYPE_CHECKING:
    from knitlab.solvers.equilibrium.contact_barrier import Barrier

Unknowns = Float[Array, " unknown"]  # A configuration, flattened [mm]
Free = Float[np.ndarray, " free"]
Whole = Float[np.ndarray, " unknown"]
Rows = Float[Array, "quantity unknown"]
Moved = Float[np.ndarray, "row unknown"]  # forces on all unknowns, or displacements
Measure = Callable[[Configuration, Configuration, Fabric, Unknowns], Float[Array, "*quantity"]]
"""A function of the relaxed configuration, of the strained one, of the fabric, and of the gradient
of the energy of contact in the strained one, in pure JAX, that returns a number or several."""


class NoDerivative(ArithmeticError):
    """The state is not a stable equilibrium, or so close to instability that K is singular."""


class LinearResponse:
    """Displacements of an equilibrium by small forces, both without free rigid motions."""

    def __init__(self, shape: MeshShape, free: Int[np.ndarray, " free"]) -> None:
        self.free = free_stiffness(shape, free)
        self._movable = free_stiffness(shape, all_free(shape))
        self._of_springs: Multifrontal | None = None

    def at(
        self,
        fabric: Fabric,
        unknowns: Whole,
        contact: "Barrier | None" = None,
    ) -> "LinearResponse":
        """The response at one equilibrium, in place of the last one; or :class:`NoDerivative`."""
        shape = self.free.shape
        free = self.free.dofs
        hessians = ChunkedFabric(shape, fabric).element_hessians(COMPLETE, unknowns)
        touching = contact and contact.hessian(unknowns, self._movable.dofs, exact=True)
        # A small shift, so that rigid motions do not make K singular [N/mm].
        entries = self.free.shifted(self.free.entries(hessians), 1e-9)
        with one_thread_of_blas():
            if touching is None:
                self._of_springs = self._of_springs or Multifrontal(self.free.plan)
                self._factors = self._of_springs
            else:
                pairs = sp.tril(sp.csr_array(touching)[free][:, free])
                whole = sp.csc_array(self.free.lower(entries) + pairs)
                whole.sort_indices()
                entries = whole.data
                plan = planned(self.free.order, whole.indptr, whole.indices)
                self._factors = Multifrontal(plan)
            if not self._factors.factorise(entries):
                raise NoDerivative("the stiffness is not positive definite")
        lower = self._movable.lower(self._movable.entries(hessians))
        self._stiffness = sp.csr_array(lower + sp.tril(lower, -1).T)
        if touching is not None:
            self._stiffness = sp.csr_array(self._stiffness + touching)
        self._within = self._stiffness[free][:, free]
        motions = np.linalg.qr(rigid_motions(Configuration.of(unknowns, shape))[free])[0]
        energies, combined = np.linalg.eigh(motions.T @ (self._within @ motions))
        # Contact with a wall makes a rigid motion far stiffer [N/mm].
        self._rigid = motions @ combined[:, energies < 1e-7]
        return self

    def to(self, forces: Moved) -> Moved:
        """Displacements under forces, row by row, or :class:`NoDerivative`; 0 for held unknowns."""
        displacements = np.zeros_like(forces)
        free = self.free.dofs
        for row, force in zip(displacements, forces, strict=True):
            row[free] = self._solved(self._without_rigid_motion(force[free]))
        return displacements

    def stiffness_times(self, displacements: Moved) -> Moved:
        """K times displacements of all unknowns, row by row."""
        forces = np.zeros_like(displacements)
        size = self._stiffness.shape[0]
        forces[:, :size] = displacements[:, :size] @ self._stiffness
        return forces

    def rigid_motion(self, rows: Moved) -> Moved:
        """Projection of rows onto the rigid motions that cost no energy."""
        rigid = np.zeros_like(rows)
        free = self.free.dofs
        rigid[:, free] = rows[:, free] @ self._rigid @ self._rigid.T
        return rigid

    def _solved(self, force: Free) -> Free:
        solution = np.zeros_like(force)
        residual = force
        largest = np.abs(force).max()
        for _ in range(20):
            if np.abs(residual).max() <= 1e-11 * largest:
                return solution
            solution = self._without_rigid_motion(solution + self._factors.solve(residual))
            residual = self._without_rigid_motion(force - self._within @ solution)
        raise NoDerivative("the stiffness is singular, or nearly so")

    def _without_rigid_motion(self, vector: Free) -> Free:
        return vector - self._rigid @ (self._rigid.T @ vector)


def rigid_motions(configuration: Configuration) -> Float[np.ndarray, "unknown 6"]:
    """Three translations and three rotations about the middle, as velocities of the unknowns."""
    nodes = np.asarray(configuration.positions)
    arms = nodes - nodes.reshape(-1, 3).mean(axis=0)
    moves = [np.broadcast_to(axis, arms.shape) for axis in np.eye(3)]
    turns = [np.cross(axis, arms) for axis in np.eye(3)]
    motions = Configuration(np.stack([*moves, *turns]), np.zeros((6, 2)))
    return np.asarray(motions.flattened()).T


class Adjoint:
    """Derivatives along the tensile test of one fabric, from its layout, stripes and relaxed shape.

    The rigid alignment of a sample depends on its stripes too; its height between walls counts as
    fixed. :class:`NoDerivative` is raised if the relaxed shape is not a stable equilibrium.
    """

    def __init__(
        self,
        layout: FabricLayout,
        stripes: StripePair,
        relaxed: Configuration,
        contact: "Barrier | None" = None,
    ) -> None:
        shape = self._shape = layout.net.shape
        self._contact = contact
        self._relaxed = np.asarray(relaxed.flattened())
        self._fabric = layout.fabric(stripes)
        numbers, self._pair = ravel_pytree(stripes)
        # Derivatives of all parameters of the fabric with respect to those of its stripes.
        by_numbers = jax.jacfwd(lambda x: ravel_pytree(layout.fabric(self._pair(x)))[0])(numbers)
        self._slope = np.asarray(by_numbers)
        self._under_tension = LinearResponse(shape, free_under(shape))
        at_rest = LinearResponse(shape, all_free(shape))
        self._at_rest = at_rest.at(self._fabric, self._relaxed, contact)

    def strained_derivatives(
        self, applied_strain: float, strained: Configuration, measure: Measure
    ) -> StripePair:
        """Derivatives of a measure of the equilibrium at one strain, or :class:`NoDerivative`.

        JAX traces the measure once for each mesh shape: pass the same function object. Every value
        is differentiated by every stripe parameter; those of a graded fabric, along the first axis.
        """
        unknowns = np.asarray(strained.flattened())
        by_relaxed, by_unknowns, by_fabric = self._jacobian(measure, unknowns)
        response = self._under_tension.at(self._fabric, unknowns, self._contact)
        multipliers = response.to(by_unknowns)
        by_fabric = self._through_forces(unknowns, multipliers, by_fabric)
        by_held = by_unknowns - response.stiffness_times(multipliers)
        by_held[:, response.free.dofs] = 0
        by_relaxed += _through_loading(self._shape, self._relaxed, applied_strain, by_held)
        return self._through_relaxed(by_relaxed, by_fabric)

    def relaxed_derivatives(self, measure: Measure) -> StripePair:
        """The same of a measure of the relaxed shape, which is also passed as the strained one."""
        by_relaxed, by_strained, by_fabric = self._jacobian(measure, self._relaxed)
        return self._through_relaxed(by_relaxed + by_strained, by_fabric)

    def _jacobian(self, measure: Measure, unknowns: Whole) -> tuple[Moved, Moved, Fabric]:
        pushed = self._pushed(unknowns)
        at = self._relaxed, unknowns, self._fabric, pushed
        by_relaxed, by_unknowns, by_fabric, by_pushed = _jacobian(measure, self._shape, *at)
        by_unknowns = np.array(by_unknowns)
        if self._contact is not None:
            every = np.arange(len(unknowns))
            hessian = self._contact.hessian(unknowns, every, exact=True)
            if hessian is not None:
                by_unknowns += np.asarray(by_pushed) @ hessian
            by_fabric = _by_cell_area(by_fabric, self._fabric, np.asarray(by_pushed) @ pushed)
        return np.array(by_relaxed), by_unknowns, by_fabric

    def _pushed(self, unknowns: Whole) -> Whole:
        if self._contact is None:
            return np.zeros_like(unknowns)
        return self._contact.evaluate(unknowns)[1]

    def _through_forces(self, unknowns: Whole, multipliers: Moved, by_fabric: Fabric) -> Fabric:
        """Adds −λᵀ ∂g/∂(fabric) to the derivative by the fabric, contact included."""
        by_fabric = _through_forces(self._shape, self._fabric, unknowns, multipliers, by_fabric)
        if self._contact is None:
            return by_fabric
        return _by_cell_area(by_fabric, self._fabric, -multipliers @ self._pushed(unknowns))

    def _through_relaxed(self, by_relaxed: Moved, by_fabric: Fabric) -> StripePair:
        # Rigid motions, which cost no energy, are determined by the rigid alignment.
        rigid = self._at_rest.rigid_motion(by_relaxed)
        at = self._shape, self._fabric, self._relaxed
        by_fabric, by_aligned = _through_alignment(*at, rigid, by_fabric)
        multipliers = self._at_rest.to(by_relaxed - rigid + np.asarray(by_aligned))
        by_fabric = self._through_forces(self._relaxed, multipliers, by_fabric)
        rows = [np.reshape(leaf, (len(by_relaxed), -1)) for leaf in jax.tree.leaves(by_fabric)]
        by_number = np.concatenate(rows, axis=1) @ self._slope
        derivatives: StripePair = jax.vmap(self._pair, out_axes=-1)(jnp.asarray(by_number))
        return derivatives


def _by_cell_area(by_fabric: Fabric, fabric: Fabric, by_log: Float[np.ndarray, " row"]) -> Fabric:
    """Adds the derivative by the logarithm of the mean width times the mean height of a cell."""
    sides = (fabric.cell_x, by_fabric.cell_x), (fabric.cell_y, by_fabric.cell_y)
    added = [by + by_log[:, None] / np.sum(side) for side, by in sides]
    return eqx.tree_at(lambda each: (each.cell_x, each.cell_y), by_fabric, added)


@partial(jax.jit, static_argnums=(0, 1))
def _jacobian(
    measure: Measure,
    shape: MeshShape,
    relaxed: Unknowns,
    strained: Unknowns,
    fabric: Fabric,
    pushed: Unknowns,
) -> tuple[Rows, Rows, Fabric, Rows]:
    """Derivatives of a measure by both vectors of unknowns, the fabric, and forces of contact."""

    def numbers(
        relaxed: Unknowns, strained: Unknowns, fabric: Fabric, pushed: Unknowns
    ) -> Float[Array, " quantity"]:
        pair = Configuration.of(relaxed, shape), Configuration.of(strained, shape)
        return jnp.ravel(measure(*pair, fabric, pushed))

    return jax.jacrev(numbers, argnums=(0, 1, 2, 3))(relaxed, strained, fabric, pushed)


@partial(jax.jit, static_argnums=0)
def _through_forces(
    shape: MeshShape, fabric: Fabric, at: Unknowns, multipliers: Rows, by_fabric: Fabric
) -> Fabric:
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
        drive, _ = WARP.drive(shape, Configuration.of(unknowns, shape))
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
