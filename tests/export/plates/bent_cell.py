"""One unit cell of endless fabric, stretched and rolled up: its images are exact screw motions.

Independent of the plates of knitlab: no field of displacements is assumed, only that neighbouring
cells are images of each other by the isometries of a cylinder, and the cell then relaxes.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from knitlab.model.energy import hinge_energy, spring_energy, wall_energy
from knitlab.model.fabric import Configuration, Fabric
from knitlab.model.network import MeshShape, network


def matrix(components):
    xx, yy, xy = components
    return jnp.array([[xx, xy / 2], [xy / 2, yy]])


def square_root(a):
    """Of a symmetric positive definite 2 × 2 matrix, in closed form."""
    s = jnp.sqrt(jnp.linalg.det(a))
    return (a + s * jnp.eye(2)) / jnp.sqrt(jnp.trace(a) + 2 * s)


class BentCell:
    """The relaxed energy of a cell per area of a state, by strain and by rolling about one axis."""

    def __init__(self, shape: MeshShape, fabric: Fabric, state: Configuration) -> None:
        net, self.fabric = network(shape), fabric
        hinges = partial(hinge_energy, of=fabric.fold_angle)
        self._elements = [
            (net.springs, (fabric.rest_length, fabric.stretch_stiffness), spring_energy),
            (net.hinges, (fabric.rest_fold, fabric.fold_stiffness), hinges),
        ]
        length_x, length_y, *shear = np.asarray(state.lengths)
        self.lattice = np.array([[length_x, 0], [sum(shear), length_y]])
        nodes = np.asarray(state.positions).reshape(-1, 3).copy()
        self.plane = nodes[:, 2].mean()
        nodes[:, 2] -= self.plane
        self.start = nodes.ravel()
        self._gradient = jax.jit(jax.grad(self.energy))
        self._energy = jax.jit(self.energy)
        flat = jnp.zeros(3), jnp.array([1.0, 0.0]), 0.0
        hessian = jax.jit(jax.hessian(self.energy))(self.start, *flat)
        # Translations cost nothing.
        self._flexibility = np.linalg.pinv(hessian, rcond=1e-10, hermitian=True)

    def energy(self, nodes, strain, direction, curvature):
        """Energy over area of one cell whose nodes (arc, along the axis, height) have images.

        The curvature, of an upper side that gets longer, is that times direction ⊗ direction. The
        cylinder is through the mean height of all nodes, and the walls are rolled up with it.
        """
        nodes = nodes.reshape(-1, 3)
        stretch = square_root(jnp.eye(2) + 2 * matrix(strain))
        inverse = jnp.linalg.solve(stretch, direction)
        size = jnp.linalg.norm(inverse)
        across = inverse / size  # in the plane, across the axis of the cylinder
        along = jnp.array([-across[1], across[0]])
        bend = curvature * size**2  # in space; the axis is at the height -1 / bend
        total = 0.0
        for elements, numbers, of in self._elements:
            at = nodes[elements.nodes] - jnp.array([0, 0, nodes[:, 2].mean()])
            plane = at[..., :2] + elements.images @ self.lattice @ stretch.T
            arc, height = plane @ across, at[..., 2]
            # (1 / bend + height) × (sin, cos) of the angle, without a division by bend.
            u = arc * jnp.sinc(bend * arc / np.pi) + height * jnp.sin(bend * arc)
            sag = bend * (arc * jnp.sinc(bend * arc / 2 / np.pi)) ** 2 / 2
            z = height * jnp.cos(bend * arc) - sag
            moved = u * across[:, None, None] + (plane @ along) * along[:, None, None]
            moved = jnp.concatenate([moved, z[None]])
            vectors = jnp.stack(
                [moved[..., end] - moved[..., start] for start, end in elements.ends]
            )
            total += of(vectors, *numbers).sum()
        fabric, heights = self.fabric, nodes[:, 2] + self.plane
        total += wall_energy(heights, fabric.z_max, fabric.k_wall).sum()
        return total / np.linalg.det(self.lattice)

    def relaxed(self, strain, direction, curvature):
        """The energy of the relaxed cell, from the state, with the stiffness of the state."""
        given = jnp.asarray(strain), jnp.asarray(direction), jnp.asarray(curvature)
        nodes = self.start
        for _ in range(60):
            gradient = np.asarray(self._gradient(nodes, *given))
            if np.abs(gradient).max() < 1e-14:
                return float(self._energy(nodes, *given))
            nodes = nodes - self._flexibility @ gradient
        raise AssertionError(f"not relaxed: {np.abs(gradient).max():g}")
