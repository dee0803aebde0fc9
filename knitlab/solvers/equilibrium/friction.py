"""What friction at the folds (:mod:`knitlab.model.fold_friction`) cannot be combined with."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from knitlab.solvers.combination import Combination


def friction_conflicts(combination: "Combination") -> Iterator[str]:
    """What friction, and cycles in which it acts, cannot be combined with."""
    if combination.method == "dynamics":
        yield "needs equilibria; take method = equilibrium"
    if combination.sensitivities:
        yield "has no sensitivities; leave them out, or the friction"
    if combination.solver.drag > 0:
        yield "is not combined with drag; take drag = 0"
