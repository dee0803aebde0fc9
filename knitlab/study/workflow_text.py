"""The text of a workflow: its file, with the overrides of ``--set`` laid over it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from knitlab.io.errors import BadInput, Fault, faults_of
from knitlab.io.strict_model import StrictModel
from knitlab.io.suggestions import unknown
from knitlab.io.toml import read_toml
from knitlab.study.axes import SAMPLE_SIZE, SWEPT_SECTIONS, SweepAxis
from knitlab.study.overrides import Overrides, as_text, read_value
from knitlab.study.workflow import SECTION_OF, SECTIONS, Workflow


@dataclass(frozen=True)
class WorkflowText:
    """What a workflow and its overrides say, before it is checked.

    Attributes:
        path: the workflow's file.
        table: its tables, overrides included, with the first value of every axis.
        axes: settings given as lists of values, unchecked.
        overrides: the ``--set`` that each overridden ``section.key`` comes from.
        faults: overrides that say nothing.
    """

    path: Path
    table: dict[str, Any]
    axes: tuple[SweepAxis, ...]
    overrides: dict[str, str]
    faults: tuple[Fault, ...]

    def source(self, key: str) -> str:
        """Where a ``section.key`` is said: its override, or its place in the file."""
        return self.overrides.get(key, f"{self.path}: {key}")

    def checked(self) -> Workflow:
        """The workflow, with the first value of every axis.

        Raises:
            BadInput: with every fault of the file and of the overrides.
        """
        faults = list(self.faults)
        try:
            workflow = Workflow.model_validate(self.table)
        except ValidationError as error:
            swept = {(axis.section, axis.name) for axis in self.axes}
            for entry in faults_of(error, "", {*SECTIONS, *SECTION_OF}):
                section, _, key = entry.path.partition(".")
                name, _, item = key.partition(".")
                if (section, name) in swept:
                    continue  # checked_axes says it, with the value's place
                override = self.overrides.get(f"{section}.{name}")
                if override and item:
                    override = f"{override}: value {int(item) + 1}"
                place = ": ".join(part for part in (str(self.path), entry.path) if part)
                faults.append(Fault(override or place, entry.problem))
        if faults:
            raise BadInput(faults)
        return workflow

    def checked_axes(self) -> tuple[SweepAxis, ...]:
        """Its axes.

        Raises:
            BadInput: with every fault of their values.
        """
        faults: list[Fault] = []
        axes = []
        for axis in self.axes:
            source, values = self.source(f"{axis.section}.{axis.name}"), []
            for place, value in enumerate(axis.values, start=1):
                try:
                    read = SECTIONS[axis.section].model_validate({axis.name: value})
                except ValidationError as error:
                    found = [entry.problem for entry in faults_of(error, "")]
                    faults += [Fault(f"{source}: value {place}", problem) for problem in found]
                else:
                    values.append(getattr(read, axis.name))
            if len(set(values)) < len(values):
                faults.append(Fault(source, "has a value twice; keep one"))
            if axis.name == "boundary" and "stripes" in self.table:
                faults.append(Fault(source, "lists boundaries; list them in stripes.boundaries"))
            axes.append(SweepAxis(axis.section, axis.name, tuple(values)))
        if faults:
            raise BadInput(faults)
        return tuple(axes)

    def section(self, name: str) -> Any:
        """One of its sections alone, or None where that is not there or has faults."""
        try:
            return SECTIONS[name].model_validate(self.table[name])
        except (KeyError, ValidationError):
            return None

    def folder(self, key: str) -> Path:
        """What a path under ``section.key`` is relative to: here, or the file that says it."""
        return Path() if key in self.overrides else self.path.parent


def read_workflow(path: Path, overrides: Overrides = ()) -> WorkflowText:
    """Read a workflow's file and lay overrides over it.

    A key is the name of a setting, with its section before it or not; a comma makes a list.

    Raises:
        BadInput: if the file cannot be read, or an override has a value of no such type.
    """
    table = _with_lists(read_toml(path))
    faults: list[Fault] = []
    sources: dict[str, str] = {}
    for override in as_text(overrides):
        key, equals, text = (part.strip() for part in override.partition("="))
        name = key.rpartition(".")[2]
        section = SECTION_OF.get(name)
        if not equals or not text:
            faults.append(Fault(f"overrides {override}", "is not KEY=VALUE; give both"))
        elif section is not None and key not in (name, f"{section}.{name}"):
            faults.append(Fault(f"overrides {override}", f"is of {section}; say {section}.{name}"))
        elif section is None:
            faults.append(Fault(f"overrides {override}", unknown(name, SECTION_OF, "setting")))
        else:
            part = table.setdefault(section, {})
            if isinstance(part, dict):
                part[name] = _value(text, SECTIONS[section], name)
            sources[f"{section}.{name}"] = f"overrides {override}"
    table, axes = _axes(table)
    return WorkflowText(path, table, axes, sources, tuple(faults))


def _axes(table: dict[str, Any]) -> tuple[dict[str, Any], tuple[SweepAxis, ...]]:
    """Split a table into one with single values and the axes along which it has several."""
    single, axes = dict(table), []
    for section in (*SWEPT_SECTIONS, "design"):
        given = table.get(section)
        for name, value in given.items() if isinstance(given, dict) else ():
            if section == "design":
                several = name == SAMPLE_SIZE and _is_list_of_lists(value)
            else:
                several = isinstance(value, list) and not _takes_list(SECTIONS[section], name)
            if several and value:
                single[section] = single[section] | {name: value[0]}
                axes.append(SweepAxis(section, name, tuple(value)))
    # By name, so that a cube's dimensions do not depend on the order of what is said.
    return single, tuple(sorted(axes, key=lambda axis: axis.name))


def _with_lists(table: dict[str, Any]) -> dict[str, Any]:
    """A file's tables, with a list of one wherever a single value stands for a list."""
    return {
        name: {
            key: [value]
            if key in _lists(SECTIONS[name]) and not isinstance(value, list | dict)
            else value
            for key, value in its.items()
        }
        if name in SECTIONS and isinstance(its, dict)
        else its
        for name, its in table.items()
    }


def _lists(section: type[StrictModel]) -> set[str]:
    """Settings of a section that are lists, of any length."""
    return {
        name
        for name, field in section.model_fields.items()
        if "..." in str(field.annotation) or "Ellipsis" in str(field.annotation)
    }


def _is_list_of_lists(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(part, list) for part in value)


def _takes_list(section: type[StrictModel], name: str) -> bool:
    field = section.model_fields.get(name)
    return field is None or "tuple" in str(field.annotation)


def _value(text: str, section: type[StrictModel], name: str) -> Any:
    value = read_value(text)
    return [value] if _takes_list(section, name) and not isinstance(value, list) else value
