"""A workflow's file with its overrides and its lists of values, before and during validation."""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from knitlab.cube.schema import Variable
from knitlab.fabric.electrodes import ElectrodeLayout
from knitlab.io.errors import BadInput, Fault, faults_of, unknown
from knitlab.io.toml import read_toml
from knitlab.simulation.case import Label
from knitlab.sweep.declared_fields import declared
from knitlab.sweep.workflow import PATTERN, SAMPLE_SIZE, SECTIONS, SETTINGS, Setting, Workflow
from knitlab.sweep.workflow_file import Overrides, read_overrides

KEYS = dict.fromkeys(Workflow.model_fields, "") | {
    name: setting.section for name, setting in SETTINGS.items()
}
"""Keys of a workflow, with the table of each."""
LAYOUT_SETTINGS = ("layout", *declared(ElectrodeLayout))


Axes = dict[str, tuple[Any, ...]]  # values of settings given as lists: dimensions of the cube


def coordinate(setting: Setting) -> Variable:
    """The cube's coordinate along the values of a setting."""
    long_name = {
        SAMPLE_SIZE: "unit cells of the sample, along y and x",
        PATTERN: "named pattern of patches",
        **{name: f"{name} of the electrodes" for name in LAYOUT_SETTINGS},
    }.get(setting.name, setting.name)
    if quantity := setting.factor_on:
        long_name = f"factor on {quantity}"
    return Variable((setting.name,), setting.unit, long_name)


def combinations(workflow: Workflow, axes: Axes) -> Iterator[tuple[dict[str, Label], Workflow]]:
    """Every combination of the axes' values: its labels, and the workflow with these values."""
    for chosen in itertools.product(*axes.values()):
        labels: dict[str, Label] = {}
        changed = workflow
        for name, value in zip(axes, chosen, strict=True):
            # A sample of 5 by 3 unit cells is ``5x3``.
            labels[name] = "x".join(map(str, value)) if isinstance(value, tuple) else value
            section = SETTINGS[name].section
            table = getattr(changed, section).model_copy(update={name: value})
            changed = changed.model_copy(update={section: table})
        yield labels, changed


@dataclass(frozen=True)
class WorkflowText:
    """A workflow with its overrides, before validation."""

    path: Path
    table: dict[str, Any]  # with overrides, and the first value of every axis
    axes: Axes
    overrides: dict[str, Any]
    sources: dict[str, str]  # what each overridden ``section.key`` was given by, for messages
    faults: tuple[Fault, ...]  # overrides that cannot be applied

    def source(self, key: str) -> str:
        """Origin of a ``section.key``: its override, or where it is in the file."""
        return self.sources.get(key, f"{self.path}: {key}")

    def checked(self) -> tuple[Workflow, Axes]:
        """The workflow with the first value of each axis, and the axes; BadInput has all faults."""
        faults, axes, workflow = [*self.faults], Axes(), None
        try:
            workflow = Workflow.model_validate(self.table)
        except ValidationError as error:
            read_faults = faults_of(error, "", KEYS)
            faults += [Fault(self._origin(entry.path), entry.problem) for entry in read_faults]
        for name, given in self.axes.items():
            section, values = SETTINGS[name].section, []
            source = self.source(f"{section}.{name}")
            for number, value in enumerate(given, start=1):
                try:
                    table = SECTIONS[section].model_validate({name: _listed(section, name, value)})
                    values.append(getattr(table, name))
                except ValidationError as error:
                    problems = [entry.problem for entry in faults_of(error, "") if number > 1]
                    faults += [Fault(f"{source}: value {number}", problem) for problem in problems]
            if len(set(values)) < len(values):
                faults.append(Fault(source, "has a value twice; keep one"))
            axes[name] = tuple(values)
        if workflow is None or faults:
            raise BadInput(faults)
        return workflow, axes

    def section(self, name: str) -> Any:
        """One section of the workflow, or None if it is missing or has faults."""
        try:
            return SECTIONS[name].model_validate(self.table[name])
        except (KeyError, ValidationError):
            return None

    def folder(self, key: str) -> Path:
        """Folder to which a path of ``section.key`` is relative."""
        return Path() if key in self.sources else self.path.parent

    def _origin(self, path: str) -> str:
        """Origin of a fault, from its path in the tables."""
        section, _, key = path.partition(".")
        name, _, item = key.partition(".")
        number = item.partition(".")[0]
        if name in self.axes and SETTINGS[name].section == section:
            return f"{self.source(f'{section}.{name}')}: value 1"
        if override := self.sources.get(f"{section}.{name}"):
            return f"{override}: value {int(number) + 1}" if number.isdigit() else override
        return f"{self.path}: {path}" if path else str(self.path)


def read_workflow(path: Path, overrides: Overrides = ()) -> WorkflowText:
    """Read a workflow's file and apply overrides to it."""
    table = {
        name: {key: _listed(name, key, value) for key, value in given.items()}
        if isinstance(given, dict)
        else given
        for name, given in read_toml(path).items()
    }
    read, faults = read_overrides(overrides)
    applied: dict[str, Any] = {}
    sources: dict[str, str] = {}
    for override in read:
        name, value, source = override.name, override.value, override.source
        section = SETTINGS[name].section if name in SETTINGS else ""
        if not section:
            faults.append(Fault(source, unknown(name, SETTINGS, "setting")))
        elif override.key not in (name, f"{section}.{name}"):
            faults.append(Fault(source, f"is in [{section}]; give {section}.{name}"))
        else:
            if isinstance(given := table.setdefault(section, {}), dict):
                given[name] = _listed(section, name, value)
            applied[name], sources[f"{section}.{name}"] = value, source
    axes = Axes()
    # By name, so that a cube's dimensions do not depend on the order of the settings in a file.
    for name, setting in sorted(SETTINGS.items()):
        given = table.get(setting.section)
        if isinstance(given, dict) and setting.is_swept_by(given.get(name)):
            axes[name] = tuple(given[name])
            given[name] = _listed(setting.section, name, axes[name][0])
    return WorkflowText(path, table, axes, applied, sources, tuple(faults))


def _listed(section: str, name: str, value: Any) -> Any:
    """A value of a workflow, in a list if it is the only one of a list."""
    setting = SETTINGS.get(name)
    of_setting = setting is not None and setting.section == section and setting.takes_list
    return [value] if of_setting and not isinstance(value, list | dict) else value
