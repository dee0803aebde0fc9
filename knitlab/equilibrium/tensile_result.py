"""Result of a tensile test, by either method: its states, and the history of its relaxation."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from knitlab.equilibrium.loading import Loading
from knitlab.equilibrium.state import State
from knitlab.fabric.configuration import Configuration


@dataclass(frozen=True)
class History:
    """History of a relaxation by dynamics.

    Attributes:
        time: times of the energies, from 0 [ms].
        kinetic: T [N mm].
        potential: V [N mm].
        dissipated: work done against the drag since time 0 [N mm].
        snapshot_time: times of the snapshots [ms].
        snapshots: configurations at these times, along a leading axis.
        force_left: largest force on a node at the end, over that on the flat sheet [1].
    """

    time: Float[np.ndarray, " time"]
    kinetic: Float[np.ndarray, " time"]
    potential: Float[np.ndarray, " time"]
    dissipated: Float[np.ndarray, " time"]
    snapshot_time: Float[np.ndarray, " snapshot"]
    snapshots: Configuration
    force_left: float


@dataclass(frozen=True)
class TensileTest:
    """States along a tensile test.

    Attributes:
        loading: held and driven unknowns; ``None`` if the fabric did not relax.
        states: one state for each applied strain that was tried, the relaxed shape first; only the
            last may be unconverged, and then the test ended there.
        history: history of the relaxation, for dynamics.
        unloaded: states of unloading, if requested: at the same strains, from the last but one down
            to 0, as far as they were reached.
    """

    loading: Loading | None
    states: list[State]
    history: History | None = None
    unloaded: tuple[State, ...] = ()
