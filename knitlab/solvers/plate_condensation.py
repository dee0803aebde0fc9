"""Second derivatives of the energy of one periodic state by mean strain and curvature, condensed.

The mean deformation of a sheet has six components: the Green-Lagrange strain (xx, yy, 2 xy) of its
reference plane, and the curvature (xx, yy, 2 xy), positive where the upper side gets longer as in
laminates: a point at the height z above the plane has the strain E + z κ. Both refer to the state,
not to the flat sheet. A node at ξ = (x, y) from an element's middle moves to

    in the plane  ξ + (E − E²/2) ξ + z (κ ξ − E κ ξ) − (κξ·ξ) κξ / 6
    upwards       z − (κξ·ξ) / 2 − z |κξ|² / 2

which to second order is a sheet of uniform metric I + 2E and curvature κ, and every node turns with
it. Where the curvature has one direction this is a cylinder, exactly, and neighbouring unit cells
are images of each other by screw motions. Forces in the state therefore count: the second-order
terms times the forces are those of prestress. The nodes of one unit cell, the same in its images,
then relax: they are condensed out with the stiffness of the periodic fabric.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from knitlab.model.energy import hinge_energy, spring_energy, wall_energy
from knitlab.model.fabric import Configuration, Fabric
from knitlab.model.network import UPRIGHT, Elements, MeshShape, network
from knitlab.model.settings import FoldAngle
from knitlab.solvers.equilibrium.adjoint import LinearResponse, NoDerivative
from knitlab.solvers.equilibrium.system import one_thread_of_blas

CHUNK = 1024  # elements in a chunk: one compiled program serves all mesh shapes
MAX_UNBALANCED = 1e-4  # largest force on a node, over the largest of an element, in equilibrium
MIN_STIFFNESS = 1e-8  # smallest eigenvalue of a stiff sheet, over its largest membrane stiffness


class PlateStatus(IntEnum):
    """Whether a state has a stiffness; in the first three it is known."""

    ok = 0
    singular = 1  # some strain or curvature costs no energy
    negative = 2  # some strain or curvature releases energy
    unstable = 3  # the unit cell is no stable equilibrium
    not_converged = 4
    no_shape = 5  # no periodic shape is kept, or the design is not selected
    plies_touch = 6  # with a stiffness of contact, which plates leave out


@dataclass(frozen=True)
class Plate:
    """Stiffness of a periodic state per area of it, and its forces, in N and mm.

    The order is xx, yy, 2 xy of strain, then of curvature: ``stiffness`` is [A B; Bᵀ D].
    """

    status: PlateStatus
    stiffness: Float[np.ndarray, "6 6"]
    forces: Float[np.ndarray, "6"]  # membrane forces and moments in the state
    height: float  # of the reference plane, the mean of all nodes

    @classmethod
    def unknown(cls, status: PlateStatus, height: float = np.nan) -> "Plate":
        """A plate without numbers."""
        return cls(status, np.full((6, 6), np.nan), np.full(6, np.nan), height)


class PlateSolver:
    """The plates of states of periodic fabrics of one mesh shape."""

    def __init__(self, shape: MeshShape, sheared: bool = False) -> None:
        # States have their courses along x, in whichever direction they were pulled.
        self._shape = replace(shape, frame=UPRIGHT if sheared else None)
        self._response = LinearResponse(self._shape, np.arange(3 * shape.nodes))

    def response(
        self, fabric: Fabric, state: Configuration
    ) -> tuple[Plate, Float[np.ndarray, "6 node_y node_x 3"]]:
        """Plate of one state, and moves of its nodes by strain and curvature; NaN if unknown."""
        unmoved = np.full((6, *np.shape(state.positions)), np.nan)
        height = float(np.mean(state.positions[..., 2]))
        forces, stiffness, mixed, unbalanced = _derivatives(self._shape, fabric, state, height)
        area = float(np.prod(state.lengths[:2]))
        if not unbalanced < MAX_UNBALANCED:
            return Plate.unknown(PlateStatus.not_converged, height), unmoved
        try:
            with one_thread_of_blas():
                response = self._response.at(fabric, np.asarray(state.flattened()))
                held = len(state.lengths)
                relaxing = response.to(np.pad(mixed, ((0, 0), (0, held))))[:, :-held]
        except NoDerivative:
            return Plate.unknown(PlateStatus.unstable, height), unmoved
        condensed = (stiffness - mixed @ relaxing.T) / area
        condensed = (condensed + condensed.T) / 2
        plate = Plate(judged(condensed), condensed, forces / area, height)
        return plate, -relaxing.reshape(unmoved.shape)


def judged(stiffness: Float[np.ndarray, "6 6"]) -> PlateStatus:
    """Whether a stiffness is positive definite, in a unit of length in which A is like D."""
    membrane, bending = np.diag(stiffness).reshape(2, 3).max(axis=1)
    thickness = np.sqrt(bending / membrane) if min(bending, membrane) > 0 else 1.0
    scale = np.repeat([1, 1 / thickness], 3)
    lowest = np.linalg.eigvalsh(scale[:, None] * stiffness * scale)[0]
    if lowest > MIN_STIFFNESS * membrane:
        return PlateStatus.ok
    return PlateStatus.singular if lowest >= -MIN_STIFFNESS * membrane else PlateStatus.negative


def _derivatives(
    shape: MeshShape, fabric: Fabric, state: Configuration, height: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Gradient, Hessian and mixed Hessian by nodes, and the largest force on a node, relative."""
    net = network(shape)
    gradient = np.zeros(6)
    hessian = np.zeros((6, 6))
    by_nodes = np.zeros((3 * shape.nodes, 6))
    on_nodes = np.zeros(3 * shape.nodes)
    scale = float(np.max(fabric.stretch_stiffness * fabric.rest_length))
    largest = 1e-6 * scale  # that of a small strain, where elements carry no force
    springs = (fabric.rest_length, fabric.stretch_stiffness, fabric.spring_law)
    hinges = (fabric.rest_fold, fabric.fold_stiffness)
    for elements, numbers, of in (
        (net.springs, springs, None),
        (net.hinges, hinges, fabric.fold_angle),
    ):
        count = len(elements.nodes)
        for start in range(0, count, CHUNK):
            lanes = np.arange(start, start + CHUNK)
            chosen = np.minimum(lanes, count - 1)  # the last chunk is filled, without stiffness
            rest, stiffness, *law = jax.tree.map(lambda each, own=chosen: each[own], numbers)
            of_chunk = (rest, stiffness * (lanes < count).astype(float), *law)
            at = _relative(elements, state, chosen, height)
            parts = _by_deformation(of, tuple(elements.ends), at, of_chunk)
            (first, force), (second, mixed) = jax.tree.map(np.asarray, parts)
            gradient += first
            hessian += second
            # (node, component, element) of the unknowns, in the order of the derivatives.
            dofs = 3 * elements.nodes[chosen].T[:, None] + np.arange(3)[:, None]
            np.add.at(on_nodes, dofs, force)
            np.add.at(by_nodes, dofs, mixed)
            largest = max(largest, float(np.abs(force).max()))
    by_nodes[2::3] -= by_nodes[2::3].mean(axis=0)  # the plane stays at the mean height
    z = jnp.asarray(state.positions[..., 2]).ravel()
    on_nodes[2::3] += jax.grad(lambda at: wall_energy(at, fabric.z_max, fabric.k_wall).sum())(z)
    # Round-off where there is no force could not be solved to a small relative residual.
    by_nodes[np.abs(by_nodes) < 1e-13 * scale] = 0
    return gradient, hessian, by_nodes.T, float(np.abs(on_nodes).max() / largest)


