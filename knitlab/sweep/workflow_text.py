"""A workflow's file with its overrides and its lists of values, before and during validation."""

import itertools
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from knitlab.cube.schema import DESIGN_DIMS, SAMPLE, STRIPE_DIMS, Variable
from knitlab.fabric.electrodes import ElectrodeLayout
from knitlab.io.errors import BadInput, Fault, faults_of, unknown
from knitlab.io.toml import read_toml
from knitlab.simulation.case import Label
from knitlab.sweep.declared_fields import declared
from knitlab.sweep.workflow import (
    OF_ALL_CASES,
    PATTERN,
    SAMPLE_SIZE,
    SECTIONS,
    SETTINGS,
    SWEPT_SECTIONS,
    Setting,
    Workflow,
)
from knitlab.sweep.workflow_file import Overrides, read_overrides

KEYS = dict.fromkeys(Workflow.model_fields, "") | {
    name: setting.section for name, setting in SETTINGS.items()
}
"""Keys of a workflow, with the table of each."""
PAIRED = "paired"  # the table of a workflow whose lists change together
LAYOUT_SETTINGS = ("layout", *declared(ElectrodeLayout))


@dataclass(frozen=True)
class SweepAxis:
    """A setting that a workflow gives as a list, and its values: a dimension of the cube.

    All paired ones change together, along one dimension.
    """

    setting: Setting
    values: tuple[Any, ...]
    paired: bool = False

    @property
    def name(self) -> str:
        """Name of the setting, and of the cube's dimension."""
        return self.setting.name


def coordinates(dims: Collection[str]) -> dict[str, Variable]:
    """The cube's coordinates among dimensions that are along the values of settings."""
    swept = {*dims} - {*(DESIGN_DIMS if DESIGN_DIMS[0] in dims else STRIPE_DIMS)}
    paired = {SAMPLE: Variable((SAMPLE,), "1", "number of a set of paired settings")}
    known = {name: _coordinate(SETTINGS[name]) for name in dims if name in swept & {*SETTINGS}}
    return known | {name: each for name, each in paired.items() if name in swept}


def _coordinate(setting: Setting) -> Variable:
    """The cube's coordinate along the values of a setting."""
    long_name = {
        SAMPLE_SIZE: "unit cells of the sample, along y and x",
        PATTERN: "named pattern of patches",
        **{name: f"{name} of the electrodes" for name in LAYOUT_SETTINGS},
    }.get(setting.name, setting.name)
    if quantity := setting.factor_on:
        long_name = f"factor on {quantity}"
    return Variable((setting.name,), setting.unit, long_name)


def combinations(
    workflow: Workflow, axes: tuple[SweepAxis, ...]
) -> Iterator[tuple[dict[str, Label], Workflow]]:
    """Every combination of the axes' values: its labels, and the workflow with these values."""
    paired = [axis for axis in axes if axis.paired]
    single = [axis for axis in axes if not axis.paired]
    together = [*zip(*(axis.values for axis in paired), strict=True)] or [()]
    for *chosen, (number, of_pairs) in itertools.product(
        *(axis.values for axis in single), enumerate(together, start=1)
    ):
        labels: dict[str, Label] = {}
        changed = workflow
        for axis, value in zip([*single, *paired], [*chosen, *of_pairs], strict=True):
            # A sample of 5 by 3 unit cells is ``5x3``.
            label = "x".join(map(str, value)) if isinstance(value, tuple) else value
            labels |= {SAMPLE: number} if axis.paired else {axis.name: label}
            name = axis.setting.section
            section = getattr(changed, name).model_copy(update={axis.name: value})
            changed = changed.model_copy(update={name: section})
        yield labels, changed


