"""What a solver found: states, how far they are from equilibrium, and tests made of them."""

from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from jaxtyping import Float

from knitlab.equilibrium.loading import Loading
from knitlab.fabric.configuration import Configuration
from knitlab.fabric.energy import Energy
from knitlab.fabric.network import MeshShape


class Outcome(IntEnum):
    """How the search for one state ended."""

    converged = 0
    iteration_limit = 1
    stalled = 2
    time_limit = 3
    diverged = 4
    left_branch = 5


@dataclass(frozen=True)
class State:
    """A configuration and its distance from equilibrium.

    Attributes:
        unknowns: its configuration, flattened [mm].
        gradient: the negative force on every unknown, including held ones [N].
        residual: largest residual force on a free unknown [N].
        iterations: steps tried, including rejected ones; time steps for dynamics.
        kinetic_peak: largest kinetic energy since the previous state; 0 except for dynamics [N mm].
        snapped: whether the fabric is known to have snapped since the previous state.
    """

    shape: MeshShape
    unknowns: Float[np.ndarray, " unknown"]
    energy: Energy
    gradient: Float[np.ndarray, " unknown"]
    outcome: Outcome
    residual: float
    iterations: int
    factorisations: int = 0
    kinetic_peak: float = 0.0
    snapped: bool = False

    @property
    def configuration(self) -> Configuration:
        """The configuration of the fabric."""
        return Configuration.of(self.unknowns, self.shape)

    @property
    def converged(self) -> bool:
        """Whether the state is in equilibrium to tolerance."""
        return self.outcome is Outcome.converged

    def after(self, *earlier: "State") -> "State":
        """This state, with the iterations of earlier searches added."""
        return replace(
            self,
            iterations=self.iterations + sum(state.iterations for state in earlier),
            factorisations=self.factorisations + sum(state.factorisations for state in earlier),
        )


@dataclass(frozen=True)
class History:
    """History of a relaxation by dynamics.

    Attributes:
        time: times of the energies, from 0 [ms].
        kinetic, potential: T and V [N mm].
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
    """States along a tensile test, by either method.

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
