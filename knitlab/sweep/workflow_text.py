"""The text of a workflow: its file, with the overrides of ``--set`` laid over it."""

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from knitlab.sweep.faults import BadInput, Fault, fault, faults_of
from knitlab.sweep.parameters import Strict
from knitlab.sweep.shipped import shipped
from knitlab.sweep.toml import read_toml
from knitlab.sweep.workflow import SECTION_OF, SECTIONS, Workflow


@dataclass(frozen=True)
class WorkflowText:
    """What a workflow and its overrides say, before it is checked.

    Attributes:
        path: the workflow's file.
        table: its tables, overrides included.
        overrides: the ``--set`` that each overridden ``section.key`` comes from.
        faults: overrides that say nothing.
    """

    path: Path
    table: dict[str, Any]
    overrides: dict[str, str]
    faults: tuple[Fault, ...]

    def source(self, key: str) -> str:
        """Where a ``section.key`` is said: its override, or its place in the file."""
        return self.overrides.get(key, f"{self.path}: {key}")

    def checked(self) -> Workflow:
        """The workflow.

        Raises:
            BadInput: with every fault of the file and of the overrides.
        """
        faults = list(self.faults)
        try:
            workflow = Workflow.model_validate(self.table)
        except ValidationError as error:
            for entry in faults_of(error, ""):
                section, _, key = entry.path.partition(".")
                name, _, item = key.partition(".")
                override = self.overrides.get(f"{section}.{name}")
                if override and item:
                    override = f"{override}: value {int(item) + 1}"
                place = ": ".join(part for part in (str(self.path), entry.path) if part)
                faults.append(Fault(override or place, entry.problem))
        if faults:
            raise BadInput(faults)
        return workflow

    def section(self, name: str) -> Any:
        """One of its sections alone, or None where that is not there or has faults."""
        try:
            return SECTIONS[name].model_validate(self.table[name])
        except (KeyError, ValidationError):
            return None

    def folder(self, key: str) -> Path:
        """What a path under ``section.key`` is relative to: here, or the file that says it."""
        return Path() if key in self.overrides else self.path.parent


def workflow_file(workflow: str) -> Path:
    """The file of a workflow given by its name or its path.

    Raises:
        BadInput: if there is none.
    """
    named = shipped("workflows") / f"{workflow}.toml"
    if named.is_file():
        return named
    path = Path(workflow)
    if path.is_file():
        return path
    names = ", ".join(sorted(file.stem for file in shipped("workflows").glob("*.toml")))
    raise fault(workflow, f"is neither a workflow ({names}) nor a file; give one of these")


def read_workflow(path: Path, overrides: tuple[str, ...] = ()) -> WorkflowText:
    """Read a workflow's file and lay the ``KEY=VALUE`` overrides over it.

    A key is the name of a setting, with its section before it or not; a comma makes a list.

    Raises:
        BadInput: if the file cannot be read.
    """
    table = read_toml(path)
    faults: list[Fault] = []
    sources: dict[str, str] = {}
    for override in overrides:
        key, equals, text = (part.strip() for part in override.partition("="))
        name = key.rpartition(".")[2]
        section = SECTION_OF.get(name)
        if not equals or not text:
            faults.append(Fault(f"--set {override}", "is not KEY=VALUE; give both"))
        elif section is None or key not in (name, f"{section}.{name}"):
            known = ", ".join(sorted(SECTION_OF))
            faults.append(Fault(f"--set {override}", f"{key} is not a setting; choose of {known}"))
        else:
            part = table.setdefault(section, {})
            if isinstance(part, dict):
                part[name] = _value(text, SECTIONS[section], name)
            sources[f"{section}.{name}"] = f"--set {override}"
    return WorkflowText(path, table, sources, tuple(faults))


def _value(text: str, section: type[Strict], name: str) -> Any:
    values = [_scalar(part.strip()) for part in text.split(",")]
    takes_list = "tuple" in str(section.model_fields[name].annotation)
    return values if takes_list or len(values) > 1 else values[0]


def _scalar(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text
