"""Friction of the yarn at folds: beside its spring, every hinge has one that sticks and slips.

The second is elastic up to its yield moment, which grows by the angle slipped, and then slips. A
step of a test minimises an incremental potential; then the slip is updated (return mapping: Simo,
Hughes, Computational Inelasticity, Ch. 1). The paper has no friction.
"""

from dataclasses import dataclass, replace
from typing import Annotated

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from pydantic import Field, PositiveFloat

from knitlab.model.checked import Checked
from knitlab.model.settings import Unit

NotNegative = Annotated[float, Field(ge=0)]
Each = Float[Array | np.ndarray, "*element"]  # of every hinge


@dataclass(frozen=True)
class Friction(Checked):
    """Friction at the folds, relative to the stiffness k_t of each, and drift of their rest angles.

    Attributes:
        fold_friction: yield moment over k_t: the angle by which friction can shift the rest angle;
            0 for no friction [rad].
        fold_slide: angle over which friction builds up from none, half of what a fold turns back
            before it slips the other way; small against the angles of the test [rad].
        fold_hardening: growth of the yield moment with the angle slipped, over k_t [1].
        fold_drift: what a rest angle takes on of the change of its fold in the first cycle, at the
            largest strain; 1/c of that in cycle c, so that the set grows with its logarithm [1].
    """

    fold_friction: Annotated[float, Field(ge=0), Unit("rad")] = 0.0
    fold_slide: Annotated[PositiveFloat, Unit("rad")] = 0.05
    fold_hardening: NotNegative = 0.0
    fold_drift: NotNegative = 0.0

    @property
    def acts(self) -> bool:
        """Whether friction or drift makes loading and unloading differ."""
        return self.fold_friction > 0 or self.fold_drift > 0

    def begun(self, fold_stiffness: Each, angle: Each) -> "FoldFriction | None":
        """The friction elements of hinges, without moment at these angles from rest; or None."""
        if not self.fold_friction:
            return None
        k_t = np.asarray(fold_stiffness)
        stiffness = k_t * self.fold_friction / self.fold_slide
        hardening = k_t * self.fold_hardening
        slope = np.zeros_like(k_t)
        np.divide(stiffness * hardening, stiffness + hardening, out=slope, where=stiffness > 0)
        return FoldFriction(stiffness, k_t * self.fold_friction, slope, np.asarray(angle))


NO_FRICTION = Friction()


class FoldFriction(eqx.Module):
    """The friction elements of hinges, in parallel with their springs."""

    stiffness: Each  # before it slips [N mm]
    moment: Each  # at which it slips [N mm]
    slope: Each  # while it slips [N mm]
    slip: Each  # fold angle from rest without moment [rad]

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
