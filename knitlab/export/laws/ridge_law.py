"""An energy density as a sum of ridges: convex functions of one combination of strains each.

ψ(E) = Σ_j w_j [φ(d_j·E − o_j) − φ(−o_j) − φ'(−o_j) d_j·E], where φ is a smooth ramp,
φ' = (x + √(x² + s²)) / 2, and every w_j ≥ 0. Each ridge is convex and is at rest without strain, so
that ψ has a positive semidefinite tangent everywhere, whatever the weights. Where the fabric is its
own mirror image, every ridge has a twin for the opposite shear.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from knitlab.export.laws.strain_tests import Strain, Stress

MIRROR = np.array([1.0, 1.0, -1.0])  # of strains, in a line along the courses or the wales


def ramp(x: np.ndarray, width: float) -> np.ndarray:
    """φ, whose derivative grows from 0 to x within a width about 0."""
    root = np.sqrt(x**2 + width**2)
    return (x**2 + x * root + width**2 * np.arcsinh(x / width)) / 4


def ramp_slope(x: np.ndarray, width: float) -> np.ndarray:
    """φ'."""
    return (x + np.sqrt(x**2 + width**2)) / 2


def ramp_curvature(x: np.ndarray, width: float) -> np.ndarray:
    """φ'', between 0 and 1."""
    return (1 + x / np.sqrt(x**2 + width**2)) / 2


@dataclass(frozen=True, eq=False)
class Ridges:
    """Ridges in the space of strains, each of weight 1."""

    directions: Float[np.ndarray, "ridge 3"]
    offsets: Float[np.ndarray, " ridge"]
    width: float

    def energies(self, strain: Strain) -> Float[np.ndarray, "*state ridge"]:
        """Energy of every ridge."""
        along = strain @ self.directions.T
        at_rest = ramp(-self.offsets, self.width)
        slope = ramp_slope(-self.offsets, self.width)
        return ramp(along - self.offsets, self.width) - at_rest - slope * along

    def slopes(self, strain: Strain) -> Float[np.ndarray, "*state ridge"]:
        """Derivative of the energy of every ridge along its direction."""
        along = strain @ self.directions.T
        at_rest = ramp_slope(-self.offsets, self.width)
        return ramp_slope(along - self.offsets, self.width) - at_rest

    def curvatures(self, strain: Strain) -> Float[np.ndarray, "*state ridge"]:
        """Second derivative of the energy of every ridge along its direction."""
        return ramp_curvature(strain @ self.directions.T - self.offsets, self.width)

    def stresses(self, strain: Strain) -> Float[np.ndarray, "*state 3 ridge"]:
        """Stress of every ridge."""
        return self.slopes(strain)[..., None, :] * self.directions.T

    def tangents(self, strain: Strain) -> Float[np.ndarray, "*state 3 3 ridge"]:
        """Tangent of every ridge."""
        products = np.einsum("ja,jb->abj", self.directions, self.directions)
        return self.curvatures(strain)[..., None, None, :] * products

    def mirrored(self) -> "Ridges":
        """Their twins for the opposite shear."""
        return Ridges(self.directions * MIRROR, self.offsets, self.width)


@dataclass(frozen=True, eq=False)
class RidgeLaw:
    """Weighted ridges: energy, stress and tangent of a membrane, at any strains at once."""

    ridges: Ridges
    weights: Float[np.ndarray, " ridge"]  # [N/mm]

    def energy(self, strain: Strain) -> Float[np.ndarray, "*state"]:
        """Energy over the relaxed area [N/mm]."""
        return self.ridges.energies(strain) @ self.weights

    def stress(self, strain: Strain) -> Stress:
        """Its first derivative by the strain, (S_xx, S_yy, S_xy) [N/mm]."""
        return (self.ridges.slopes(strain) * self.weights) @ self.ridges.directions

    def tangent(self, strain: Strain) -> Float[np.ndarray, "*state 3 3"]:
        """Its second derivative by the strain [N/mm]."""
        stiffness = self.ridges.curvatures(strain) * self.weights
        directions = self.ridges.directions
        return np.einsum("...j,ja,jb->...ab", stiffness, directions, directions)
