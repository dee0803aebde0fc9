"""What a user names of a sweep: a workflow's file, and overrides of its settings. Needs no JAX."""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from knitlab.io.errors import Fault, fault, unknown
from knitlab.io.shipped import shipped

Overrides = Sequence[str] | Mapping[str, Any]
"""``("n_stripe=4", "k_t_factor=0.8,1")`` or ``{"n_stripe": 4, "k_t_factor": [0.8, 1]}``."""


def workflow_file(workflow: str) -> Path:
    """The file of a workflow given by its name or its path; BadInput if there is none."""
    named, path = shipped("workflows") / f"{workflow}.toml", Path(workflow)
    if named.is_file():
        return named
    if path.is_file():
        return path
    names = [file.stem for file in shipped("workflows").glob("*.toml")]
    raise fault(workflow, f"is not a file, and {unknown(path.stem, names, 'workflow')}")


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
) -> tuple[list[Override], list[Fault]]:
    """Overrides, of ``KEY=VALUE`` texts or Python values, and faults of those without a value."""
    read: list[Override] = []
    faults: list[Fault] = []
    if isinstance(overrides, Mapping):
        for key, value in overrides.items():
            try:
                read.append(Override(key, _plain(value), f"{source} {key}={_plain(value)}"))
            except TypeError:
                problem = f"is {value!r}; give a number, a text, true or false, or a list of them"
                faults.append(Fault(f"{source} {key}", problem))
        return read, faults
    for given in overrides:
        key, _, text = map(str.strip, given.partition("="))
        if text:
            read.append(Override(key, read_value(text), f"{source} {given}"))
        else:
            faults.append(Fault(f"{source} {given}", "is not KEY=VALUE; give both"))
    return read, faults


def read_value(text: str) -> Any:
    """The value of a text: a TOML value, a list of values between commas, or the text itself."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        parts = [part.strip() for part in text.split(",")]
        return text if len(parts) == 1 or text.startswith("[") else [*map(read_value, parts)]


def _plain(value: Any) -> Any:
    """A Python value as TOML has it."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, Path):
        return str(value)
    if not isinstance(value, str | int | float):
        raise TypeError
    return value
