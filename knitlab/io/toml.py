"""Input files: the base of their schemas; TOML and JSON read with a message."""

import json
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import tomli_w
from pydantic import BaseModel, ConfigDict, TypeAdapter

from knitlab.io.atomic_write import atomic_write
from knitlab.io.errors import invalid, naming
from knitlab.io.text_file import BACKSLASH, read_text

TOML = (".toml",)  # suffix
Schema = TypeVar("Schema", bound=BaseModel)


class StrictModel(BaseModel):
    """Base of the schema of every input file: no unknown keys, infinities or type conversions."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


def read_toml(path: Path) -> dict[str, Any]:
    """The table in a TOML file; InputError if it cannot be read, or is not TOML."""
    text = read_text(path)
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # the second of nested lists
        line = re.search(r"at line (\d+)", str(error))
        escaped = line and re.search(r'"[^"]*\\', text.split("\n")[int(line[1]) - 1])
        hint = BACKSLASH if escaped else "correct that line"
        raise invalid(str(path), f"is not TOML ({error}); {hint}") from error


def read_checked(schema: type[Schema], path: Path, named_by: str = "") -> Schema:
    """The contents of a TOML file that a setting names; InputError has all its mistakes."""
    with naming(f"{named_by}: {path}" if named_by else str(path)):
        return schema.model_validate(read_toml(path))


def write_toml(path: Path, table: Mapping[str, Any]) -> None:
    """Write a table as TOML; CannotWrite if that fails."""
    with atomic_write(path) as temporary:
        temporary.write_text(tomli_w.dumps(table), encoding="utf-8")


def json_table(text: str, where: str, schema: Any, message: str) -> dict[str, Any]:
    """The table in a text; InputError with a message if it does not match the schema."""
    try:
        table: dict[str, Any] = json.loads(text)
        TypeAdapter(schema).validate_python(table)
    except (ValueError, TypeError, RecursionError) as error:
        raise invalid(where, message) from error
    return table
