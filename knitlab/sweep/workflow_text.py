"""The text of a workflow: its file with overrides, before validation and during it."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from knitlab.io.errors import BadInput, Fault, faults_of
from knitlab.io.suggestions import unknown
from knitlab.io.toml import read_toml
from knitlab.sweep.axes import SweepAxis
from knitlab.sweep.overrides import Overrides, as_text, read_value
from knitlab.sweep.settings import SETTINGS, Setting
from knitlab.sweep.workflow import SECTIONS, Workflow

KEYS = dict.fromkeys(Workflow.model_fields, "") | {
    name: setting.section for name, setting in SETTINGS.items()
}
"""Keys of a workflow, with the table of each."""


@dataclass(frozen=True)
class WorkflowText:
    """A workflow with its overrides, before validation.

    Attributes:
        path: the workflow's file.
        table: its tables, overrides included, with the first value of every axis.
        axes: settings given as lists of values, unchecked.
        overrides: the override that each overridden ``section.key`` comes from.
        faults: overrides that cannot be applied.
    """

    path: Path
    table: dict[str, Any]
    axes: tuple[SweepAxis, ...]
    overrides: dict[str, str]
    faults: tuple[Fault, ...]

    def source(self, key: str) -> str:
        """Origin of a ``section.key``: its override, or its place in the file."""
        return self.overrides.get(key, f"{self.path}: {key}")

    def checked(self) -> Workflow:
        """The workflow, with the first value of every axis.

        Raises:
            BadInput: if the file or the overrides have faults; it lists them all.
        """
        try:
            workflow = Workflow.model_validate(self.table)
        except ValidationError as error:
            found = faults_of(error, "", KEYS)
            faults = [Fault(self._place(entry.path), entry.problem) for entry in found]
            raise BadInput([*self.faults, *faults]) from error
        if self.faults:
            raise BadInput(self.faults)
        return workflow

    def checked_axes(self) -> tuple[SweepAxis, ...]:
        """The axes.

        Raises:
            BadInput: if values other than the first, which :meth:`checked` checks, have faults.
        """
        faults: list[Fault] = []
        axes = []
        for axis in self.axes:
            section, values = axis.setting.section, []
            source = self.source(f"{section}.{axis.name}")
            for number, value in enumerate(axis.values, start=1):
                try:
                    read = SECTIONS[section].model_validate({axis.name: value})
                except ValidationError as error:
                    problems = [entry.problem for entry in faults_of(error, "") if number > 1]
                    faults += [Fault(f"{source}: value {number}", problem) for problem in problems]
                else:
                    values.append(getattr(read, axis.name))
            if len(set(values)) < len(values):
                faults.append(Fault(source, "has a value twice; keep one"))
            if axis.name == "boundary" and "stripes" in self.table:
                faults.append(Fault(source, "lists boundaries; list them in stripes.boundaries"))
            axes.append(SweepAxis(axis.setting, tuple(values)))
        if faults:
            raise BadInput(faults)
        return tuple(axes)

    def section(self, name: str) -> Any:
        """One section of the workflow, or None if it is missing or has faults."""
        try:
            return SECTIONS[name].model_validate(self.table[name])
        except (KeyError, ValidationError):
            return None

    def folder(self, key: str) -> Path:
        """Folder to which a path of ``section.key`` is relative."""
        return Path() if key in self.overrides else self.path.parent

    def _place(self, path: str) -> str:
        """Origin of a fault, from its path in the tables."""
        section, _, key = path.partition(".")
        name, _, item = key.partition(".")
        number = item.partition(".")[0]
        if name in {axis.name for axis in self.axes if axis.setting.section == section}:
            return f"{self.source(f'{section}.{name}')}: value 1"
        override = self.overrides.get(f"{section}.{name}")
        if override:
            return f"{override}: value {int(number) + 1}" if number.isdigit() else override
        return f"{self.path}: {path}" if path else str(self.path)


def read_workflow(path: Path, overrides: Overrides = ()) -> WorkflowText:
    """Read a workflow's file and apply overrides to it.

    A key is the name of a setting, with or without its section; a comma makes a list.

    Raises:
        BadInput: if the file cannot be read, or an override cannot be applied.
    """
    table = {name: _with_lists(name, its) for name, its in read_toml(path).items()}
    faults: list[Fault] = []
    sources: dict[str, str] = {}
    for override in as_text(overrides):
        source = f"settings {override}"
        key, equals, text = (part.strip() for part in override.partition("="))
        name = key.rpartition(".")[2]
        setting = SETTINGS.get(name)
        if not equals or not text:
            faults.append(Fault(source, "is not KEY=VALUE; give both"))
        elif setting is None:
            faults.append(Fault(source, unknown(name, SETTINGS, "setting")))
        elif key not in (name, place := f"{setting.section}.{name}"):
            faults.append(Fault(source, f"is in [{setting.section}]; give {place}"))
        else:
            section = table.setdefault(setting.section, {})
            if isinstance(section, dict):
                section[name] = _with_list(setting, read_value(text))
            sources[place] = source
    table, axes = _with_single_values(table)
    return WorkflowText(path, table, axes, sources, tuple(faults))


def _with_single_values(table: dict[str, Any]) -> tuple[dict[str, Any], tuple[SweepAxis, ...]]:
    """Tables with the first value of each setting that has several, and the axes."""
    single, axes = dict(table), []
    for setting, value in _settings_in(table):
        if setting.is_swept_by(value):
            single[setting.section] = single[setting.section] | {setting.name: value[0]}
            axes.append(SweepAxis(setting, tuple(value)))
    # By name, so that a cube's dimensions do not depend on the order of the settings in a file.
    return single, tuple(sorted(axes, key=lambda axis: axis.name))


def _settings_in(table: dict[str, Any]) -> Iterator[tuple[Setting, Any]]:
    for section, given in table.items():
        for name, value in given.items() if isinstance(given, dict) else ():
            setting = SETTINGS.get(name)
            if setting is not None and setting.section == section:
                yield setting, value


def _with_lists(section: str, given: Any) -> Any:
    """A table of a file, in which a single value that stands for a list is a list."""
    if section not in SECTIONS or not isinstance(given, dict):
        return given
    return {
        name: _with_list(SETTINGS[name], value) if name in SECTIONS[section].model_fields else value
        for name, value in given.items()
    }


def _with_list(setting: Setting, value: Any) -> Any:
    return [value] if setting.takes_list and not isinstance(value, list | dict) else value
