"""The fabric: the parameters of all elements of a network, from which its energy follows."""

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from knitlab.fabric.array_library import array_library
from knitlab.fabric.configuration import Configuration
from knitlab.fabric.network import Network
from knitlab.fabric.settings import FoldAngle
from knitlab.fabric.spring_law import LINEAR, SpringLaw


class Fabric(eqx.Module):
    """Parameters of one fabric on a network.

    Fabrics with the same mesh shape, kind of fold angle and kind of spring law can be stacked into
    a batch.

    Attributes:
        rest_length: of every spring [mm].
        stretch_stiffness: of every spring [N/mm].
        rest_fold: signed rest angle of every hinge, 0 where flat, positive for a mountain [rad].
        fold_stiffness: of every hinge, 0 where the model options omit the hinge [N mm].
        z_max: half the gap between the walls [mm].
        k_wall: penalty stiffness of the walls [N/mm].
        cell_x: flat width of every column of grid cells [mm].
        cell_y: flat height of every row of grid cells [mm].
        fold_angle: definition of the fold angle, a model option.
        spring_law: force of the springs as a function of their length.
    """

    rest_length: Float[Array | np.ndarray, " spring"]
    stretch_stiffness: Float[Array | np.ndarray, " spring"]
    rest_fold: Float[Array | np.ndarray, " hinge"]
    fold_stiffness: Float[Array | np.ndarray, " hinge"]
    z_max: Float[Array | np.ndarray, ""]
    k_wall: Float[Array | np.ndarray, ""]
    cell_x: Float[Array | np.ndarray, " grid_x"]
    cell_y: Float[Array | np.ndarray, " grid_y"]
    fold_angle: FoldAngle = eqx.field(static=True)
    spring_law: SpringLaw = LINEAR

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
