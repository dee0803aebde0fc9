"""Declared types in words, for the documentation."""

from typing import Any

from pydantic import TypeAdapter

LIMITS = {"exclusiveMinimum": ">", "minimum": "≥", "exclusiveMaximum": "<", "maximum": "≤"}
NAMES = {
    "integer": "whole number",
    "number": "number",
    "boolean": "true or false",
    "string": "text",
}


def in_words(kind: Any) -> str:
    """The possible values of a type.

    Args:
        kind: a type with its range, as a settings table declares it.

    Example:
        >>> from typing import Literal
        >>> from pydantic import PositiveInt
        >>> in_words(Literal["flat", "relaxed"])
        '"flat" or "relaxed"'
        >>> in_words(tuple[PositiveInt, PositiveInt] | None)
        '2 of: whole number > 0'
    """
    return _words(TypeAdapter(kind).json_schema())


def _words(schema: dict[str, Any]) -> str:
    if "anyOf" in schema:
        return " or ".join(_words(one) for one in schema["anyOf"] if one.get("type") != "null")
    if "const" in schema or "enum" in schema:
        values = schema.get("enum", [schema.get("const")])
        return " or ".join(f'"{each}"' if isinstance(each, str) else str(each) for each in values)
    if schema["type"] == "array":
        members = schema.get("prefixItems")
        return (
            f"{len(members)} of: {_words(members[0])}"
            if members
            else (f"list of: {_words(schema['items'])}")
        )
    limits = [f"{sign} {schema[key]:g}" for key, sign in LIMITS.items() if key in schema]
    return " ".join([NAMES[schema["type"]], " and ".join(limits)]).strip()
