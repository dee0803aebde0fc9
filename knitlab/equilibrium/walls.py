"""Steps of a search between the walls, whose penalty is known along the step."""

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float
from scipy.optimize import brentq

if TYPE_CHECKING:
    from knitlab.equilibrium.search import Search

MOST_CHANGES = 50
"""Nodes that come to a wall, or leave it, above which their update would cost too much."""
MOST_ACTIVE_SETS = 10


def step_between_walls(search: "Search") -> tuple[Float[np.ndarray, " free"], float]:
    """The step from the last factorised configuration to the minimum between the walls [mm].

    In a Newton step the energy with walls is piecewise quadratic. The minimum is found by active
    sets: nodes that the step would bring to a wall are added to the factorised stiffness, and those
    that it would take off one are removed, by a low-rank update, until the step agrees with them.
    Of a longer step than the step limit the allowed part counts; contact of the fabric with itself
    is ignored.

    If many nodes come to a wall or leave one, or the active sets do not settle, it is the Newton
    step with the walls touched now: then a factorisation of the next configuration is cheaper.
    Otherwise the factorised stiffness keeps the changes. Also returns the second derivative of the
    energy along the step, with the walls touched now [N mm].
    """
    system, z_max, heights = search.system, search.z_max, search.rules.free.heights
    z, gradient, stiffness = search.heights, search.gradient, search.wall_stiffness
    touching = active = np.abs(z) > z_max
    step = newton = system.solve(-gradient)
    curvature = of_newton = -float(gradient @ newton)
    for _ in range(MOST_ACTIVE_SETS):
        end = z + min(1.0, search.longest_fraction(step)) * step[heights]
        active_after = np.abs(end) > z_max
        if (active_after == active).all():
            return step, curvature
        active = active_after
        changed = np.flatnonzero(active != touching)
        places, change = heights[changed], np.where(active[changed], stiffness, -stiffness)
        few = len(changed) <= MOST_CHANGES
        if not (few and system.change_diagonal(places, change)):
            break
        # An added wall pushes from z_max on rather than from z, and a removed one no longer.
        wall = np.copysign(z_max, np.where(active, end, z)[changed])
        modified = gradient.copy()
        modified[places] += change * (z[changed] - wall)
        step = system.solve(-modified)
        curvature = -float(modified @ step) - float(change @ step[places] ** 2)
    system.change_diagonal(heights[:0], np.zeros(0))
    return newton, of_newton


def lowest_fraction(
    heights: Float[np.ndarray, " node"],
    rise: Float[np.ndarray, " node"],
    slope: float,
    curvature: float,
    z_max: float,
    stiffness: float,
) -> float:
    """Fraction of a step with the least energy between the walls, at most 1.

    A quadratic model of the energy, with a negative ``slope`` and a ``curvature`` with the walls
    that are touched now [N mm], holds only until further nodes touch a wall. The wall penalty is
    known exactly, so that it replaces its part of the model. ``heights`` rise by ``rise`` [mm].
    """
    touching = np.maximum(np.abs(heights), np.abs(heights + rise)) > z_max
    z, dz = heights[touching], rise[touching]

    def pushed(fraction: float) -> float:
        height = z + fraction * dz
        return stiffness * float((height - np.clip(height, -z_max, z_max)) @ dz)

    now = np.abs(z) > z_max
    first, second = pushed(0.0), stiffness * float(dz[now] @ dz[now])

    def derivative(fraction: float) -> float:
        return slope + fraction * (curvature - second) + pushed(fraction) - first

    if derivative(1.0) <= 0:
        return 1.0
    return float(brentq(derivative, 0.0, 1.0, xtol=1e-12, rtol=1e-3))
