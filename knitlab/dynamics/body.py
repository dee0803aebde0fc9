"""A fabric that moves: what makes it move, its motion, and energies and forces at one time."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from knitlab.dynamics.grid import GridFabric, Shape
from knitlab.fabric.energy import Energy


class Body(eqx.Module):
    """A fabric with what makes it move."""

    fabric: GridFabric
    # 1/m of the nodes, 0 for held ones, which keep their velocity [1/g]
    inverse_mass: Float[Array, "row column"]
    inverse_mass_of_lengths: Float[Array, "2"]  # the same for L_x and L_y; 0 for a sample
    damping: Float[Array, ""]  # c of a node [g/ms]
    nodes_of_lengths: Float[Array, "2"]  # that L_x and L_y move

    @property
    def inverse(self) -> Shape:
        """1/m of every coordinate and of the lengths [1/g]."""
        return Shape((self.inverse_mass,) * 3, self.inverse_mass_of_lengths)

    @property
    def damping_rate(self) -> Shape:
        """c/m of every coordinate and of the lengths [1/ms]."""
        rate = self.damping * self.inverse_mass
        of_lengths = self.damping * self.nodes_of_lengths * self.inverse_mass_of_lengths
        return Shape((rate,) * 3, of_lengths)


class Motion(eqx.Module):
    """Configuration and velocity of a fabric, or of a batch, and the work done so far."""

    shape: Shape  # [mm]
    velocity: Shape  # [mm/ms]
    dissipated: Float[Array, "*batch"]  # work done against the drag [N mm]
    supplied: Float[Array, "*batch"]  # work done on what is held [N mm]

    @classmethod
    def at_rest(cls, shape: Shape) -> "Motion":
        """The beginning of a motion without velocity."""
        return cls(shape, jax.tree.map(jnp.zeros_like, shape), jnp.zeros(()), jnp.zeros(()))


class Observed(eqx.Module):
    """What is computed of a motion at one time."""

    energy: Energy  # elastic [N mm]
    kinetic: Float[Array, ""]  # of what is free [N mm]
    gradient: Shape  # of the energy, minus the elastic force [N]
    force: Float[Array, ""]  # largest elastic force on a free node or length [N]
    drag: Float[Array, ""]  # largest drag on one [N]


def observed(body: Body, motion: Motion) -> Observed:
    """Energies and forces of a motion."""
    gradient, velocity = body.fabric.gradient(motion.shape), motion.velocity
    inverse, inverse_of_lengths = body.inverse_mass, body.inverse_mass_of_lengths

    def largest(vector: Shape, of_lengths: Float[Array, "2"] | float) -> Float[Array, ""]:
        lengths = jnp.abs(vector.lengths * of_lengths)
        return jnp.maximum(
            jnp.sqrt(jnp.max(jnp.where(inverse > 0, _squares(vector), 0.0))),
            jnp.max(jnp.where(inverse_of_lengths > 0, lengths, 0.0)),
        )

    def mass(inverse: Array) -> Array:
        return jnp.where(inverse > 0, 1 / jnp.where(inverse > 0, inverse, 1.0), 0.0)

    of_nodes = jnp.sum(mass(inverse) * _squares(velocity))
    return Observed(
        energy=body.fabric.energy(motion.shape),
        kinetic=0.5 * (of_nodes + jnp.sum(mass(inverse_of_lengths) * velocity.lengths**2)),
        gradient=gradient,
        force=largest(gradient, 1.0),
        drag=body.damping * largest(velocity, body.nodes_of_lengths),
    )


def driving_power(body: Body, gradient: Shape, velocity: Shape) -> Float[Array, ""]:
    """Power of the forces that move the top row, or L_y of periodic fabric, if held [N mm/ms]."""
    if body.fabric.periodic:
        held = body.inverse_mass_of_lengths[1] == 0
        return jnp.where(held, gradient.lengths[1] * velocity.lengths[1], 0.0)
    held = jnp.broadcast_to(body.inverse_mass, gradient.positions[1].shape)[-1] == 0
    return jnp.sum(jnp.where(held, gradient.positions[1][-1] * velocity.positions[1][-1], 0.0))


def loss(body: Body, velocity: Shape) -> Float[Array, ""]:
    """Power of the drag, Σ c u̇² over what is free [N mm/ms]."""
    lengths = jnp.where(body.inverse_mass_of_lengths > 0, body.nodes_of_lengths, 0.0)
    return body.damping * (
        jnp.sum(jnp.where(body.inverse_mass > 0, _squares(velocity), 0.0))
        + jnp.sum(lengths * velocity.lengths**2)
    )


def _squares(vector: Shape) -> Float[Array, "row column"]:
    """Squared length of the vector of every node."""
    x, y, z = vector.positions
    return x**2 + y**2 + z**2
