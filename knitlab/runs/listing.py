"""What there is: the workflows, the settings and the figures, each in a line. Imports no JAX."""

import ast
import inspect
import re
import textwrap
from dataclasses import asdict
from typing import Any, NamedTuple

from pydantic import TypeAdapter

from knitlab.io.errors import invalid, unknown
from knitlab.io.shipped import PACKAGE, shipped
from knitlab.io.toml import read_toml
from knitlab.runs.figure_names import FIGURE_NAMES
from knitlab.runs.parameters import TABLES, defaults
from knitlab.runs.workflow import SECTIONS, SETTINGS

LIMITS = {"exclusiveMinimum": ">", "minimum": "≥", "exclusiveMaximum": "<", "maximum": "≤"}
TYPE_NAMES = {
    "integer": "whole number",
    "number": "number",
    "boolean": "true or false",
    "string": "text",
}


class SettingLine(NamedTuple):
    """A setting as text: possible values, default, unit, where the default is from, meaning."""

    name: str
    section: str
    values: str
    default: str
    unit: str
    source: str
    meaning: str


def workflows() -> dict[str, str]:
    """The title of each shipped workflow, by its name.

    Example:
        >>> kl.workflows()["relaxation"]
        'Relaxation of (4, 32) from the flat sheet, by damped dynamics'
    """
    files = sorted(shipped("workflows").glob("*.toml"))
    return {file.stem: str(read_toml(file)["title"]) for file in files}


def figures() -> dict[str, str]:
    """What each figure of :mod:`knitlab.plot` shows, by its name; matplotlib is not imported.

    Example:
        >>> kl.figures()["shape"]
        'Shape of a fabric seen from the technical face'
    """
    return {name: _shows(name) for name in FIGURE_NAMES}


def _shows(name: str) -> str:
    text = (PACKAGE / "figures" / "kinds" / f"{name}.py").read_text(encoding="utf-8")
    functions = (each for each in ast.parse(text).body if isinstance(each, ast.FunctionDef))
    drawing = next(each for each in functions if each.name == name)
    return _sentence(ast.get_docstring(drawing) or "")


def settings(word: str = "") -> list[SettingLine]:
    """The settings of workflows, or those with a word in their name or description.

    Args:
        word: part of a name, a table or a description.

    Returns:
        For each setting its name, table, possible values, default, unit, source of the default and
        meaning, as text.

    Raises:
        InputError: if no setting has the word.

    Example:
        >>> [setting.name for setting in kl.settings("z_max")]
        ['z_max', 'thickness', 'z_max_factor']
    """
    parameters = defaults()
    stated: dict[str, Any] = {}
    meanings: dict[str, str] = {}
    for name, table in TABLES.items():
        stated |= asdict(getattr(parameters, name))
        meanings |= _attributes(table)
    lines = []
    for setting in SETTINGS.values():
        source = parameters.sources.get(setting.name, "")
        factor = f"factor on {setting.factor_on}" if setting.factor_on else ""
        default = stated[setting.name] if source else setting.default
        line = SettingLine(
            setting.name,
            setting.section,
            _in_words(TypeAdapter(setting.kind).json_schema()),
            "" if default in (None, ()) else as_toml(default),
            "" if setting.unit == "1" else setting.unit,
            source,
            meanings.get(setting.name) or factor,
        )
        if word.casefold() in " ".join(line).casefold():
            lines.append(line)
    if not lines:
        raise invalid(word, unknown(word, SETTINGS, "setting"))
    return lines


def _attributes(table: type[Any]) -> dict[str, str]:
    """What the docstring of a table says of each of its attributes, without units."""
    text = (inspect.getdoc(table) or "").partition("Attributes:\n")[2]
    entries = re.split(r"^(?=\w)", textwrap.dedent(text), flags=re.M)
    pairs = (entry.partition(":") for entry in entries)
    return {name: _sentence(meaning) for name, _, meaning in pairs if meaning}


def _sentence(text: str) -> str:
    """The first sentence of a docstring, on one line, without its markup."""
    line = re.sub(r" \(paper,[^)]*\)", "", " ".join(text.split()))
    line = re.sub(r":\w+:`~?(?:[\w.]*\.)?(\w+)`", r"\1", line).replace("`", "")
    return re.sub(r" \[[^]]*\]$", "", re.split(r"[.;] |\.$", line)[0])


def described(section: str) -> str:
    """What the docstring of a section of a workflow says of it."""
    words = (inspect.getdoc(SECTIONS[section]) or "").split(": ", 1)[-1]
    return words[:1].upper() + words[1:]


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


def as_toml(value: Any) -> str:
    """A value as a workflow states it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(as_toml, value))}]"
    if isinstance(value, float):
        return f"{value:.4g}"
    return f'"{value}"' if isinstance(value, str) else str(value)
