"""State: a configuration that a solver found, and how far it is from equilibrium."""

from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from jaxtyping import Float

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
        shape: mesh shape of the fabric.
        unknowns: its configuration, flattened [mm].
        energy: the parts of its energy [N mm].
        gradient: the negative force on every unknown, including held ones [N].
        outcome: how the search ended.
        residual: largest residual force on a free unknown [N].
        iterations: steps tried, including rejected ones; time steps for dynamics.
        factorisations: number of factorisations.
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
