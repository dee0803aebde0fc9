"""JSON that knitlab wrote, checked by a schema."""

import json
from typing import Any

from pydantic import TypeAdapter

from knitlab.io.errors import invalid


def json_table(text: str, where: str, schema: Any, message: str) -> dict[str, Any]:
    """The table in a text; InputError with a message if it does not match the schema."""
    try:
        table: dict[str, Any] = json.loads(text)
        TypeAdapter(schema).validate_python(table)
    except (ValueError, TypeError, RecursionError) as error:
        raise invalid(where, message) from error
    return table
