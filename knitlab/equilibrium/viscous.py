"""Viscous strain steps: the paper's damping without inertia, c u̇ + ∇V = 0.

By implicit Euler, the state after a strain step Δε at a strain rate ε̇ is a minimum of the
incremental potential V(u) + ½ (c ε̇ / Δε) ‖u − u_before‖² over the free unknowns. So a viscous step
is an equilibrium with a stiffness added to the diagonal, which an equilibrium solver can find.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from knitlab.fabric.energy import Evaluation


@dataclass(frozen=True, eq=False)
class Drag:
    """Drag on the free unknowns during one strain step.

    Attributes:
        free: indices of the free unknowns.
        before: unknowns before the step [mm].
        stiffness: c ε̇ / Δε, damping of a node times strain rate over the step [N/mm].
    """

    free: Int[np.ndarray, " free"]
    before: Float[np.ndarray, " unknown"]
    stiffness: float

    def added(self, evaluation: Evaluation, unknowns: Float[np.ndarray, " unknown"]) -> Evaluation:
        """The evaluation of the incremental potential, given that of the elastic energy."""
        moved = unknowns[self.free] - self.before[self.free]
        gradient: Any = np.array(evaluation.gradient)
        gradient[self.free] += self.stiffness * moved
        potential = 0.5 * self.stiffness * float(moved @ moved)
        return Evaluation(replace(evaluation.energy, drag=potential), gradient)
