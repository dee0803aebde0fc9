"""Errors in the user's input, collected so that one message lists them all."""

import difflib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from pydantic import ValidationError
from pydantic_core import ErrorDetails


@dataclass(frozen=True)
class Fault:
    """One error in the input: its place, and the problem with its remedy."""

    path: str
    problem: str

    def __str__(self) -> str:
        return f"{self.path}: {self.problem}"


MOST_NAMES = 20
"""Largest number of names that a message lists."""
SINGLE_VALUES = ("bool_type", "float_type", "int_type", "literal_error", "string_type")
"""Pydantic's error types for values that should be a single one."""


class BadInput(Exception):
    """Input that cannot be used; carries every fault that was found."""

    def __init__(self, faults: Iterable[Fault]) -> None:
        self.faults = tuple(faults)
        super().__init__("\n".join(map(str, self.faults)))

    def __reduce__(self) -> tuple[type["BadInput"], tuple[tuple["Fault", ...]]]:
        """Pickle it by its faults, as workers return it."""
        return type(self), (self.faults,)


class CannotWrite(BadInput):
    """A file that cannot be written, so that continuing is pointless."""


class ErrorCollector:
    """Collects the faults of several checks, each run in ``with collector:``."""

    def __init__(self) -> None:
        self.all: list[Fault] = []

    def __enter__(self) -> None:
        """Begin a check."""

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> bool:
        self.all += error.faults if isinstance(error, BadInput) else ()
        return isinstance(error, BadInput)


def fault(path: str, problem: str) -> BadInput:
    """A :class:`BadInput` with a single fault."""
    return BadInput([Fault(path, problem)])


def faults_of(
    error: ValidationError, source: str, known: Mapping[str, str] | None = None
) -> list[Fault]:
    """The faults that pydantic found in input from ``source``.

    For a misspelt or misplaced key they suggest one of the known keys, given with its table.
    """
    return [
        Fault(
            _path(source, entry["loc"]),
            _misplaced(str(entry["loc"][-1]), known)
            if known and entry["type"] == "extra_forbidden"
            else _problem(entry),
        )
        for entry in _reported(error)
    ]


def _misplaced(key: str, known: Mapping[str, str]) -> str:
    if key not in known:
        return unknown(key, known, "setting")
    return f"belongs to {f'[{known[key]}]' if known[key] else 'the top level'}; move it"


def _reported(error: ValidationError) -> list[ErrorDetails]:
    """Pydantic's errors, without those that only follow from others: lists left empty by them."""
    found = error.errors()
    inner = {entry["loc"][:-1] for entry in found}
    return [
        entry for entry in found if not (entry["type"] == "too_short" and entry["loc"] in inner)
    ]


def _path(source: str, location: tuple[int | str, ...]) -> str:
    return ": ".join(part for part in (source, ".".join(map(str, location))) if part)


def _problem(entry: ErrorDetails) -> str:
    kind, given = entry["type"], entry["input"]
    if kind == "missing":
        return "is missing; add it"
    if kind == "extra_forbidden":
        return "is not a known key; remove it or check its spelling"
    if isinstance(given, list) and kind in SINGLE_VALUES:
        if isinstance(entry["loc"][-1], int):
            return f"is a list within a list, {given!r}; remove one pair of brackets"
        return f"is a list, {given!r}; give one value"
    if kind == "value_error":
        return _uncapitalised(str(entry["ctx"]["error"]))
    return f"{_uncapitalised(entry['msg'])}, but is {given!r}"


def _uncapitalised(text: str) -> str:
    return text[:1].lower() + text[1:]


def unknown(name: str, known: Iterable[str], kind: str = "") -> str:
    """Message that no name of a kind, such as "setting", is this, with similar or all names."""
    names = sorted(known)
    problem = f"there is no {kind} {name!r}" if kind else f"there is no {name!r}"
    by_case = {each.casefold(): each for each in names}
    nearest = difflib.get_close_matches(name.casefold(), by_case, n=2)
    if nearest:
        return f"{problem}; did you mean {' or '.join(repr(by_case[near]) for near in nearest)}?"
    if len(names) > MOST_NAMES:
        return f"{problem}; it is not one of the {len(names)} known ones; check its spelling"
    return f"{problem}; choose from {', '.join(names)}"
