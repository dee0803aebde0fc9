"""Drag during one strain step: the paper's damping without inertia, c u̇ + ∇V = 0."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Int

from knitlab.model.energy import Evaluation
from knitlab.model.fabric import Unknowns


@dataclass(frozen=True, eq=False)
class Drag:
    """Drag on the way from a state, by implicit Euler.

    The state after a strain step Δε at a strain rate ε̇ minimises V(u) + ½ (c ε̇ / Δε) ‖u −
    u_before‖² over the free unknowns.
    """

    before: Unknowns  # unknowns before the step [mm]
    stiffness: float  # c ε̇ / Δε [N/mm]
    free: Int[np.ndarray, " free"]  # indices of the free unknowns

    def added(self, evaluation: Evaluation, unknowns: Unknowns) -> Evaluation:
        """An evaluation with energy and gradient of the drag added."""
        moved = unknowns[self.free] - self.before[self.free]
        gradient: Any = np.array(evaluation.gradient)
        gradient[self.free] += self.stiffness * moved
        potential = 0.5 * self.stiffness * float(moved @ moved)
        return Evaluation(replace(evaluation.energy, drag=potential), gradient)
