"""Overrides: settings that replace a workflow's, as ``KEY=VALUE`` text or as Python values."""

import json
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from knitlab.io.errors import BadInput, Fault

Overrides = Sequence[str] | Mapping[str, Any]
"""``("n_stripe=4", "k_t_factor=0.8,1")`` or ``{"n_stripe": 4, "k_t_factor": [0.8, 1]}``."""


def as_text(overrides: Overrides) -> tuple[str, ...]:
    """Overrides as the ``KEY=VALUE`` text of ``--set``, which is stored in ``plan.json``.

    Args:
        overrides: such text, or Python values by the name of their setting: numbers, text, paths,
            booleans, and lists, tuples or arrays of them.

    Returns:
        One text for each setting; read back, it gives the same values.

    Raises:
        BadInput: if values cannot be those of a setting; it lists them all.

    Example:
        >>> as_text({"n_stripe": 4, "boundary": ["periodic", "clamped"]})
        ('n_stripe=4', 'boundary=["periodic", "clamped"]')
    """
    if not isinstance(overrides, Mapping):
        return tuple(overrides)
    texts, faults = [], []
    for key, value in overrides.items():
        plain = _plain(value)
        try:
            bare = isinstance(plain, str) and read_value(plain) == plain == plain.strip()
            texts.append(f"{key}={plain if bare else _toml(plain)}")
        except TypeError:
            problem = f"is {value!r}; give a number, a text, true or false, or a list of them"
            faults.append(Fault(f"settings {key}", problem))
    if faults:
        raise BadInput(faults)
    return tuple(texts)


def read_value(text: str) -> Any:
    """The value of a text: a TOML value, a list of values between commas, or the text itself."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        parts = [part.strip() for part in text.split(",")]
        return text if len(parts) == 1 or text.startswith("[") else [*map(read_value, parts)]


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return str(value) if isinstance(value, Path) else value


def _toml(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, float):
        return repr(value)
    if isinstance(value, str | int):
        return json.dumps(value, ensure_ascii=False)
    raise TypeError
