"""What a user names of a sweep: a workflow's file, and overrides of its settings. Needs no JAX."""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from knitlab.io.errors import Mistake, invalid, shortened, unknown
from knitlab.io.names import named_folder
from knitlab.io.shipped import shipped

Overrides = Sequence[str] | Mapping[str, Any]
"""``("n_stripe=4", "k_t_factor=0.8,1")`` or ``{"n_stripe": 4, "k_t_factor": [0.8, 1]}``."""


def workflow_file(workflow: str) -> Path:
    """The file of a workflow given by its name or its path; InputError if there is none."""
    named, path = shipped("workflows") / f"{workflow}.toml", Path(workflow)
    named_folder(Path(), path.stem)
    if named.is_file():
        return named
    if path.is_file():
        return path
    names = [file.stem for file in shipped("workflows").glob("*.toml")]
    raise invalid(workflow, f"is not a file, and {unknown(path.stem, names, 'workflow')}")


@dataclass(frozen=True)
class Override:
    """A value that replaces a workflow's; its key may have the section, messages its source."""

    key: str
    value: Any
    source: str

    @property
    def name(self) -> str:
        """Name of its setting."""
        return self.key.rpartition(".")[2]


def read_overrides(
    overrides: Overrides, source: str = "settings"
) -> tuple[list[Override], list[Mistake]]:
    """Overrides, of ``KEY=VALUE`` texts or Python values, and mistakes in those without a value."""
    read: list[Override] = []
    mistakes: list[Mistake] = []
    for given in overrides:
        if isinstance(overrides, Mapping):
            key, value = given, _plain(overrides[given])
            shown, hint = f"{given}={value}", "a number, a text, true or false, or a list of them"
            wrong = f"is {overrides[given]!r}; give {hint}"
        else:
            key, _, text = map(str.strip, given.partition("="))
            value, shown = read_value(text) if text else None, given
            wrong = "is not KEY=VALUE; give both"
        if value is None:
            mistakes.append(Mistake(f"{source} {shortened(given)}", wrong))
        else:
            read.append(Override(key, value, f"{source} {shortened(shown)}"))
    return read, mistakes


def read_value(text: str) -> Any:
    """The value of a text: a TOML value, a list of values between commas, or the text itself."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError):
        parts = [part.strip() for part in text.split(",")]
        return text if len(parts) == 1 or text.startswith("[") else [*map(read_value, parts)]


def _plain(value: Any) -> Any:
    """A Python value as TOML has it, or None."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, list | tuple):
        items = [_plain(item) for item in value]
        return None if None in items else items
    value = str(value) if isinstance(value, Path) else value
    return value if isinstance(value, str | int | float) else None
