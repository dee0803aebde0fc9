"""Linear response: displacements of an equilibrium under small forces.

Rigid motions that cost no energy are projected out of both forces and displacements.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from knitlab.equilibrium.factorisation import Factoriser, Factors, factoriser, one_thread_of_blas
from knitlab.equilibrium.loading import all_free
from knitlab.equilibrium.stiffness import FreeStiffness, free_stiffness
from knitlab.fabric.configuration import Configuration
from knitlab.fabric.element_chunks import ChunkedFabric
from knitlab.fabric.energy import COMPLETE
from knitlab.fabric.fabric import Fabric
from knitlab.fabric.network import MeshShape

SHIFT = 1e-9
"""Shift of K, so that rigid motions do not make it singular [N/mm]."""
RIGID = 1e-7
"""Stiffness below which a rigid motion is free; contact with a wall gives far more [N/mm]."""
REFINEMENTS = 20
ACCURACY = 1e-11
"""Largest relative residual of a solve."""

Rows = Float[np.ndarray, "row unknown"]


class NoDerivative(ArithmeticError):
    """The state is not a stable equilibrium, or so close to instability that K is singular."""


@dataclass(frozen=True, eq=False)
class LinearResponses:
    """Linear responses of the fabrics of one mesh shape, for one choice of free unknowns.

    Attributes:
        free: sparsity of the stiffness of the free unknowns.
        movable: sparsity of the stiffness of all unknowns that forces can act on.
        factorise: factoriser of the former.
    """

    free: FreeStiffness
    movable: FreeStiffness
    factorise: Factoriser

    @classmethod
    def of(cls, shape: MeshShape, free: Int[np.ndarray, " free"]) -> "LinearResponses":
        """Prepare the responses of a mesh shape.

        Args:
            shape: the mesh shape.
            free: indices of the free unknowns.
        """
        stiffness = free_stiffness(shape, free)
        return cls(stiffness, free_stiffness(shape, all_free(shape)), factoriser(stiffness))

    def at(self, fabric: Fabric, unknowns: Float[np.ndarray, " unknown"]) -> "LinearResponse":
        """The response of one equilibrium, which invalidates the previous one.

        Args:
            fabric: the fabric.
            unknowns: its configuration in equilibrium, flattened [mm].

        Raises:
            NoDerivative: if K is not positive definite, apart from rigid motions.
        """
        whole = ChunkedFabric(self.free.shape, fabric)
        hessians = whole.element_hessians(COMPLETE, unknowns)
        with one_thread_of_blas():
            factors = self.factorise(self.free.shifted(self.free.entries(hessians), SHIFT))
        if factors is None:
            raise NoDerivative("the stiffness is not positive definite")
        lower = self.movable.lower(self.movable.entries(hessians))
        stiffness = sp.csr_array(lower + sp.tril(lower, -1).T)
        free = self.free.places
        within = stiffness[free][:, free]
        configuration = Configuration.of(unknowns, self.free.shape)
        motions = np.linalg.qr(rigid_motions(configuration)[free])[0]
        energies, combined = np.linalg.eigh(motions.T @ (within @ motions))
        rigid = motions @ combined[:, energies < RIGID]
        return LinearResponse(free, stiffness, within, factors, rigid)


@dataclass(frozen=True, eq=False)
class LinearResponse:
    """Linear response of one equilibrium.

    Attributes:
        free: indices of the free unknowns.
        stiffness: K of all unknowns that forces can act on, which come first [N/mm].
        within: K of the free unknowns [N/mm].
        factors: factors of ``within`` plus ``SHIFT``.
        rigid: orthonormal rigid motions of the free unknowns that cost no energy.
    """

    free: Int[np.ndarray, " free"]
    stiffness: sp.csr_array
    within: sp.csr_array
    factors: Factors
    rigid: Float[np.ndarray, "free motion"]

    def to(self, forces: Rows) -> Rows:
        """Displacements under forces, row by row; 0 for held unknowns.

        Args:
            forces: forces on every unknown; those on held ones have no effect.

        Raises:
            NoDerivative: if K is nearly singular.
        """
        displacements = np.zeros_like(forces)
        for row, force in zip(displacements, forces, strict=True):
            row[self.free] = self._solved(self._without_rigid_motion(force[self.free]))
        return displacements

    def forces_of(self, displacements: Rows) -> Rows:
        """K times displacements of all unknowns, row by row."""
        forces, size = np.zeros_like(displacements), self.stiffness.shape[0]
        forces[:, :size] = displacements[:, :size] @ self.stiffness
        return forces

    def rigid_part(self, rows: Rows) -> Rows:
        """Projection of rows onto the rigid motions that cost no energy."""
        part = np.zeros_like(rows)
        part[:, self.free] = rows[:, self.free] @ self.rigid @ self.rigid.T
        return part

    def _solved(self, force: Float[np.ndarray, " free"]) -> Float[np.ndarray, " free"]:
        solution, residual, largest = np.zeros_like(force), force, np.abs(force).max()
        for _ in range(REFINEMENTS):
            if np.abs(residual).max() <= ACCURACY * largest:
                return solution
            solution = self._without_rigid_motion(solution + self.factors.solve(residual))
            residual = self._without_rigid_motion(force - self.within @ solution)
        raise NoDerivative("the stiffness is singular, or nearly so")

    def _without_rigid_motion(
        self, vector: Float[np.ndarray, " free"]
    ) -> Float[np.ndarray, " free"]:
        return vector - self.rigid @ (self.rigid.T @ vector)


def rigid_motions(configuration: Configuration) -> Float[np.ndarray, "unknown 6"]:
    """Three translations and three rotations about the middle, as velocities of the unknowns."""
    nodes = np.asarray(configuration.positions)
    arms = nodes - nodes.reshape(-1, 3).mean(axis=0)
    moves = [np.broadcast_to(axis, arms.shape) for axis in np.eye(3)]
    turns = [np.cross(axis, arms) for axis in np.eye(3)]
    motions = Configuration(np.stack([*moves, *turns]), np.zeros((6, 2)))
    return np.asarray(motions.flattened()).T
