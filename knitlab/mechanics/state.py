"""States along a test, whichever method reached them."""

from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from jaxtyping import Float

from knitlab.mechanics.loading import Loading
from knitlab.model.configuration import Configuration
from knitlab.model.energy import Energy
from knitlab.model.network import MeshShape


class Outcome(IntEnum):
    """How the search for one state ended."""

    converged = 0
    iteration_limit = 1
    stalled = 2
    time_limit = 3
    diverged = 4
    too_fast = 5
    left_branch = 6


@dataclass(frozen=True)
class State:
    """A configuration and how near it is to equilibrium.

    Attributes:
        shape: mesh shape of the fabric.
        unknowns: its configuration, flattened [mm].
        energy: its parts there [N mm].
        gradient: minus the force on every unknown, held ones included [N].
        outcome: how the search ended.
        residual: largest force left on a free unknown [N].
        iterations: steps tried, rejected ones included; by dynamics, time steps.
        factorisations: factorisations they took.
        kinetic_peak: largest kinetic energy on the way here, 0 unless by dynamics [N mm].
        snapped: whether it is known that the fabric snapped on the way here.
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
        """What the solvers' unknowns make of the fabric."""
        return Configuration.of(self.unknowns, self.shape)

    @property
    def converged(self) -> bool:
        """Whether the state is in equilibrium to tolerance."""
        return self.outcome is Outcome.converged

    def after(self, *earlier: "State") -> "State":
        """This state, charged with the work of the searches that led to it."""
        return replace(
            self,
            iterations=self.iterations + sum(state.iterations for state in earlier),
            factorisations=self.factorisations + sum(state.factorisations for state in earlier),
        )


@dataclass(frozen=True)
class History:
    """How a fabric moved while it relaxed, by dynamics.

    Attributes:
        time: of the energies, from 0 to the last [ms].
        kinetic: T [N mm].
        potential: V [N mm].
        dissipated: work done against the drag since time 0 [N mm].
        snapshot_time: of the snapshots [ms].
        snapshots: configurations then, along a leading axis.
    """

    time: Float[np.ndarray, " time"]
    kinetic: Float[np.ndarray, " time"]
    potential: Float[np.ndarray, " time"]
    dissipated: Float[np.ndarray, " time"]
    snapshot_time: Float[np.ndarray, " snapshot"]
    snapshots: Configuration


@dataclass(frozen=True)
class TensileTest:
    """States along a tensile test.

    Attributes:
        loading: what was held and driven; ``None`` if the fabric did not relax.
        states: one for each applied strain that was tried, the relaxed shape first; only the
            last may be unconverged, and then the test ended there.
        history: of the relaxation, by dynamics.
        unloaded: states on the way back, if they were requested: at the same strains from the last
            but one down to 0, as far as they were reached.
    """

    loading: Loading | None
    states: list[State]
    history: History | None = None
    unloaded: tuple[State, ...] = ()
