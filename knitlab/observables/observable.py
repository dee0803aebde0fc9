"""How observables declare themselves: name, dimensions, unit, meaning, and when a case has them.

An observable is a function of a :class:`~knitlab.observables.finished_test.FinishedTest`, decorated
with :func:`observable`. It returns the value of its one variable, or a dictionary of several.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
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
    """One variable, as a case holds it; a cube adds the dimensions of its designs.

    Attributes:
        dims: its dimensions.
        long_name: label for the axis of a figure.
        units: in UDUNITS notation.
        description: what the label leaves open.
        in_cube: whether cubes hold it, besides case files.
        integer: whether it is stored as an integer.
        group: the cases that have it.
    """

    dims: tuple[str, ...]
    long_name: str
    units: str = "1"
    description: str = ""
    in_cube: bool = True
    integer: bool = False
    group: Group = ALL

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
    """A function of a finished test, and the variables that it gives.

    ``unrelaxed`` is True if it has values even where the fabric did not relax.
    """

    variables: dict[str, Variable]
    compute: "Compute"
    group: Group
    unrelaxed: bool

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
    """Register a function as the observable of some variables.

    Args:
        group: the cases that have it.
        unrelaxed: whether it has values even where the fabric did not relax.
        variables: what it returns: of one variable the value, of several a dictionary.
    """

    def registered(compute: "Compute") -> "Compute":
        of_group = REGISTRY.declare(group, variables)
        REGISTRY.observables.append(Observable(of_group, compute, group, unrelaxed))
        return compute

    return registered
