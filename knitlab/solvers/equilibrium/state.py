"""Results of a solver: states, how far they are from equilibrium, and tests made of them."""

from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from jaxtyping import Float

from knitlab.model.energy import Energy
from knitlab.model.fabric import Configuration, Unknowns
from knitlab.model.network import MeshShape
from knitlab.solvers.loads.loading import Loading, along_courses


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
    """A configuration and its distance from equilibrium."""

    shape: MeshShape
    unknowns: Unknowns  # the configuration, flattened [mm]
    energy: Energy
    gradient: Unknowns  # the negative force, on held ones too [N]
    outcome: Outcome
    residual: float  # largest force on a free unknown [N]
    iterations: int  # rejected ones too; time steps for dynamics
    factorisations: int = 0
    kinetic_peak: float = 0.0  # since the previous state; 0 except for dynamics [N mm]
    snapped: bool = False  # since the previous state

    @property
    def configuration(self) -> Configuration:
        """The configuration of the fabric, its courses along x."""
        return along_courses(self.shape, Configuration.of(self.unknowns, self.shape))

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
    """History of a relaxation by dynamics."""

    time: Float[np.ndarray, " time"]  # of the energies, from 0 [ms]
    kinetic: Float[np.ndarray, " time"]  # [N mm]
    potential: Float[np.ndarray, " time"]  # [N mm]
    dissipated: Float[np.ndarray, " time"]  # work done against the drag [N mm]
    snapshot_time: Float[np.ndarray, " snapshot"]  # [ms]
    snapshots: Configuration  # along a leading axis
    force_left: float  # largest force on a node, over that on the flat sheet


@dataclass(frozen=True)
class TensileTest:
    """States along a tensile test, by either method."""

    loading: Loading | None  # None if the fabric did not relax
    states: list[State]  # by applied strain; only the last may be unconverged
    history: History | None = None  # of a relaxation by dynamics
    unloaded: tuple[State, ...] = ()  # at the same strains, back from the last but one
    relaxed: State | None = None  # before the first cycle, if the states are of a later one
    held: State | None = None  # at the largest strain, after rest angles have drifted
