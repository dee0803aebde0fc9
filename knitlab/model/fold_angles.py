"""Fold angles of the hinges of a fabric, in any of its states."""

import numpy as np
from jaxtyping import Float

from knitlab.model.energy import folds_from_rest
from knitlab.model.fabric import Configuration, Fabric
from knitlab.model.network import Network


def fold_angles(
    net: Network, fabric: Fabric, configuration: Configuration
) -> Float[np.ndarray, "*state hinge"]:
    """Signed fold angle of every hinge, on the branch nearest its rest angle [rad].

    Flat is 0, a mountain fold positive. Beyond ±π, where cells have passed through each other, the
    angle, like the energy, continues smoothly.
    """
    positions, lengths = np.asarray(configuration.positions), np.asarray(configuration.lengths)
    states, rest = lengths.shape[:-1], np.asarray(fabric.rest_fold)
    angles = np.empty((*states, len(rest)))
    for state in np.ndindex(*states):
        one = Configuration(positions[state], lengths[state])
        angles[state] = rest + folds_from_rest(net, fabric, one)
    return angles
