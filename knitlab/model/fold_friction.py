"""Friction of the yarn at folds: beside its spring, every hinge has one that sticks and slips.

The second is elastic up to its yield moment, which grows by the angle slipped, and then slips. A
step of a test minimises an incremental potential; then the slip is updated (return mapping: Simo,
Hughes, Computational Inelasticity, Ch. 1). The paper has no friction.
"""

from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from knitlab.model.settings import Friction

Each = Float[Array | np.ndarray, "*element"]  # of every hinge


class FoldFriction(eqx.Module):
    """The friction elements of hinges, in parallel with their springs."""

    stiffness: Each  # before it slips [N mm]
    moment: Each  # at which it slips [N mm]
    slope: Each  # while it slips [N mm]
    slip: Each  # fold angle from rest without moment [rad]

    @classmethod
    def begun(cls, friction: Friction, fold_stiffness: Each, angle: Each) -> "FoldFriction | None":
        """The elements of hinges, without moment at these angles from rest; None if no friction."""
        if not friction.fold_friction:
            return None
        k_t = np.asarray(fold_stiffness)
        stiffness = k_t * friction.fold_friction / friction.fold_slide
        hardening = k_t * friction.fold_hardening
        slope = np.zeros_like(k_t)
        np.divide(stiffness * hardening, stiffness + hardening, out=slope, where=stiffness > 0)
        return cls(stiffness, k_t * friction.fold_friction, slope, np.asarray(angle))

    def _sticking(self, angle: Each) -> tuple[Each, Each]:
        """The elastic angle up to the yield moment, and what is beyond [rad]."""
        turned = angle - self.slip
        turned = turned - 2 * np.pi * jnp.round(turned / (2 * np.pi))
        limit = self.moment / jnp.where(self.stiffness > 0, self.stiffness, 1.0)
        elastic = jnp.clip(turned, -limit, limit)
        return elastic, turned - elastic

    def stored(self, angle: Each) -> Each:
        """Potential of a step to fold angles from rest: elastic energy and work to slip [N mm]."""
        elastic, beyond = self._sticking(angle)
        energy = 0.5 * self.stiffness * elastic**2 + self.moment * jnp.abs(beyond)
        return energy + 0.5 * self.slope * beyond**2

    def moments(self, angle: Each) -> Each:
        """Moments at fold angles from rest, the derivative of :meth:`stored` [N mm]."""
        elastic, beyond = self._sticking(angle)
        return self.stiffness * elastic + self.slope * beyond

    def slipped(self, angle: Each) -> "FoldFriction":
        """The elements after a step that ended at these fold angles from rest."""
        moments = np.asarray(self.moments(angle))
        stiff = np.asarray(self.stiffness) > 0
        elastic = np.divide(moments, self.stiffness, out=np.zeros_like(moments), where=stiff)
        yields = np.maximum(self.moment, np.abs(moments))
        return replace(self, moment=yields, slip=np.where(stiff, angle - elastic, self.slip))
