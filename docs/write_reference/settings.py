"""The reference of settings, from the schema of workflows and the files under ``params/``."""

import itertools
import tomllib
from collections.abc import Iterator
from typing import Any

from markdown_text import code, plain, table

from knitlab.io.shipped import shipped
from knitlab.runs.listing import as_toml, described, settings
from knitlab.runs.workflow import SECTIONS

COLUMNS = ("setting", "values", "default", "unit", "source")


def page() -> str:
    """The settings of each table of a workflow, and the named values under ``params/``."""
    files = {
        path.stem: tomllib.loads(path.read_text(encoding="utf-8"))
        for path in sorted(shipped("params").glob("*.toml"))
    }
    parts = []
    for name in SECTIONS:
        parts += [f"## [{name}]", plain(described(name)), table(COLUMNS, _rows(name))]
    return "\n\n".join([*parts, *_stripes(files), *_layouts(files), *_design_sets(files)])


def _rows(section: str) -> Iterator[tuple[str, ...]]:
    """A row for each setting; settings next to each other of which the same is known share one."""
    rows = [
        (
            code(line.name),
            plain(line.values),
            code(line.default) if line.default else "",
            line.unit,
            plain(line.source),
        )
        for line in settings()
        if line.section == section
    ]
    for known, alike in itertools.groupby(rows, key=lambda row: row[1:]):
        yield (", ".join(row[0] for row in alike), *known)


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
            ", ".join(code(f"{k} = {as_toml(v)}") for k, v in each.items() if k != "source"),
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