@dataclass(frozen=True)
class WorkflowText:
    """A workflow with its overrides, before validation."""

    path: Path
    table: dict[str, Any]  # with overrides, and the first value of every axis
    axes: tuple[SweepAxis, ...]
    overrides: dict[str, Any]
    sources: dict[str, str]  # what each overridden ``section.key`` was given by, for messages
    faults: tuple[Fault, ...]  # overrides that cannot be applied

    def source(self, key: str) -> str:
        """Origin of a ``section.key``: its override, or where it is in the file."""
        return self.sources.get(key, f"{self.path}: {key}")

    def checked(self) -> tuple[Workflow, tuple[SweepAxis, ...]]:
        """The workflow with the first value of each axis, and the axes; BadInput has all faults."""
        faults, axes, workflow = [*self.faults], [], None
        try:
            workflow = Workflow.model_validate(self.table)
        except ValidationError as error:
            read_faults = faults_of(error, "", KEYS)
            faults += [Fault(self._origin(entry.path), entry.problem) for entry in read_faults]
        for axis in self.axes:
            section, values = axis.setting.section, []
            source = self.source(f"{section}.{axis.name}")
            for number, value in enumerate(axis.values, start=1):
                try:
                    given = {axis.name: _listed(section, axis.name, value)}
                    read = SECTIONS[section].model_validate(given)
                except ValidationError as error:
                    problems = [entry.problem for entry in faults_of(error, "") if number > 1]
                    faults += [Fault(f"{source}: value {number}", problem) for problem in problems]
                else:
                    values.append(getattr(read, axis.name))
            if len(set(values)) < len(values) and not axis.paired:
                faults.append(Fault(source, "has a value twice; keep one"))
            axes.append(replace(axis, values=tuple(values)))
        if workflow is None or faults:
            raise BadInput(faults)
        return workflow, tuple(axes)

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
        if name in {axis.name for axis in self.axes if axis.setting.section == section}:
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
        if name not in SETTINGS:
            faults.append(Fault(source, unknown(name, SETTINGS, "setting")))
            continue
        section = SETTINGS[name].section
        if override.key not in (name, f"{section}.{name}"):
            faults.append(Fault(source, f"is in [{section}]; give {section}.{name}"))
            continue
        if isinstance(given := table.setdefault(section, {}), dict):
            given[name] = _listed(section, name, value)
        applied[name], sources[f"{section}.{name}"] = value, source
    axes = []
    for setting in SETTINGS.values():
        given = table.get(setting.section)
        if isinstance(given, dict) and setting.is_swept_by(given.get(setting.name)):
            axes.append(SweepAxis(setting, tuple(given[setting.name])))
            given[setting.name] = _listed(setting.section, setting.name, given[setting.name][0])
    if isinstance(table.get(PAIRED), dict):
        more, wrong = _paired(path, table.pop(PAIRED), table)
        axes, faults = axes + more, faults + wrong
    # By name, so that a cube's dimensions do not depend on the order of the settings in a file.
    axes.sort(key=lambda axis: axis.name)
    return WorkflowText(path, table, tuple(axes), applied, sources, tuple(faults))


def _paired(
    path: Path, lists: dict[str, Any], table: dict[str, Any]
) -> tuple[list[SweepAxis], list[Fault]]:
    """The lists of ``[paired]`` as axes, the first values of which are set in the table."""
    axes, faults = list[SweepAxis](), list[Fault]()
    able = [name for name, each in SETTINGS.items() if each.section in SWEPT_SECTIONS]
    able = [name for name in able if name not in OF_ALL_CASES and not SETTINGS[name].takes_list]
    lengths = {len(each) if isinstance(each, list) else 0 for each in lists.values()}
    for name, values in lists.items():
        where = f"{path}: {PAIRED}.{name}"
        if name not in able:
            faults.append(Fault(where, unknown(name, able, "setting that can be paired")))
        elif len(lengths) > 1 or 0 in lengths:
            faults.append(Fault(where, "is not a list as long as the others; give one value each"))
        elif name in table.setdefault(SETTINGS[name].section, {}):
            section = SETTINGS[name].section
            faults.append(Fault(where, f"has one value in [{section}] too; give it once"))
        else:
            axes.append(SweepAxis(SETTINGS[name], tuple(values), paired=True))
            table[SETTINGS[name].section][name] = values[0]
    return axes, faults


def _listed(section: str, name: str, value: Any) -> Any:
    """A value of a workflow, in a list if it is the only one of a list."""
    setting = SETTINGS.get(name)
    of_setting = setting is not None and setting.section == section and setting.takes_list
    return [value] if of_setting and not isinstance(value, list | dict) else value
