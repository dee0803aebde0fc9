"""Reading TOML, with a message instead of a traceback if it cannot be read."""

import tomllib
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from knitlab.io.errors import BadInput, fault, faults_of

Schema = TypeVar("Schema", bound=BaseModel)


def read_toml(path: Path) -> dict[str, Any]:
    """The table in a TOML file.

    Raises:
        BadInput: if it cannot be read, or is not TOML.
    """
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise fault(str(path), f"cannot be read ({error.strerror}); check the path") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise fault(str(path), f"is not TOML ({error}); correct that line") from error


def read_checked(schema: type[Schema], path: Path, source: str) -> Schema:
    """The contents of a TOML file, checked.

    Args:
        schema: of the file.
        path: the file.
        source: what named it, for a fault.

    Raises:
        BadInput: with every fault of the file.
    """
    try:
        return schema.model_validate(read_toml(path))
    except ValidationError as error:
        raise BadInput(faults_of(error, f"{source}: {path}")) from error
