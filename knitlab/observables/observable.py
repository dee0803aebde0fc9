"""How observables declare themselves: name, dimensions, unit, meaning, and when a case has them.

An observable is a function of a :class:`~knitlab.observables.finished_test.FinishedTest`, decorated
with :func:`observable`.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import wraps
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # which import JAX, and a query reads declarations only
    from knitlab.observables.finished_test import FinishedTest
    from knitlab.solvers.case import Case

    Compute = Callable[[FinishedTest], Any]


@dataclass(frozen=True)
class Group:
    """Cases that have the same further variables; without ``has``, no case file holds them."""

    name: str
    title: str
    has: "Callable[[Case], bool] | None" = None


ALL = Group("all", "Every case", lambda case: True)


@dataclass(frozen=True)
class Variable:
    """One variable, as a case holds it; a cube adds the dimensions of its designs."""

    dims: tuple[str, ...]
    long_name: str  # label for the axis of a figure
    units: str = "1"  # in UDUNITS notation
    description: str = ""  # what the label leaves open
    in_cube: bool = True  # whether cubes hold it, besides case files
    integer: bool = False  # whether it is stored as an integer
    group: Group = ALL  # the cases that have it

    @property
    def attributes(self) -> dict[str, str]:
        """Its CF attributes."""
        described = {"description": self.description} if self.description else {}
        return {"units": self.units, "long_name": self.long_name, **described}


def _shape(*dims: str, in_cube: bool = True) -> Callable[..., Variable]:
    def variable(long_name: str, units: str = "1", **more: Any) -> Variable:
        return Variable(dims, long_name, units, **{"in_cube": in_cube, **more})

    return variable


number = _shape()
curve = _shape("applied_strain")
derivative = _shape("applied_strain", "stripe_parameter")
cells = _shape("applied_strain", "cell_y", "cell_x")
boundary = _shape("boundary_point")
nodes = _shape("applied_strain", "node_y", "node_x", "component")
motion = _shape("time", in_cube=False)
snapshot = _shape("snapshot", in_cube=False)
snapshot_nodes = _shape("snapshot", "node_y", "node_x", "component", in_cube=False)


@dataclass(frozen=True)
class Observable:
    """A function of a finished test, and the variables that it gives."""

    variables: dict[str, Variable]
    compute: "Compute"
    group: Group
    unrelaxed: bool  # whether it has values even where the fabric did not relax

    def values(self, test: "FinishedTest") -> dict[str, Any]:
        """Its values, by the names of its variables; empty if this test has none."""
        if not (self.unrelaxed or test.relaxed_at_all):
            return {}
        values = self.compute(test)
        return values if isinstance(values, dict) else {next(iter(self.variables)): values}


@dataclass
class Registry:
    """All observables, and all variables of cases and cubes by name."""

    observables: list[Observable] = field(default_factory=list)
    variables: dict[str, Variable] = field(default_factory=dict)

    def declare(self, group: Group, variables: dict[str, Variable]) -> dict[str, Variable]:
        """Add variables of a group; ValueError if one is declared twice."""
        if twice := variables.keys() & self.variables:
            raise ValueError(f"{sorted(twice)} are declared twice")
        of_group = {
            name: Variable(**{**variable.__dict__, "group": group})
            for name, variable in variables.items()
        }
        self.variables |= of_group
        return of_group


REGISTRY = Registry()


def observable(
    group: Group = ALL, *, unrelaxed: bool = False, **variables: Variable
) -> "Callable[[Compute], Compute]":
    """Register a function as the observable of some variables of a group of cases.

    It returns the value of its one variable, or a dictionary of several. With ``unrelaxed`` it has
    values even where the fabric did not relax.
    """

    def registered(compute: "Compute") -> "Compute":
        @wraps(compute)
        def once(test: "FinishedTest") -> Any:
            if compute not in test.computed:
                test.computed[compute] = compute(test)
            return test.computed[compute]

        of_group = REGISTRY.declare(group, variables)
        REGISTRY.observables.append(Observable(of_group, once, group, unrelaxed))
        return once

    return registered
