"""The reference of settings, from the schema of workflows and the files under ``params/``."""

import inspect
import itertools
import tomllib
from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel

from generated_reference.markdown import code, plain, table
from knitlab.io.shipped import shipped
from knitlab.study.workflow import SECTIONS, Workflow

COLUMNS = ("setting", "values", "default", "unit", "source")
LIMITS = {"exclusiveMinimum": ">", "minimum": "≥", "exclusiveMaximum": "<", "maximum": "≤"}
KINDS = {"integer": "whole number", "boolean": "true or false", "string": "text"}


def page() -> str:
    """The keys of a workflow, each of its tables, and the named values under ``params/``."""
    files = {
        path.stem: tomllib.loads(path.read_text(encoding="utf-8"))
        for path in sorted(shipped("params").glob("*.toml"))
    }
    sources = _sources(files) | _stripe_units(files["stripes"])
    outside = {name for name in Workflow.model_fields if name not in SECTIONS}
    parts = ["## Workflow", table(COLUMNS, _rows(Workflow, sources, outside))]
    for name, section in SECTIONS.items():
        parts += [f"## [{name}]", plain(_described(section))]
        parts.append(table(COLUMNS, _rows(section, sources, set(section.model_fields))))
    return "\n\n".join([*parts, *_stripes(files), *_layouts(files), *_design_sets(files)])


def _described(section: type[BaseModel]) -> str:
    """A section's docstring without the name that it begins with."""
    words = (inspect.getdoc(section) or "").split(": ", 1)[-1]
    return words[:1].upper() + words[1:]


def _sources(files: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Every value of the parameter files that has a unit and a source, by its name."""
    return {
        name: entry
        for file in files.values()
        for name, entry in file.items()
        if isinstance(entry, dict) and {"value", "unit", "source"} <= entry.keys()
    }


def _stripe_units(stripes: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """What settings that replace a number of a stripe have: a unit, and no one default."""
    return {
        f"{knit}_{name}": {"unit": unit}
        for knit, its in stripes.items()
        for name, unit in its["unit"].items()
    }


def _rows(
    section: type[BaseModel], sources: dict[str, dict[str, Any]], names: set[str]
) -> Iterator[tuple[str, ...]]:
    """A row each setting; those next to each other of which the same is known share one."""
    rows = _single_rows(section, sources, names)
    for known, alike in itertools.groupby(rows, key=lambda row: row[1:]):
        yield (", ".join(row[0] for row in alike), *known)


def _single_rows(
    section: type[BaseModel], sources: dict[str, dict[str, Any]], names: set[str]
) -> Iterator[tuple[str, ...]]:
    schema = section.model_json_schema()
    for name, its in schema["properties"].items():
        if name not in names:
            continue
        entry = sources.get(name, {})
        default = entry.get("value", its.get("default"))
        if name in schema.get("required", ()):
            shown = "required"
        else:
            shown = "" if default in (None, [], ()) else code(_toml(default))
        yield (
            code(name),
            _values(its, schema.get("$defs", {})),
            shown,
            "" if entry.get("unit", "1") == "1" else entry["unit"],
            plain(entry.get("source", its.get("description", ""))),
        )


def _toml(value: Any) -> str:
    """A value as a workflow states it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, float):
        return f"{value:.4g}"
    return f'"{value}"' if isinstance(value, str) else str(value)


def _values(its: dict[str, Any], defs: dict[str, Any]) -> str:
    """What a setting may be, in words, from its JSON schema."""
    if "$ref" in its:
        return _values(defs[its["$ref"].rsplit("/", 1)[-1]], defs)
    if "anyOf" in its:
        kinds = [_values(one, defs) for one in its["anyOf"] if one.get("type") != "null"]
        return " or ".join(kinds)
    if "const" in its:
        return code(its["const"])
    if "enum" in its:
        return ", ".join(map(code, its["enum"]))
    if its.get("type") == "array":
        if members := its.get("prefixItems"):
            return f"{len(members)} values: {_values(members[0], defs)}"
        return f"list of: {_values(its['items'], defs)}"
    limits = [f"{sign} {its[key]:g}" for key, sign in LIMITS.items() if key in its]
    kind = KINDS.get(its.get("type", ""), its.get("type", ""))
    return f"{kind} {' and '.join(limits)}" if limits else kind


def _stripes(files: dict[str, Any]) -> Iterator[str]:
    yield "## Stripes"
    yield "The calibrated stripes of `params/stripes.toml`, by stitches across a stripe."
    for knit, its in files["stripes"].items():
        units = its["unit"]
        columns = (knit, *(f"{name} [{unit}]" for name, unit in units.items()))
        yield table(columns, ([n, *(f"{row[k]:g}" for k in units)] for n, row in its["n"].items()))
        yield f"Source: {its['source']}."


def _layouts(files: dict[str, Any]) -> Iterator[str]:
    yield "## Layouts of electrodes"
    yield "The layouts of `params/electrodes.toml`, which `[electrodes] layout` names."
    rows = [
        (
            code(name),
            ", ".join(code(f"{k} = {_toml(v)}") for k, v in its.items() if k != "source"),
            plain(its["source"]),
        )
        for name, its in files["electrodes"]["layouts"].items()
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
                for grid in its["designs"]
            ),
            plain(its["source"]),
        )
        for name, its in files["designs"].items()
    ]
    yield table(("set", "n_stripe: n_subunit", "source"), rows)
