"""The fabric: the parameters of all its elements, and its shape as a configuration of its nodes."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from knitlab.model.array_library import array_library
from knitlab.model.fold_friction import FoldFriction
from knitlab.model.network import MeshShape, Network
from knitlab.model.settings import FoldAngle
from knitlab.model.spring_law import LINEAR, SpringLaw

Unknowns = Float[np.ndarray, " unknown"]  # a configuration, flattened [mm], or a gradient by it [N]


class Configuration(eqx.Module):
    """The shape of a fabric in one state, or in several along leading axes; a pytree.

    With JAX arrays, functions of the shape can be differentiated; NumPy arrays need no compilation.
    A velocity, or a gradient with respect to the shape, is also a ``Configuration``.
    Row 0 is the bottom course, column 0 the left wale.
    """

    # (x, y, z) of every node, x along the courses and y along the wales [mm]
    positions: Float[Array | np.ndarray, "*state node_y node_x 3"]
    # L_x and L_y of periodic fabric; unused in a sample, and usually its flat size [mm]. Of a
    # lattice that may shear there is a third: the shift along x of the upper end against the lower.
    lengths: Float[Array | np.ndarray, "*state length"]

    @classmethod
    def of(
        cls, unknowns: Float[Array | np.ndarray, "*state unknown"], shape: MeshShape
    ) -> "Configuration":
        """The configuration that a vector of unknowns holds, ordered as in :meth:`flattened`."""
        grid = *unknowns.shape[:-1], shape.nodes_y, shape.nodes_x, 3
        return cls(unknowns[..., : -shape.lengths].reshape(grid), unknowns[..., -shape.lengths :])

    @classmethod
    def stacked(cls, states: Sequence["Configuration"]) -> "Configuration":
        """Configurations of one mesh shape as the states of one configuration, in NumPy."""
        positions = np.stack([state.positions for state in states])
        return cls(positions, np.stack([state.lengths for state in states]))

    def flattened(self) -> Float[Array | np.ndarray, "*state unknown"]:
        """Unknowns as a vector: (x, y, z) by nodes from the bottom left, then L_x and L_y [mm]."""
        library = array_library(self.positions)
        coordinates = self.positions.reshape(*self.lengths.shape[:-1], -1)
        return library.concatenate([coordinates, self.lengths], axis=-1)

    def __getitem__(self, state: Any) -> "Configuration":
        """One or some of several states: the index applies to the leading axis."""
        return Configuration(self.positions[state], self.lengths[state])


class Fabric(eqx.Module):
    """Parameters of one fabric on a network; those of one shape, angle and law can be stacked."""

    rest_length: Float[Array | np.ndarray, " spring"]  # [mm]
    stretch_stiffness: Float[Array | np.ndarray, " spring"]  # [N/mm]
    rest_fold: Float[Array | np.ndarray, " hinge"]  # positive for a mountain [rad]
    fold_stiffness: Float[Array | np.ndarray, " hinge"]  # 0 where there is no hinge [N mm]
    z_max: Float[Array | np.ndarray, ""]  # half the gap between the walls [mm]
    k_wall: Float[Array | np.ndarray, ""]  # penalty stiffness of the walls [N/mm]
    cell_x: Float[Array | np.ndarray, " grid_x"]  # flat width of every column of grid cells [mm]
    cell_y: Float[Array | np.ndarray, " grid_y"]  # flat height of every row of grid cells [mm]
    fold_angle: FoldAngle = eqx.field(static=True)
    spring_law: SpringLaw = LINEAR
    friction: FoldFriction | None = None  # of hinges, during a test

    @property
    def cell_sides(self) -> Float[Array | np.ndarray, " side"]:
        """Sides of all grid cells, those along x first [mm]."""
        return array_library(self.cell_x).concatenate([self.cell_x, self.cell_y])


def flat_sheet(net: Network, fabric: Fabric) -> Configuration:
    """Flat configuration: nodes on the grid in the plane z = 0 [mm]."""
    xp = array_library(fabric.cell_x, fabric.cell_y)
    x, y = (
        xp.concatenate([np.zeros(1), xp.cumsum(side)]) for side in (fabric.cell_x, fabric.cell_y)
    )
    shape = net.shape
    grid = xp.stack(xp.meshgrid(x[: shape.nodes_x], y[: shape.nodes_y]), axis=-1)
    heights = np.zeros((*grid.shape[:-1], 1))
    return Configuration(xp.concatenate([grid, heights], axis=-1), xp.stack([x[-1], y[-1]]))
