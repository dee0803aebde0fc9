"""Newton steps that predict which nodes will touch the walls.

In a Newton step the energy with walls is piecewise quadratic: the factorised stiffness has a wall
only for nodes that touch it now. The minimum is found by active sets. Nodes that the step would
bring to a wall are added to the factorised stiffness, and those that it would take off one are
removed, by a low-rank update, until the step agrees with the nodes that it assumes to touch.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from knitlab.equilibrium.equilibrium_search import Search

MOST_CHANGES = 50
"""Nodes that come to a wall, or leave it, above which their update would cost too much."""
MOST_ACTIVE_SETS = 10
"""Largest number of active sets that are tried for one step."""


@dataclass(frozen=True, eq=False)
class WallStep:
    """A step.

    Attributes:
        step: the change of the free unknowns [mm].
        curvature: second derivative of the energy along it, with the walls touched now [N mm].
    """

    step: Float[np.ndarray, " free"]
    curvature: float


def step_between_walls(search: Search) -> WallStep:
    """The step from the configuration of the last factorisation to the minimum between the walls.

    If the step is longer than the step limit, the nodes that touch after the allowed part count;
    contact of the fabric with itself, which may shorten it further, is ignored. If many nodes come
    to a wall or leave one, or the active sets do not settle, it is the Newton step with the walls
    that are touched now: then a factorisation of the next configuration is cheaper. Otherwise the
    factorised stiffness keeps the changes.

    Args:
        search: the search, in the configuration whose stiffness is factorised.
    """
    system, rules = search.system, search.rules
    heights, z_max = rules.free.heights, rules.walls.z_max
    stiffness = rules.walls.stiffness * float(search.at.stage.wall)
    z, gradient = search.at.unknowns[search.places[heights]], search.gradient
    touching = active = np.abs(z) > z_max
    step = newton = system.solve(-gradient)
    curvature = of_newton = -float(gradient @ newton)
    for _ in range(MOST_ACTIVE_SETS):
        end = z + min(1.0, rules.longest_part(step)) * step[heights]
        active_after = np.abs(end) > z_max
        if (active_after == active).all():
            return WallStep(step, curvature)
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
    return WallStep(newton, of_newton)
