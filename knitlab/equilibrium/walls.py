"""How far a step of a search may go between the walls, whose penalty is known along the step."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.optimize import brentq

from knitlab.fabric.fabric import Fabric

ACCURACY = 1e-3
"""Relative accuracy of the length of a step."""


@dataclass(frozen=True)
class Walls:
    """The two walls that a fabric lies between.

    Attributes:
        z_max: half the gap between them [mm].
        stiffness: their stiffness [N/mm].
    """

    z_max: float
    stiffness: float

    @classmethod
    def of(cls, fabric: Fabric) -> "Walls":
        """The walls of a fabric."""
        return cls(float(fabric.z_max), float(fabric.k_wall))

    def lowest(
        self,
        heights: Float[np.ndarray, " node"],
        rise: Float[np.ndarray, " node"],
        slope: float,
        curvature: float,
        part: float = 1.0,
    ) -> float:
        """Fraction of a step with the least energy, at most 1.

        A quadratic model of the energy holds only until further nodes touch a wall. The wall
        penalty is known exactly, so that it replaces its part of the model.

        Args:
            heights: heights of the nodes [mm].
            rise: their changes in the step [mm].
            slope: first derivative of the energy along the step, negative [N mm].
            curvature: second derivative of the energy along the step, the walls that are touched
                now included [N mm].
            part: fraction of the stiffness of the walls.
        """
        deepest = np.maximum(np.abs(heights), np.abs(heights + rise))
        touching = deepest > self.z_max
        z, dz, stiffness = heights[touching], rise[touching], part * self.stiffness

        def pushed(fraction: float) -> float:
            return stiffness * float(self._depth(z + fraction * dz) @ dz)

        now = np.abs(z) > self.z_max
        first, second = pushed(0.0), stiffness * float(dz[now] @ dz[now])

        def derivative(fraction: float) -> float:
            model = slope + fraction * (curvature - second)
            return model + pushed(fraction) - first

        if derivative(1.0) <= 0:
            return 1.0
        return float(brentq(derivative, 0.0, 1.0, xtol=1e-12, rtol=ACCURACY))

    def _depth(self, z: Float[np.ndarray, " node"]) -> Float[np.ndarray, " node"]:
        """Signed depth by which nodes penetrate a wall [mm]."""
        return z - np.clip(z, -self.z_max, self.z_max)
