"""Newton steps that foresee which nodes will touch the walls.

The factorised stiffness has the walls only for nodes that touch them now. The energy with walls is
piecewise quadratic in a Newton step; its minimum is found by active sets: nodes that the step would
drive into a wall, or take off one, are added to the factorised stiffness or removed from it by a
low-rank update, until the step agrees with the nodes that it assumes to touch.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from knitlab.solvers.equilibrium_search import Search
from knitlab.solvers.solver import ChangeDiagonal, Solve, Solver

MOST_CHANGES = 50
"""Number of nodes above which a new factorisation is cheaper than their update."""
ROUNDS = 10
"""Largest number of changes of the active set for one step."""


@dataclass(frozen=True, eq=False)
class WallStep:
    """A step.

    Attributes:
        direction: the step [mm].
        curvature: second derivative of the energy along it, for the walls touched now [N mm].
    """

    direction: Float[np.ndarray, " free"]
    curvature: float


def between_walls(search: Search) -> Solver[WallStep]:
    """The Newton step from the current configuration to the minimum between the walls.

    If too many nodes come into or out of touch, it is that without further contact.
    """
    rules, gradient, heights = search.rules, search.gradient, search.rules.free.heights
    stiffness = rules.walls.stiffness * float(search.at.stage.wall)
    z, z_max = search.at.unknowns[search.places[heights]], rules.walls.z_max
    touching = np.abs(z) > z_max
    assumed, side = touching, np.sign(z)
    changed, signs = np.flatnonzero(touching[:0]), np.zeros(0)
    pushed, plain = gradient, (yield Solve(-gradient))
    step = plain
    for _ in range(ROUNDS):
        end = z + step[heights] * min(1.0, rules.longest_part(step))
        found = np.abs(end) > z_max
        side = np.where(found, np.sign(end), side)
        if (found == assumed).all():
            break
        assumed = found
        changed = np.flatnonzero(assumed != touching)
        signs = np.where(assumed[changed], stiffness, -stiffness)
        few = len(changed) <= MOST_CHANGES
        if not few or not (yield ChangeDiagonal(heights[changed], signs)):
            yield ChangeDiagonal(heights[:0], signs[:0])
            return WallStep(plain, -float(gradient @ plain))
        pushed = gradient.copy()
        pushed[heights[changed]] += signs * (z - side * z_max)[changed]
        step = yield Solve(-pushed)
    rise = step[heights[changed]]
    return WallStep(step, -float(pushed @ step) - float(signs @ rise**2))
