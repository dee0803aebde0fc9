"""The reference of settings, from the schema of workflows and the files under ``params/``."""

import inspect
import itertools
import tomllib
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

from markdown_text import code, plain, table
from pydantic import BaseModel, TypeAdapter

from knitlab.io.shipped import shipped
from knitlab.runs.parameters import TABLES, defaults
from knitlab.runs.workflow import SECTIONS, SETTINGS

COLUMNS = ("setting", "values", "default", "unit", "source")
LIMITS = {"exclusiveMinimum": ">", "minimum": "≥", "exclusiveMaximum": "<", "maximum": "≤"}
TYPE_NAMES = {
    "integer": "whole number",
    "number": "number",
    "boolean": "true or false",
    "string": "text",
}


def page() -> str:
    """The settings of each table of a workflow, and the named values under ``params/``."""
    files = {
        path.stem: tomllib.loads(path.read_text(encoding="utf-8"))
        for path in sorted(shipped("params").glob("*.toml"))
    }
    parts = []
    for name, section in SECTIONS.items():
        parts += [f"## [{name}]", plain(_described(section)), table(COLUMNS, _rows(name))]
    return "\n\n".join([*parts, *_stripes(files), *_layouts(files), *_design_sets(files)])


def _described(section: type[BaseModel]) -> str:
    """A section's docstring without the name that it begins with."""
    words = (inspect.getdoc(section) or "").split(": ", 1)[-1]
    return words[:1].upper() + words[1:]


def _rows(section: str) -> Iterator[tuple[str, ...]]:
    """A row for each setting; settings next to each other of which the same is known share one."""
    parameters = defaults()
    stated: dict[str, Any] = {}
    for name in TABLES:
        stated |= asdict(getattr(parameters, name))
    rows = []
    for setting in SETTINGS.values():
        if setting.section != section:
            continue
        source = parameters.sources.get(setting.name, "")
        default = stated[setting.name] if source else setting.default
        rows.append(
            (
                code(setting.name),
                plain(_in_words(TypeAdapter(setting.kind).json_schema())),
                "" if default in (None, ()) else code(_toml(default)),
                "" if setting.unit == "1" else setting.unit,
                plain(source),
            )
        )
    for known, alike in itertools.groupby(rows, key=lambda row: row[1:]):
        yield (", ".join(row[0] for row in alike), *known)


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


def _toml(value: Any) -> str:
    """A value as a workflow states it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, float):
        return f"{value:.4g}"
    return f'"{value}"' if isinstance(value, str) else str(value)


def _stripes(files: dict[str, Any]) -> Iterator[str]:
    yield "## Stripes"
    yield "The calibrated stripes of `params/stripes.toml`, by stitches across a stripe."
    for knit, each in files["stripes"].items():
        units = each["unit"]
        columns = (knit, *(f"{name} [{unit}]" for name, unit in units.items()))
        yield table(columns, ([n, *(f"{row[k]:g}" for k in units)] for n, row in each["n"].items()))
        yield f"Source: {each['source']}."


def _layouts(files: dict[str, Any]) -> Iterator[str]:
    yield "## Layouts of electrodes"
    yield "The layouts of `params/electrodes.toml`, which `[electrodes] layout` names."
    rows = [
        (
            code(name),
            ", ".join(code(f"{k} = {_toml(v)}") for k, v in each.items() if k != "source"),
            plain(each["source"]),
        )
        for name, each in files["electrodes"]["layouts"].items()
    ]
    yield table(("layout", "settings", "source"), rows)


def _design_sets(files: dict[str, Any]) -> Iterator[str]:
    yield "## Sets of designs"
    yield "The sets of `params/designs.toml`, which `[design] set` names."
    rows = [
        (
            code(name),
            "; ".join(
                f"{', '.join(map(str, grid['n_stripe']))}: {', '.join(map(str, grid['n_subunit']))}"
                for grid in each["designs"]
            ),
            plain(each["source"]),
        )
        for name, each in files["designs"].items()
    ]
    yield table(("set", "n_stripe: n_subunit", "source"), rows)
