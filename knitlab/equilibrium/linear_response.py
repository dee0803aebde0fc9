"""Linear response: displacements of an equilibrium under small forces.

Rigid motions that cost no energy are projected out of both forces and displacements.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from knitlab.equilibrium.linear_algebra.multifrontal import Multifrontal
from knitlab.equilibrium.loading import all_free
from knitlab.equilibrium.stiffness import free_stiffness
from knitlab.equilibrium.system import one_thread_of_blas
from knitlab.fabric.configuration import Configuration
from knitlab.fabric.element_chunks import ChunkedFabric
from knitlab.fabric.energy import COMPLETE
from knitlab.fabric.fabric import Fabric
from knitlab.fabric.network import MeshShape

Rows = Float[np.ndarray, "row unknown"]
Vector = Float[np.ndarray, " free"]


class NoDerivative(ArithmeticError):
    """The state is not a stable equilibrium, or so close to instability that K is singular."""


class LinearResponses:
    """Linear responses of fabrics of one mesh shape, for one choice of free unknowns."""

    def __init__(self, shape: MeshShape, free: Int[np.ndarray, " free"]) -> None:
        self._free = free_stiffness(shape, free)
        self._movable = free_stiffness(shape, all_free(shape))
        self._factors = Multifrontal(self._free.plan)

    def at(self, fabric: Fabric, unknowns: Float[np.ndarray, " unknown"]) -> "LinearResponse":
        """The response of one equilibrium, which invalidates the previous one.

        Raises:
            NoDerivative: if K is not positive definite, apart from rigid motions.
        """
        free = self._free.places
        hessians = ChunkedFabric(self._free.shape, fabric).element_hessians(COMPLETE, unknowns)
        with one_thread_of_blas():
            # A small shift, so that rigid motions do not make K singular [N/mm].
            entries = self._free.shifted(self._free.entries(hessians), 1e-9)
            if not self._factors.factorise(entries):
                raise NoDerivative("the stiffness is not positive definite")
        lower = self._movable.lower(self._movable.entries(hessians))
        stiffness = sp.csr_array(lower + sp.tril(lower, -1).T)
        within = stiffness[free][:, free]
        motions = rigid_motions(Configuration.of(unknowns, self._free.shape))[free]
        motions = np.linalg.qr(motions)[0]
        energies, combined = np.linalg.eigh(motions.T @ (within @ motions))
        # Contact with a wall makes a rigid motion far stiffer [N/mm].
        rigid = motions @ combined[:, energies < 1e-7]
        return LinearResponse(free, stiffness, within, self._factors, rigid)


@dataclass(frozen=True, eq=False)
class LinearResponse:
    """Linear response of one equilibrium.

    Attributes:
        free: indices of the free unknowns.
        stiffness: K of all unknowns that forces can act on, which come first [N/mm].
        within: K of the free unknowns [N/mm].
        factors: factors of ``within``, slightly shifted.
        rigid: orthonormal rigid motions of the free unknowns that cost no energy.
    """

    free: Int[np.ndarray, " free"]
    stiffness: sp.csr_array
    within: sp.csr_array
    factors: Multifrontal
    rigid: Float[np.ndarray, "free motion"]

    def to(self, forces: Rows) -> Rows:
        """Displacements under forces, row by row; 0 for held unknowns, whose forces do nothing.

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

    def _solved(self, force: Vector) -> Vector:
        """The solution by iterative refinement, to a small relative residual."""
        solution, residual, largest = np.zeros_like(force), force, np.abs(force).max()
        for _ in range(20):
            if np.abs(residual).max() <= 1e-11 * largest:
                return solution
            solution = self._without_rigid_motion(solution + self.factors.solve(residual))
            residual = self._without_rigid_motion(force - self.within @ solution)
        raise NoDerivative("the stiffness is singular, or nearly so")

    def _without_rigid_motion(self, vector: Vector) -> Vector:
        return vector - self.rigid @ (self.rigid.T @ vector)


def rigid_motions(configuration: Configuration) -> Float[np.ndarray, "unknown 6"]:
    """Three translations and three rotations about the middle, as velocities of the unknowns."""
    nodes = np.asarray(configuration.positions)
    arms = nodes - nodes.reshape(-1, 3).mean(axis=0)
    moves = [np.broadcast_to(axis, arms.shape) for axis in np.eye(3)]
    turns = [np.cross(axis, arms) for axis in np.eye(3)]
    motions = Configuration(np.stack([*moves, *turns]), np.zeros((6, 2)))
    return np.asarray(motions.flattened()).T
