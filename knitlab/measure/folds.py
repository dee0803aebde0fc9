"""Folds: the angles of the hinges of a configuration, and the number beyond ±π."""

import numpy as np
from jaxtyping import Float, Int

from knitlab.fabric.configuration import Configuration
from knitlab.fabric.energy import element_vectors
from knitlab.fabric.fabric import Fabric
from knitlab.fabric.fold_angle import fold_and_slope
from knitlab.fabric.network import Network


def fold_angles(
    net: Network, fabric: Fabric, configuration: Configuration
) -> Float[np.ndarray, "*state hinge"]:
    """Signed fold angle of every hinge, on the branch nearest its rest angle [rad].

    Flat is 0 and a mountain fold is positive. Beyond ±π the two cells have passed through each
    other; the angle, like the energy, continues smoothly.
    """
    positions, lengths = np.asarray(configuration.positions), np.asarray(configuration.lengths)
    states, rest = lengths.shape[:-1], np.asarray(fabric.rest_fold)
    angles = np.empty((*states, len(rest)))
    for state in np.ndindex(*states):
        vectors = element_vectors(net.hinges, Configuration(positions[state], lengths[state]))
        angles[state] = rest + fold_and_slope(vectors, rest, fabric.fold_angle)[0]
    return angles


def hinges_past_pi(
    net: Network, fabric: Fabric, configuration: Configuration
) -> Int[np.ndarray, "*state"]:
    """Number of hinges folded beyond ±π, where the fabric passes through itself [1].

    Hinges without stiffness are not counted. The paper's model has no contact between layers that
    would prevent it.
    """
    past = np.abs(fold_angles(net, fabric, configuration)) > np.pi
    return (past & (np.asarray(fabric.fold_stiffness) > 0)).sum(axis=-1)
