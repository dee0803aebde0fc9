"""Newton steps that foresee which nodes will touch the walls.

In a Newton step the energy with walls is piecewise quadratic: the factorised stiffness has a wall
only for nodes that touch it now. The minimum is found by active sets. Nodes that the step would
bring to a wall are added to the factorised stiffness, and those that it would take off one are
removed, by a low-rank update, until the step agrees with the nodes that it assumes to touch.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from knitlab.solvers.equilibrium_search import Search
from knitlab.solvers.solver import ChangeDiagonal, Solve, Solver

MOST_CHANGES = 50
"""Nodes that come to a wall, or leave it, above which their update would cost too much."""
MOST_ROUNDS = 10
"""Largest number of active sets for one step."""


@dataclass(frozen=True, eq=False)
class WallStep:
    """A step.

    Attributes:
        step: the change of the free unknowns [mm].
        curvature: second derivative of the energy along it, with the walls touched now [N mm].
    """

    step: Float[np.ndarray, " free"]
    curvature: float


def step_between_walls(search: Search) -> Solver[WallStep]:
    """The step from the configuration of the last factorisation to the minimum between the walls.

    If the step is longer than the step limit, the nodes that touch after the allowed part count.
    If many nodes come to a wall or leave one, they are ignored; then a factorisation of the next
    configuration is cheaper. Otherwise the factorised stiffness keeps the changes.

    Args:
        search: the search, in the configuration whose stiffness is factorised.
    """
    rules, heights, z_max = search.rules, search.rules.free.heights, search.rules.walls.z_max
    stiffness = rules.walls.stiffness * float(search.at.stage.wall)
    z, gradient = search.at.unknowns[search.places[heights]], search.gradient
    touching = assumed = np.abs(z) > z_max
    step = without_changes = yield Solve(-gradient)
    curvature = -float(gradient @ step)
    for _ in range(MOST_ROUNDS):
        end = z + min(1.0, rules.longest_part(step)) * step[heights]
        found = np.abs(end) > z_max
        if (found == assumed).all():
            break
        assumed = found
        changed = np.flatnonzero(found != touching)
        places, change = heights[changed], np.where(found[changed], stiffness, -stiffness)
        few = len(changed) <= MOST_CHANGES
        if not (few and (yield ChangeDiagonal(places, change))):
            yield ChangeDiagonal(places[:0], change[:0])
            return WallStep(without_changes, -float(gradient @ without_changes))
        # A wall also pushes nodes by their distance to it before the step.
        wall = np.copysign(z_max, np.where(found, end, z)[changed])
        pushed = gradient.copy()
        pushed[places] += change * (z[changed] - wall)
        step = yield Solve(-pushed)
        curvature = -float(pushed @ step) - float(change @ step[places] ** 2)
    return WallStep(step, curvature)
