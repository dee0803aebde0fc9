"""Folds: the angles of the hinges of a configuration, and the number beyond ±π."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from knitlab.model.configuration import Configuration
from knitlab.model.energy import element_vectors
from knitlab.model.fabric import Fabric
from knitlab.model.fold_angle import fold_from_rest
from knitlab.model.network import Network


@partial(jax.jit, static_argnums=0)
def fold_angles(
    net: Network, fabric: Fabric, configuration: Configuration
) -> Float[Array, "*state hinge"]:
    """Signed fold angle of every hinge, on the branch nearest its rest angle [rad].

    Flat is 0 and a mountain fold is positive. Beyond ±π the two cells have passed through each
    other; the angle, like the energy, continues smoothly.
    """

    def angles(
        positions: Float[Array, "node_y node_x 3"], lengths: Float[Array, "2"]
    ) -> Float[Array, " hinge"]:
        vectors = element_vectors(net.hinges, Configuration(positions, lengths))
        from_rest = fold_from_rest(vectors, fabric.rest_fold, fabric.fold_angle)
        return fabric.rest_fold + from_rest

    return jnp.vectorize(angles, signature="(y,x,c),(l)->(h)")(
        configuration.positions, configuration.lengths
    )


def hinges_past_pi(
    net: Network, fabric: Fabric, configuration: Configuration
) -> Int[np.ndarray, "*state"]:
    """Number of hinges folded beyond ±π, where the fabric passes through itself [1].

    Hinges without stiffness are not counted. The paper's model has no contact between layers that
    would prevent it.
    """
    past = np.abs(fold_angles(net, fabric, configuration)) > np.pi
    return (past & (np.asarray(fabric.fold_stiffness) > 0)).sum(axis=-1)
