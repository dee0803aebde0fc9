"""Configurations: the shape of a fabric, as the positions of its nodes and the sides of its cell.

Solvers use one vector of unknowns instead. Only this module defines their order: the
coordinates (x, y, z) of every node, row by row from the bottom left, then the two sides.
"""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from knitlab.fabric.array_library import array_library
from knitlab.fabric.network import MeshShape


class Configuration(eqx.Module):
    """The shape of a fabric in one state, or in several along leading axes; a pytree.

    With JAX arrays, functions of the shape can be differentiated; NumPy arrays need no compilation.
    A velocity, or a gradient with respect to the shape, is also a ``Configuration``.

    Attributes:
        positions: (x, y, z) of every node, x along the courses and y along the wales; row 0 is the
            bottom course, column 0 the left wale [mm].
        lengths: sides L_x and L_y of the cell of periodic fabric. For a sample with open edges they
            are not used, and usually are its flat size [mm].
    """

    positions: Float[Array | np.ndarray, "*state node_y node_x 3"]
    lengths: Float[Array | np.ndarray, "*state 2"]

    @classmethod
    def of(
        cls, unknowns: Float[Array | np.ndarray, "*state unknown"], shape: MeshShape
    ) -> "Configuration":
        """The configuration that a vector of unknowns holds; the inverse of :meth:`flattened`."""
        grid = *unknowns.shape[:-1], shape.nodes_y, shape.nodes_x, 3
        return cls(unknowns[..., :-2].reshape(grid), unknowns[..., -2:])

    @classmethod
    def stacked(cls, states: Sequence["Configuration"]) -> "Configuration":
        """Configurations of one mesh shape as the states of one configuration, in NumPy."""
        return cls(
            np.stack([np.asarray(state.positions) for state in states]),
            np.stack([np.asarray(state.lengths) for state in states]),
        )

    def flattened(self) -> Float[Array | np.ndarray, "*state unknown"]:
        """The vector of unknowns: coordinates node by node, then L_x and L_y [mm]."""
        library = array_library(self.positions)
        coordinates = self.positions.reshape(*self.lengths.shape[:-1], -1)
        return library.concatenate([coordinates, self.lengths], axis=-1)

    def __getitem__(self, state: Any) -> "Configuration":
        """One or some of several states: the index applies to the leading axis."""
        return Configuration(self.positions[state], self.lengths[state])