def _relative(
    elements: Elements, state: Configuration, chosen: Int[np.ndarray, " lane"], height: float
) -> Float[np.ndarray, "node 3 lane"]:
    """Nodes of elements in the endless sheet, from the middle of their first two, and the plane."""
    nodes = state.positions.reshape(-1, 3)[elements.nodes[chosen]]
    length_x, length_y, *shear = state.lengths
    lattice = np.array([[length_x, 0], [shear[0] if shear else 0, length_y]])
    nodes[..., :2] += elements.images[chosen] @ lattice
    middle = nodes[:, :2].mean(axis=1)
    middle[:, 2] = height
    return np.ascontiguousarray((nodes - middle[:, None]).transpose(1, 2, 0))


def deformed(
    deformation: Float[Array, "6"], at: Float[Array, "node 3 lane"], moved: Float[Array, "..."]
) -> Float[Array, "node 3 lane"]:
    """Nodes after a mean deformation, and after moves that turn with the sheet, to second order."""
    strain, curvature = (
        jnp.stack([jnp.stack([xx, xy / 2]), jnp.stack([xy / 2, yy])])
        for xx, yy, xy in deformation.reshape(2, 3)
    )
    plane = at[:, :2]
    z = at[:, 2]
    times = partial(jnp.einsum, "ij,njl->nil")
    slope = times(curvature, plane)  # the sheet falls by this per length
    drop = (slope * plane).sum(1)
    shift = times(strain - strain @ strain / 2, plane) - drop[:, None] * slope / 6
    shift += z[:, None] * (slope - times(strain, slope)) + moved[:, 2:] * slope
    up = -drop / 2 - z * (slope**2).sum(1) / 2 - (slope * moved[:, :2]).sum(1)
    return at + moved + jnp.concatenate([shift, up[:, None]], axis=1)


@partial(jax.jit, static_argnums=(0, 1))
def _by_deformation(
    of: FoldAngle | None,
    ends: tuple[tuple[int, int], ...],
    at: Float[Array, "node 3 lane"],
    numbers: tuple[Any, ...],
) -> Any:
    """Gradient of an energy of hinges ``of`` a kind, or of springs, and its derivative."""
    of_vectors: Callable[..., Any] = spring_energy if of is None else partial(hinge_energy, of=of)

    def total(deformation: Float[Array, "6"], moved: Float[Array, "node 3 lane"]) -> Array:
        nodes = deformed(deformation, at, moved)
        vectors = jnp.stack([nodes[end] - nodes[start] for start, end in ends])
        return of_vectors(vectors, *numbers).sum()

    def gradient(deformation: Float[Array, "6"]) -> tuple[Array, Array]:
        return jax.grad(total, (0, 1))(deformation, jnp.zeros(at.shape))

    return gradient(jnp.zeros(6)), jax.jacfwd(gradient)(jnp.zeros(6))
