"""Axes: settings that a workflow gives as a list, and that so become dimensions of its cube."""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from knitlab.io.variable import Variable
from knitlab.simulation.case import Label
from knitlab.simulation.stripe_changes import SHEET_QUANTITIES, STRIPE_QUANTITIES
from knitlab.study.parameters import Parameters
from knitlab.study.workflow import Workflow

SWEPT_SECTIONS = ("model", "solver", "dynamics", "electrodes")
"""Sections of which any setting may be a list."""
SAMPLE_SIZE = "unit_cells"
"""The setting of ``[design]`` that may be a list too, of pairs."""


@dataclass(frozen=True)
class SweepAxis:
    """One setting and the values that it takes.

    Attributes:
        section: the workflow's section that it stands in.
        name: its name, also that of the cube's dimension.
        values: its values.
    """

    section: str
    name: str
    values: tuple[Any, ...]

    @property
    def labels(self) -> tuple[Label, ...]:
        """Its values as labels; a sample of 5 by 3 unit cells is ``5x3``."""
        return tuple(
            "x".join(map(str, value)) if isinstance(value, tuple) else value
            for value in self.values
        )

    def coordinate(self, parameters: Parameters) -> Variable:
        """The cube's coordinate along it."""
        name, units, base = self.name, "1", self.name.removesuffix("_factor")
        words = base
        if base != name:
            return Variable((name,), units, f"factor on {base}")
        quantity = base.removeprefix("rib_").removeprefix("garter_")
        if base == SAMPLE_SIZE:
            words = "unit cells of the sample, along y and x"
        elif quantity in STRIPE_QUANTITIES:
            units = getattr(parameters.stripes.rib.unit, quantity)
        elif base in SHEET_QUANTITIES:
            units = getattr(parameters.sheet, base).unit
        elif self.section == "model":
            units = getattr(parameters.reading, base).unit
        elif base in type(getattr(parameters, self.section)).model_fields:
            units = getattr(getattr(parameters, self.section), base).unit
        else:
            words = f"{base} of the electrodes"
        return Variable((name,), units, words)


def combinations(
    workflow: Workflow, axes: tuple[SweepAxis, ...]
) -> Iterator[tuple[dict[str, Label], Workflow]]:
    """Every combination of the axes' values: its labels, and the workflow that it makes."""
    labelled = [tuple(zip(axis.labels, axis.values, strict=True)) for axis in axes]
    for chosen in itertools.product(*labelled):
        labels: dict[str, Label] = {}
        changed: dict[str, dict[str, Any]] = {}
        for axis, (label, value) in zip(axes, chosen, strict=True):
            labels[axis.name] = label
            changed.setdefault(axis.section, {})[axis.name] = value
        sections = {
            name: getattr(workflow, name).model_copy(update=values)
            for name, values in changed.items()
        }
        yield labels, workflow.model_copy(update=sections)
