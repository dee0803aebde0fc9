"""What a test combines, so that each feature can say what it cannot be combined with.

The rules of a feature stand beside it, as a function of a :class:`Combination`; :data:`RULES` lists
them by the setting that a message names.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from knitlab.model.fold_friction import Friction
from knitlab.model.settings import Boundary, ModelOptions
from knitlab.solvers.dynamics.settings import Dynamics, contact_conflicts
from knitlab.solvers.equilibrium.drag import drag_conflicts
from knitlab.solvers.equilibrium.friction import friction_conflicts
from knitlab.solvers.equilibrium.settings import Solver
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


def load_conflicts(combination: Combination) -> Iterator[str]:
    """What the load cannot be combined with."""
    return combination.load.conflicts(combination)


def cycle_conflicts(combination: Combination) -> Iterator[str]:
    """What a later cycle cannot be combined with: the same as friction."""
    return friction_conflicts(combination) if combination.cycle > 1 else iter(())


def fold_friction_conflicts(combination: Combination) -> Iterator[str]:
    """What friction at the folds cannot be combined with."""
    return friction_conflicts(combination) if combination.friction.fold_friction else iter(())


def fold_drift_conflicts(combination: Combination) -> Iterator[str]:
    """What drift of the rest angles cannot be combined with: the same."""
    return friction_conflicts(combination) if combination.friction.fold_drift else iter(())


RULES: dict[str, Callable[[Combination], Iterator[str]]] = {
    "solver.drag": drag_conflicts,
    "model.contact": contact_conflicts,
    "protocol.load": load_conflicts,
    "protocol.cycle": cycle_conflicts,
    "friction.fold_friction": fold_friction_conflicts,
    "friction.fold_drift": fold_drift_conflicts,
}
"""What each feature refuses, with a remedy, by the setting that a message names."""
