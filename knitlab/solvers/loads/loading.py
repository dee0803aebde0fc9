"""The test of one relaxed shape under a load: what is held, what moves, and the reaction force."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from jaxtyping import Array, Float, Int

from knitlab.model.fabric import Configuration
from knitlab.model.network import MeshShape
from knitlab.solvers.loads import WARP
from knitlab.solvers.loads.load import Load, in_direction, stretch_along


@dataclass(frozen=True, eq=False)
class Loading:
    """A displacement-controlled test, from a relaxed configuration."""

    shape: MeshShape
    load: Load
    free: Int[np.ndarray, " free"]  # indices of the free unknowns
    reference: Float[np.ndarray, " unknown"]  # the relaxed configuration, flattened [mm]
    # per unit of strain: prescribed if held, else of an affine stretch [mm]
    drive: Float[np.ndarray, " unknown"]
    length: float  # that the applied strain refers to [mm]

    @cached_property
    def held(self) -> Int[np.ndarray, " held"]:
        """Indices of the held unknowns, L_x and L_y of an open sample among them."""
        return held_under(self.shape, self.load)

    def holding(
        self, unknowns: Float[np.ndarray, " unknown"], applied_strain: float
    ) -> Float[np.ndarray, " unknown"]:
        """The unknowns, with the held ones set as the applied strain prescribes [mm]."""
        held, moved = self.held, unknowns.copy()
        moved[held] = self.reference[held] + applied_strain * self.drive[held]
        return moved

    def ahead(
        self, passed: Sequence[tuple[float, Float[np.ndarray, " unknown"]]], applied_strain: float
    ) -> Float[np.ndarray, " unknown"]:
        """Polynomial extrapolation of states passed, or an affine stretch of only one [mm]."""
        strain, last = passed[-1]
        if len(passed) == 1:
            return self.holding(last + (applied_strain - strain) * self.drive, applied_strain)
        extrapolated = np.zeros_like(last)
        for own, unknowns in passed:
            others = [other for other, _ in passed if other != own]
            extrapolated += unknowns * math.prod(
                (applied_strain - other) / (own - other) for other in others
            )
        return self.holding(extrapolated, applied_strain)

    def reaction_force(self, gradient: Float[np.ndarray, " unknown"]) -> float:
        """Work of the test per strain, over its length: of a pull, the force on an end [N].

        That is Σ of forces on the moved clamp, or ∂V/∂L of periodic fabric. Of an off-axis load it
        acts on √((L_x sin α)² + (L_y cos α)²), the width of a unit cell across the pull.
        """
        return float(reaction_force(self.shape, self.drive, self.length, gradient, self.load))

    def force_along(self, axis: int, gradient: Float[np.ndarray, " unknown"]) -> float:
        """Force on the end of the fabric along x (0) or y (1), under a biaxial load [N]."""
        relaxed = Configuration.of(self.reference, self.shape)
        moved, grown, length = stretch_along(self.shape, relaxed, axis)
        drive = np.asarray(in_direction(axis, moved, np.eye(2)[axis] * grown).flattened())
        return float(drive[self.held] @ gradient[self.held] / length)


def all_free(shape: MeshShape) -> Int[np.ndarray, " free"]:
    """Free unknowns while a fabric relaxes: every coordinate, and the lengths if periodic."""
    nodes = np.repeat(shape.nodes_of_fabric.ravel(), 3)
    return np.append(
        np.flatnonzero(nodes),
        np.arange(3 * shape.nodes, shape.unknowns if shape.periodic else 3 * shape.nodes),
    )


def free_under(shape: MeshShape, load: Load = WARP) -> Int[np.ndarray, " free"]:
    """Free unknowns of a test: all but the prescribed lengths if periodic, else those not held."""
    free = np.ones(shape.unknowns, bool)
    if shape.periodic:
        free[3 * shape.nodes + np.array(load.prescribed)] = False
    else:
        coordinates = load.free_coordinates(shape) & shape.nodes_of_fabric[..., None]
        free[: 3 * shape.nodes] = coordinates.ravel()
        free[3 * shape.nodes :] = False
    return np.flatnonzero(free)


@lru_cache(maxsize=16)
def held_under(shape: MeshShape, load: Load = WARP) -> Int[np.ndarray, " held"]:
    """Held unknowns of a test, the lengths of an open sample among them."""
    return np.setdiff1d(np.arange(shape.unknowns), free_under(shape, load))


def reaction_force(
    shape: MeshShape,
    drive: Float[Array | np.ndarray, " unknown"],
    length: Float[Array | np.ndarray, ""] | float,
    gradient: Float[Array | np.ndarray, " unknown"],
    load: Load = WARP,
) -> Float[Array, ""]:
    """See :meth:`Loading.reaction_force`; for JAX and NumPy arrays [N]."""
    held = held_under(shape, load)
    return drive[held] @ gradient[held] / length


def loading_of(shape: MeshShape, relaxed: Configuration, load: Load = WARP) -> Loading:
    """The test of a relaxed shape under a load, in the axes of the load."""
    shape, relaxed = load.in_its_axes(shape, relaxed)
    drive, length = load.drive(shape, relaxed)
    reference = np.asarray(relaxed.flattened())
    return Loading(
        shape, load, free_under(shape, load), reference, np.asarray(drive), float(length)
    )


def along_courses(shape: MeshShape, state: Configuration) -> Configuration:
    """A state of fabric with a frame, turned so that courses lie along x; lengths in mm."""
    if shape.frame is None:
        return state
    (q, e, s), frame = np.asarray(state.lengths), np.array(shape.frame)
    courses, wales = (np.array([[q, s], [0.0, e]]) @ frame).T
    x = courses / np.linalg.norm(courses)
    turn = np.array([x, [-x[1], x[0]]])
    nodes, wales = np.asarray(state.positions), turn @ wales
    turned = np.concatenate([nodes[..., :2] @ turn.T, nodes[..., 2:]], axis=-1)
    return Configuration(turned, np.array([np.linalg.norm(courses), wales[1], wales[0]]))
