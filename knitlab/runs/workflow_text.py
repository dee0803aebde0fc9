"""A workflow's file with its overrides and its lists of values, before and during validation."""

import itertools
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from knitlab.io.errors import InputError, Mistake, pydantic_mistakes, unknown
from knitlab.io.limits import MAX_CHOICES
from knitlab.io.toml import read_toml
from knitlab.model.electrodes import ElectrodeLayout
from knitlab.observables.observable import Variable
from knitlab.observables.schema import SAMPLE
from knitlab.runs.declared_fields import declared
from knitlab.runs.workflow import PATTERN, SAMPLE_SIZE, SECTIONS, SETTINGS, Workflow
from knitlab.runs.workflow_file import Overrides, read_overrides
from knitlab.solvers.case import Label

KEYS = dict.fromkeys(Workflow.model_fields, "") | {k: each.section for k, each in SETTINGS.items()}
"""Keys of a workflow, with the table of each."""
PAIRED = "paired"  # the table of a workflow whose lists change together
LAYOUT_SETTINGS = ("layout", *declared(ElectrodeLayout))


Axes = dict[str, tuple[Any, ...]]  # values of settings given as lists: dimensions of the cube


def coordinate(name: str) -> Variable:
    """The cube's coordinate along the values of a setting, or of paired ones."""
    if name == SAMPLE:
        return Variable((SAMPLE,), "number of a set of paired settings")
    setting = SETTINGS[name]
    long_name = name
    if name == SAMPLE_SIZE:
        long_name = "unit cells of the sample, along y and x"
    elif name == PATTERN:
        long_name = "named pattern of patches"
    elif name in LAYOUT_SETTINGS:
        long_name = f"{name} of the electrodes"
    elif quantity := setting.factor_on:
        long_name = f"factor on {quantity}"
    return Variable((name,), long_name, setting.unit)


def combinations(
    workflow: Workflow, axes: Axes, paired: Collection[str] = ()
) -> Iterator[tuple[dict[str, Label], Workflow]]:
    """Every combination of the axes' values: its labels, and the workflow with these values.

    Values of paired axes change together, and are labelled by their number.
    """
    single = [name for name in axes if name not in paired]
    together = [*zip(*(axes[name] for name in paired), strict=True)] or [()]
    numbered = enumerate(together, start=1)
    for *chosen, (number, pairs) in itertools.product(*map(axes.__getitem__, single), numbered):
        labels: dict[str, Label] = {}
        changed = workflow
        for name, value in zip([*single, *paired], [*chosen, *pairs], strict=True):
            # A sample of 5 by 3 unit cells is ``5x3``.
            label = "x".join(map(str, value)) if isinstance(value, tuple) else value
            labels |= {SAMPLE: number} if name in paired else {name: label}
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
    mistakes: tuple[Mistake, ...]  # overrides and pairs that cannot be applied
    paired: tuple[str, ...] = ()  # axes that change together

    def source(self, key: str) -> str:
        """Origin of a ``section.key``: its override, or where it is in the file."""
        return self.sources.get(key, f"{self.path}: {key}")

    def checked(self) -> tuple[Workflow, Axes]:
        """The workflow with the first value of each axis, and the axes; or InputError."""
        mistakes, axes, workflow = [*self.mistakes], Axes(), None
        try:
            workflow = Workflow.model_validate(self.table)
        except ValidationError as error:
            read = pydantic_mistakes(error, "", KEYS)
            mistakes += [Mistake(self._origin(each.path), each.message) for each in read]
        for name, given in self.axes.items():
            section, values = SETTINGS[name].section, []
            source = self.source(f"{section}.{name}")
            for number, value in enumerate(given, start=1):
                try:
                    table = SECTIONS[section].model_validate({name: _listed(section, name, value)})
                    values.append(getattr(table, name))
                except ValidationError as error:
                    if len(mistakes) > MAX_CHOICES:
                        break
                    if number > 1:  # the check of the whole workflow reports the first
                        where, found = f"{source}: value {number}", pydantic_mistakes(error, "")
                        mistakes += [Mistake(where, each.message) for each in found]
            if len(set(values)) < len(values) and name not in self.paired:
                mistakes.append(Mistake(source, "has a value twice; keep one"))
            axes[name] = tuple(values)
        if workflow is None or mistakes:
            raise InputError(mistakes)
        return workflow, axes

    def section(self, name: str) -> Any:
        """One section of the workflow, or None if it is missing or invalid."""
        try:
            return SECTIONS[name].model_validate(self.table[name])
        except (KeyError, ValidationError):
            return None

    def folder(self, key: str) -> Path:
        """Folder to which a path of ``section.key`` is relative."""
        return Path() if key in self.sources else self.path.parent

    def _origin(self, path: str) -> str:
        """Origin of a mistake, from its path in the tables."""
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
    read, mistakes = read_overrides(overrides)
    applied: dict[str, Any] = {}
    sources: dict[str, str] = {}
    for override in read:
        name, value, source = override.name, override.value, override.source
        section = SETTINGS[name].section if name in SETTINGS else ""
        if not section:
            mistakes.append(Mistake(source, unknown(name, SETTINGS, "setting")))
        elif override.key not in (name, f"{section}.{name}"):
            mistakes.append(Mistake(source, f"is in [{section}]; give {section}.{name}"))
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
    pairs = table.pop(PAIRED) if isinstance(table.get(PAIRED), dict) else {}
    mistakes += _refused_pairs(path, pairs, table)
    if not mistakes:
        axes |= {name: tuple(values) for name, values in pairs.items()}
        for name, values in pairs.items():
            table[SETTINGS[name].section][name] = values[0]
    paired = tuple(pairs) if not mistakes else ()
    return WorkflowText(path, table, axes, applied, sources, tuple(mistakes), paired)


def _refused_pairs(path: Path, pairs: dict[str, Any], table: dict[str, Any]) -> list[Mistake]:
    """What is wrong with the lists of ``[paired]``, beside a table without them."""
    mistakes = list[Mistake]()
    able = [name for name, each in SETTINGS.items() if each.can_vary]
    lengths = {len(each) if isinstance(each, list) else 0 for each in pairs.values()}
    for name in pairs:
        where = f"{path}: {PAIRED}.{name}"
        if name not in able:
            mistakes.append(Mistake(where, unknown(name, able, "setting that can be paired")))
        elif len(lengths) > 1 or 0 in lengths:
            message = "is not a list as long as the others; give one value each"
            mistakes.append(Mistake(where, message))
        elif name in table.setdefault(section := SETTINGS[name].section, {}):
            mistakes.append(Mistake(where, f"has one value in [{section}] too; give it once"))
    return mistakes


def _listed(section: str, name: str, value: Any) -> Any:
    """A value of a workflow, in a list if it is the only one of a list."""
    setting = SETTINGS.get(name)
    of_setting = setting is not None and setting.section == section and setting.takes_list
    return [value] if of_setting and not isinstance(value, list | dict) else value
