"""Unit cells of a fabric, and the local strain between their corners (paper, "Kinematics").

Results from JAX arrays are differentiable; NumPy arrays need no compilation.
"""

import numpy as np
from jaxtyping import Array, Float

from knitlab.model.array_library import array_library
from knitlab.model.cell_grid import CellGrid, central, nodes_at
from knitlab.model.fabric import Configuration
from knitlab.model.network import MeshShape

CornerGrid = Float[Array | np.ndarray, "*state corner_y corner_x 2"]
ReferenceGrid = Float[Array | np.ndarray, "... corner_y corner_x 2"]
ReferenceTensor = Float[Array | np.ndarray, "... cell_y cell_x 2 2"]  # of one state or of each
CellTensor = Float[Array | np.ndarray, "*state cell_y cell_x 2 2"]
CellField = Float[Array | np.ndarray, "*state cell_y cell_x"]
Series = Float[Array | np.ndarray, "*state"]


def unit_cell_corners(
    shape: MeshShape, cells: CellGrid, configuration: Configuration
) -> CornerGrid:
    """Positions (x, y) of the corners of the unit cells, in one state or several [mm]."""
    return nodes_at(shape, configuration, np.array(cells.rows), np.array(cells.columns))[..., :2]


def lattice_vectors(corners: CornerGrid) -> CellTensor:
    """Lattice vectors of every unit cell, as the columns (v1, v2) of a matrix [mm].

    v1 is the mean of lower and upper edge, v2 of left and right (paper, Fig. "lattice vectors").
    """
    xp = array_library(corners)
    along_x = xp.diff(corners, axis=-2)
    along_y = xp.diff(corners, axis=-3)
    v1 = (along_x[..., :-1, :, :] + along_x[..., 1:, :, :]) / 2
    v2 = (along_y[..., :, :-1, :] + along_y[..., :, 1:, :]) / 2
    return xp.stack([v1, v2], axis=-1)


def deformation_gradient(reference: ReferenceTensor, current: CellTensor) -> CellTensor:
    """F of every unit cell, from lattice vectors (w1 w2) = F (v1 v2) [1]."""
    xp = array_library(current)
    transposed = xp.linalg.solve(xp.matrix_transpose(reference), xp.matrix_transpose(current))
    return xp.matrix_transpose(transposed)


def local_strain(reference: ReferenceGrid, current: CornerGrid) -> tuple[CellField, CellField]:
    """ε_xx = ∂u_x/∂X and ε_yy = ∂u_y/∂Y of every unit cell, from its relaxed reference [1]."""
    gradient = deformation_gradient(lattice_vectors(reference), lattice_vectors(current))
    return gradient[..., 0, 0] - 1, gradient[..., 1, 1] - 1


def strains_in_direction(gradient: CellTensor, angle: float) -> tuple[Series, Series]:
    """Mean strains across and along material lines at an angle to the courses [degree], of F [1].

    A line d is stretched by λ = |F d|, what is across it by det F / λ.
    """
    along = np.array([np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))])
    stretch = np.linalg.norm(gradient @ along, axis=-1)
    across = np.linalg.det(gradient) / stretch
    return central_mean(across - 1), central_mean(stretch - 1)


def central_mean(strain: CellField) -> Series:
    """Mean over the central unit cells (paper, ε̄), without those that lost a marker (NaN) [1]."""
    rows, columns = central(strain.shape[-2]), central(strain.shape[-1])
    middle = strain[..., rows, columns]
    xp = array_library(strain)
    known = xp.isfinite(middle)
    count = known.sum(axis=(-2, -1))
    total = xp.where(known, middle, 0.0).sum(axis=(-2, -1))
    return xp.where(count > 0, total / xp.where(count > 0, count, 1), xp.nan)


def mean_cell_size(corners: CornerGrid) -> tuple[Series, Series]:
    """Lengths of the lattice vectors v1 and v2, averaged over the central unit cells [mm]."""
    sides = array_library(corners).linalg.norm(lattice_vectors(corners), axis=-2)
    return central_mean(sides[..., 0]), central_mean(sides[..., 1])


def poisson_ratio(mean_strain_xx: Series, mean_strain_yy: Series) -> Series:
    """ν = −ε̄_xx / ε̄_yy, where yy is along the wales; NaN without that (paper, "Kinematics") [1]."""
    stretched = mean_strain_yy != 0
    xp = array_library(mean_strain_yy)
    return xp.where(stretched, -mean_strain_xx / xp.where(stretched, mean_strain_yy, 1), xp.nan)
