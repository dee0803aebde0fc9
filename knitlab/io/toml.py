"""Reading TOML, with a message instead of a traceback if it cannot be read."""

import tomllib
from pathlib import Path
from typing import Any

from knitlab.io.errors import fault


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
