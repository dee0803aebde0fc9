"""Settings: name, type, default and unit of each, for workflows, sweeps and documentation.

A setting is declared once, as a field of a table such as
:class:`~knitlab.equilibrium.settings.SolverSettings` with its range and unit as its type, or of a
section of :mod:`knitlab.sweep.workflow`. To add one, add the field and, for a table of a parameter
file, an entry with its value, unit and source there: ``--set``, sweeps, coordinates and the
reference of settings follow (:mod:`knitlab.sweep.declared_fields`).
"""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, get_origin

from pydantic import TypeAdapter

from knitlab.io.shipped import shipped
from knitlab.sweep.declared_fields import FactorOn, parts, unit_of
from knitlab.sweep.parameters import read_parameters
from knitlab.sweep.patterns import is_pattern_name
from knitlab.sweep.workflow import SECTIONS

SWEPT_SECTIONS = ("model", "solver", "dynamics", "electrodes")
"""Sections of which any single setting may be a list, and is then a dimension of the cube."""
SAMPLE_SIZE = "unit_cells"
"""The setting of ``[design]`` that may be a list too, of pairs."""
PATTERN = "pattern"
"""The setting of ``[design]`` that may be a list of names."""
TABLES = ("model", "sheet", "plain", "solver", "dynamics", "capacitor", "gauge")
"""Tables of the parameters whose fields are settings."""
LIMITS = {"exclusiveMinimum": ">", "minimum": "≥", "exclusiveMaximum": "<", "maximum": "≤"}
TYPE_NAMES = {
    "integer": "whole number",
    "number": "number",
    "boolean": "true or false",
    "string": "text",
}


@dataclass(frozen=True)
class Setting:
    """One setting of a workflow.

    Attributes:
        section: its section of a workflow.
        name: its name, which no other section has.
        kind: its declared type, with range and unit.
        default: its value if a workflow does not give one; None if the value is then that of the
            parameter files or has no effect.
    """

    section: str
    name: str
    kind: Any
    default: Any

    @property
    def unit(self) -> str:
        """Its unit [UDUNITS]."""
        return unit_of(self.kind)

    @property
    def factor_on(self) -> str | None:
        """The quantity that it multiplies, if it is a factor."""
        marks = (part.quantity for part in parts(self.kind) if isinstance(part, FactorOn))
        return next(marks, None)

    @property
    def takes_list(self) -> bool:
        """Whether its value is a list."""
        return any(get_origin(part) is tuple for part in parts(self.kind))

    def is_swept_by(self, value: Any) -> bool:
        """Whether a value of a workflow file is a list of several values."""
        if not isinstance(value, list) or not value:
            return False
        if self.name == SAMPLE_SIZE:
            return all(isinstance(one, list) for one in value)
        if self.name == PATTERN:
            names = [isinstance(one, str) and is_pattern_name(one) for one in value]
            return len(value) > 1 and all(names)
        return self.section in SWEPT_SECTIONS and not self.takes_list


SETTINGS = {
    name: Setting(section, name, field.rebuild_annotation(), field.default)
    for section, schema in SECTIONS.items()
    for name, field in schema.model_fields.items()
}
"""Every setting, by name."""


@dataclass(frozen=True)
class SettingRow:
    """A setting as the documentation lists it.

    Attributes:
        section: its section of a workflow.
        name: its name.
        values: its possible values, in words.
        unit: its unit, ``"1"`` if it has none.
        default: its default; None if it has none.
        source: source of the default, if it is that of a parameter file.
    """

    section: str
    name: str
    values: str
    unit: str
    default: Any
    source: str


def settings_table(parameter_folder: Path | None = None) -> tuple[SettingRow, ...]:
    """Every setting of a workflow, with its range, unit, default and source.

    Raises:
        BadInput: with every fault of the parameter files.

    Example:
        >>> row = next(row for row in settings_table() if row.name == "k_wall")
        >>> row.section, row.values, row.unit, row.default
        ('model', 'number > 0', 'N/mm', 100.0)
    """
    parameters = read_parameters(parameter_folder or shipped("params"))
    stated: dict[str, Any] = {}
    for table in TABLES:
        stated |= asdict(getattr(parameters, table))
    return tuple(
        SettingRow(
            section=setting.section,
            name=setting.name,
            values=_in_words(TypeAdapter(setting.kind).json_schema()),
            unit=setting.unit,
            default=stated[setting.name] if setting.name in parameters.sources else setting.default,
            source=parameters.sources.get(setting.name, ""),
        )
        for setting in SETTINGS.values()
    )


def _in_words(schema: dict[str, Any]) -> str:
    """The possible values of a type with this JSON schema."""
    if "anyOf" in schema:
        return " or ".join(_in_words(one) for one in schema["anyOf"] if one.get("type") != "null")
    if "const" in schema or "enum" in schema:
        values = schema.get("enum", [schema.get("const")])
        return " or ".join(f'"{each}"' if isinstance(each, str) else str(each) for each in values)
    if schema["type"] == "array":
        members = schema.get("prefixItems")
        several = f"{len(members)} of" if members else "list of"
        return f"{several}: {_in_words(members[0] if members else schema['items'])}"
    limits = [f"{sign} {schema[key]:g}" for key, sign in LIMITS.items() if key in schema]
    return " ".join([TYPE_NAMES[schema["type"]], " and ".join(limits)]).strip()
