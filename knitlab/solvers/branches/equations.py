"""Equations of equilibrium of a fabric that depend on one parameter, its applied strain."""

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float

from knitlab.model.energy import COMPLETE, Point
from knitlab.model.fabric import Configuration, Unknowns
from knitlab.solvers.element_chunks import ChunkedFabric
from knitlab.solvers.equilibrium.stiffness import FreeStiffness, free_stiffness
from knitlab.solvers.equilibrium.system import System
from knitlab.solvers.loads.loading import Loading

Vector = Float[np.ndarray, " free"]
DIFFERENCE = 1e-6  # of the parameter, for the derivative of the force by it


class FabricEquations:
    """A fabric under a loading: the energy V of its free unknowns u at the applied strain t.

    ``size`` is the scale of u, relative to which t counts along a branch. ``neutral`` are
    orthonormal motions that cost no energy, ``lift`` one that does only if something is touched.
    """

    def __init__(self, system: System, loading: Loading) -> None:
        self.loading = loading
        self._system = system.on(loading.shape)
        self._free = free_stiffness(loading.shape, loading.free)
        self._elements = ChunkedFabric(loading.shape, system.fabric)
        sides = np.asarray(system.fabric.cell_sides)
        self.size = float(sides.min()) * np.sqrt(len(loading.free))
        translations = _translations(loading)
        self.neutral = translations[:, :2]
        self.lift = translations[:, 2:]

    @property
    def start(self) -> Vector:
        """The relaxed fabric."""
        return self.loading.reference[self.loading.free]

    def unknowns(self, u: Vector, t: float) -> Unknowns:
        """All unknowns: the free ones, and those that the strain prescribes [mm]."""
        whole = self.loading.reference.copy()
        whole[self.loading.free] = u
        return self.loading.holding(whole, t)

    def gradient(self, u: Vector, t: float) -> Unknowns:
        """∂V by all unknowns, held ones too [N]."""
        return np.asarray(self._system.evaluate(Point(self.unknowns(u, t))).gradient)

    def energy(self, u: Vector, t: float) -> float:
        """Elastic energy [N mm]."""
        return float(self._system.evaluate(Point(self.unknowns(u, t))).energy.total)

    def force(self, u: Vector, t: float) -> Vector:
        """∂V/∂u [N]."""
        return self.gradient(u, t)[self.loading.free]

    def stiffness(self, u: Vector, t: float) -> sp.csc_array:
        """∂²V/∂u² [N/mm]."""
        return symmetric_stiffness(self._elements, self._free, self.unknowns(u, t))

    def force_by_parameter(self, u: Vector, t: float) -> Vector:
        """∂²V/∂u∂ε by a central difference [N]."""
        return (self.force(u, t + DIFFERENCE) - self.force(u, t - DIFFERENCE)) / (2 * DIFFERENCE)


def symmetric_stiffness(
    elements: ChunkedFabric, free: FreeStiffness, unknowns: Unknowns
) -> sp.csc_array:
    """The whole symmetric stiffness of the free unknowns of a fabric [N/mm]."""
    lower = free.lower(free.entries(elements.element_hessians(COMPLETE, unknowns)))
    return sp.csc_array(lower + sp.tril(lower, -1).T)


def _translations(loading: Loading) -> Float[np.ndarray, "free mode"]:
    """Translations in the plane and across it, of periodic fabric; clamps allow none."""
    shape = loading.shape
    if not shape.periodic:
        return np.zeros((len(loading.free), 0))
    moves = np.broadcast_to(np.eye(3)[:, None, None], (3, shape.nodes_y, shape.nodes_x, 3))
    whole = np.asarray(Configuration(moves, np.zeros((3, shape.lengths))).flattened())
    return np.linalg.qr(whole[:, loading.free].T)[0]
