"""JSON that knitlab wrote: texts are checked by a schema, and files by their checksum too."""

import hashlib
import json
import re
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from knitlab.io.errors import invalid
from knitlab.io.text_file import plain_file

END = "\n}\n"
CHECKSUM = re.compile(r',\n "sha256": "(\w+)"\n}\n\Z')


def with_checksum(text: str) -> str:
    """The text of a table that ends with its own checksum."""
    digest = hashlib.sha256(text.encode()).hexdigest()
    return f'{text.removesuffix(END)},\n "sha256": "{digest}"{END}'


def read_json(path: Path, schema: Any, name: str, hint: str) -> dict[str, Any]:
    """The table in a file of a name; InputError if it is none, does not fit, or is damaged."""
    try:
        text = plain_file(path).read_text(encoding="utf-8")
    except OSError as error:
        raise invalid(str(path), f"cannot be read ({error.strerror}); check the path") from error
    except UnicodeError as error:
        raise invalid(str(path), f"is not {name}; {hint}") from error
    if stated := CHECKSUM.search(text):
        own = text[: stated.start()] + END
        if hashlib.sha256(own.encode()).hexdigest() != stated[1]:
            raise invalid(str(path), f"is not {name} as it was written; {hint}")
    return json_table(text, str(path), schema, f"is not {name}; {hint}")


def json_table(
    text: str, where: str, schema: Any = dict[str, Any], message: str = "is not a table of JSON"
) -> dict[str, Any]:
    """The table in a text; InputError if it is none, or does not fit the schema."""
    try:
        table: dict[str, Any] = json.loads(text)
        TypeAdapter(schema).validate_python(table)
    except (ValueError, TypeError, RecursionError) as error:
        raise invalid(where, message) from error
    return table
