"""Local strain from the corners of unit cells (paper, Sec. "Kinematics under tension")."""

import jax.numpy as jnp
from jaxtyping import Array, Float

import knitlab.model  # noqa: F401  # so that JAX is in float64 here too
from knitlab.measure.central import central

CornerGrid = Float[Array, "*state cell_y+1 cell_x+1 2"]
CellTensor = Float[Array, "*state cell_y cell_x 2 2"]


def lattice_vectors(corners: CornerGrid) -> CellTensor:
    """Lattice vectors of every unit cell, as the columns (v1, v2) of a matrix [mm].

    A cell's quadrilateral is taken for a parallelogram: v1 is the mean of its lower and upper
    edge, v2 of its left and right edge (paper, Fig. "lattice vectors").

    Args:
        corners: positions (x, y) of the corners of the unit cells.
    """
    along_x = jnp.diff(corners, axis=-2)
    along_y = jnp.diff(corners, axis=-3)
    v1 = (along_x[..., :-1, :, :] + along_x[..., 1:, :, :]) / 2
    v2 = (along_y[..., :, :-1, :] + along_y[..., :, 1:, :]) / 2
    return jnp.stack([v1, v2], axis=-1)


def deformation_gradient(reference: CellTensor, current: CellTensor) -> CellTensor:
    """F of every unit cell, from (w1 w2) = F (v1 v2) [1].

    Args:
        reference: lattice vectors of the relaxed shape, v.
        current: lattice vectors of the deformed shape, w.
    """
    transposed = jnp.linalg.solve(jnp.matrix_transpose(reference), jnp.matrix_transpose(current))
    return jnp.matrix_transpose(transposed)


def local_strain(
    reference: CornerGrid, current: CornerGrid
) -> tuple[Float[Array, "*state cell_y cell_x"], Float[Array, "*state cell_y cell_x"]]:
    """Local normal strains ε_xx = ∂u_x/∂X and ε_yy = ∂u_y/∂Y of every unit cell [1].

    Args:
        reference: corners of the relaxed shape [mm].
        current: corners of the deformed shape [mm]; leading axes are states.
    """
    gradient = deformation_gradient(lattice_vectors(reference), lattice_vectors(current))
    return gradient[..., 0, 0] - 1, gradient[..., 1, 1] - 1


def central_mean(
    strain: Float[Array, "*state cell_y cell_x"],
) -> Float[Array, "*state"]:
    """Mean over the central unit cells (paper, ε̄) [1]."""
    rows, columns = central(strain.shape[-2]), central(strain.shape[-1])
    return strain[..., rows, columns].mean(axis=(-2, -1))


def poisson_ratio(
    mean_strain_xx: Float[Array, "*state"], mean_strain_yy: Float[Array, "*state"]
) -> Float[Array, "*state"]:
    """ν = −ε̄_xx / ε̄_yy [1]; NaN where there is no axial strain."""
    stretched = mean_strain_yy != 0
    return jnp.where(stretched, -mean_strain_xx / jnp.where(stretched, mean_strain_yy, 1), jnp.nan)
