"""Axes: settings that a workflow gives as a list, which become dimensions of its cube."""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from knitlab.cube.schema import Variable
from knitlab.fabric.electrodes import ElectrodeLayout
from knitlab.simulation.case import Label
from knitlab.sweep.declared_fields import declared
from knitlab.sweep.settings import PATTERN, SAMPLE_SIZE, Setting
from knitlab.sweep.workflow import Workflow

LAYOUT_SETTINGS = ("layout", *declared(ElectrodeLayout))


@dataclass(frozen=True)
class SweepAxis:
    """One setting and the values that it takes.

    Attributes:
        setting: the setting.
        values: its values.
    """

    setting: Setting
    values: tuple[Any, ...]

    @property
    def name(self) -> str:
        """Name of the setting, and of the cube's dimension."""
        return self.setting.name

    @property
    def labels(self) -> tuple[Label, ...]:
        """Its values as labels; a sample of 5 by 3 unit cells is ``5x3``."""
        return tuple(
            "x".join(map(str, value)) if isinstance(value, tuple) else value
            for value in self.values
        )

    @property
    def coordinate(self) -> Variable:
        """The cube's coordinate along it."""
        long_name = self.name
        if quantity := self.setting.factor_on:
            long_name = f"factor on {quantity}"
        elif self.name == SAMPLE_SIZE:
            long_name = "unit cells of the sample, along y and x"
        elif self.name == PATTERN:
            long_name = "named pattern of patches"
        elif self.name in LAYOUT_SETTINGS:
            long_name = f"{self.name} of the electrodes"
        return Variable((self.name,), self.setting.unit, long_name)


def combinations(
    workflow: Workflow, axes: tuple[SweepAxis, ...]
) -> Iterator[tuple[dict[str, Label], Workflow]]:
    """Every combination of the axes' values: its labels, and the workflow with these values."""
    labelled = [tuple(zip(axis.labels, axis.values, strict=True)) for axis in axes]
    for chosen in itertools.product(*labelled):
        labels: dict[str, Label] = {}
        changed: dict[str, dict[str, Any]] = {}
        for axis, (label, value) in zip(axes, chosen, strict=True):
            labels[axis.name] = label
            changed.setdefault(axis.setting.section, {})[axis.name] = value
        sections = {
            name: getattr(workflow, name).model_copy(update=values)
            for name, values in changed.items()
        }
        yield labels, workflow.model_copy(update=sections)
