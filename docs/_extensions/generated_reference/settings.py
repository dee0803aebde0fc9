"""The reference of settings, from the schema of workflows and the files under ``params/``."""

import inspect
import itertools
import tomllib
from collections.abc import Iterable, Iterator
from typing import Any

from pydantic import BaseModel

from generated_reference.markdown import code, plain, table
from knitlab.io.shipped import shipped
from knitlab.sweep.settings import SettingRow, settings_table
from knitlab.sweep.workflow import SECTIONS

COLUMNS = ("setting", "values", "default", "unit", "source")


def page() -> str:
    """The settings of each table of a workflow, and the named values under ``params/``."""
    files = {
        path.stem: tomllib.loads(path.read_text(encoding="utf-8"))
        for path in sorted(shipped("params").glob("*.toml"))
    }
    settings = settings_table()
    parts = []
    for name, section in SECTIONS.items():
        members = [each for each in settings if each.section == name]
        parts += [f"## [{name}]", plain(_described(section)), table(COLUMNS, _rows(members))]
    return "\n\n".join([*parts, *_stripes(files), *_layouts(files), *_design_sets(files)])


def _described(section: type[BaseModel]) -> str:
    """A section's docstring without the name that it begins with."""
    words = (inspect.getdoc(section) or "").split(": ", 1)[-1]
    return words[:1].upper() + words[1:]


def _rows(settings: Iterable[SettingRow]) -> Iterator[tuple[str, ...]]:
    """A row each; settings next to each other of which the same is known share one."""
    rows = [
        (
            code(each.name),
            plain(each.values),
            "" if each.default in (None, ()) else code(_toml(each.default)),
            "" if each.unit == "1" else each.unit,
            plain(each.source),
        )
        for each in settings
    ]
    for known, alike in itertools.groupby(rows, key=lambda row: row[1:]):
        yield (", ".join(row[0] for row in alike), *known)


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
