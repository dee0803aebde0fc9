"""What a test combines, so that each feature can say what it cannot be combined with.

The rules of a feature stand beside it, as a function of a :class:`Combination`; :data:`RULES` lists
them by the setting that a message names.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

from knitlab.model.settings import Boundary, Friction, ModelOptions
from knitlab.solvers.dynamics.settings import Dynamics, contact_conflicts
from knitlab.solvers.equilibrium.friction import friction_conflicts
from knitlab.solvers.equilibrium.settings import Solver, drag_conflicts
from knitlab.solvers.loads.load import Load


@dataclass(frozen=True)
class Combination:
    """The settings of a workflow's tests, as far as features depend on each other."""

    boundaries: tuple[Boundary, ...]
    method: str
    options: ModelOptions
    solver: Solver
    dynamics: Dynamics
    friction: Friction
    load: Load
    strain_max: float
    cycle: int
    robustness: int
    sensitivities: bool
    electrodes: bool


class Rule(NamedTuple):
    """What a feature refuses, with a remedy, if it is used; a message names its setting."""

    setting: str
    conflicts: Callable[[Combination], Iterator[str]]
    is_used: Callable[[Combination], bool] = lambda combination: True


RULES = (
    Rule("solver.drag", drag_conflicts),
    Rule("model.contact", contact_conflicts),
    Rule("protocol.load", lambda combination: combination.load.conflicts(combination)),
    # The same for whatever makes loading and unloading differ.
    Rule("protocol.cycle", friction_conflicts, lambda combination: combination.cycle > 1),
    Rule("friction.fold_friction", friction_conflicts, lambda c: c.friction.fold_friction > 0),
    Rule("friction.fold_drift", friction_conflicts, lambda c: c.friction.fold_drift > 0),
)
"""The rules, in the order in which they are checked."""
