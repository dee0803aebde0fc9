"""Errors in the user's input, collected so that one message lists them all."""

import difflib
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass

from pydantic import ValidationError
from pydantic_core import ErrorDetails


@dataclass(frozen=True)
class Fault:
    """One error in the input: where it is, and the problem with its remedy."""

    path: str
    problem: str

    def __str__(self) -> str:
        return f"{self.path}: {self.problem}"


MOST = 200  # faults of a file that a message lists
LONGEST = 500  # characters of a value that a message shows
MOST_NAMES = 20  # largest number of names that a message lists
SINGLE_VALUES = ("bool_type", "float_type", "int_type", "literal_error", "string_type")
"""Pydantic's error types for values that should be a single one."""


class BadInput(Exception):
    """Input that cannot be used; carries every fault that was found."""

    def __init__(self, faults: Iterable[Fault]) -> None:
        self.faults = tuple(faults)
        super().__init__(self.faults)

    def __str__(self) -> str:
        return "\n".join(map(str, self.faults))


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


def raise_any(faults: Collection[Fault]) -> None:
    """Raise :class:`BadInput` with faults, if there are any."""
    if faults:
        raise BadInput(faults)


def faults_of(
    error: ValidationError, source: str, known: Mapping[str, str] | None = None
) -> list[Fault]:
    """Faults that pydantic reports, with the nearest known key, of a table, for a misspelt one."""
    entries = error.errors()
    # Without those that only follow from others: lists that these left empty.
    inner = {entry["loc"][:-1] for entry in entries}
    return [
        Fault(
            ": ".join(filter(None, (source, shortened(".".join(map(str, entry["loc"])))))), problem
        )
        for entry, problem in ((entry, _problem(entry, known or {})) for entry in entries[:MOST])
        if entry["type"] != "too_short" or entry["loc"] not in inner
    ]


@contextmanager
def naming(source: str) -> Iterator[None]:
    """Raise what pydantic or a ValueError says of a value as BadInput that names its source."""
    try:
        yield
    except ValidationError as error:
        raise BadInput(faults_of(error, source)) from error
    except ValueError as error:
        raise fault(source, str(error)) from error


def _problem(entry: ErrorDetails, known: Mapping[str, str]) -> str:
    kind, given, key = entry["type"], entry["input"], entry["loc"][-1] if entry["loc"] else ""
    if kind == "missing":
        return "is missing; add it"
    if kind == "extra_forbidden" and key in known:
        table = known[str(key)]
        return f"belongs to {f'[{table}]' if table else 'the top level'}; move it"
    if kind == "extra_forbidden":
        remedy = "is not a known key; remove it or check its spelling"
        return unknown(str(key), known, "setting") if known else remedy
    if isinstance(given, list) and kind in SINGLE_VALUES:
        if isinstance(key, int):
            return f"is a list within a list, {shown(given)}; remove one pair of brackets"
        return f"is a list, {shown(given)}; give one value"
    of_value = kind == "value_error"
    text = str(entry["ctx"]["error"]) if of_value else f"{entry['msg']}, but is {shown(given)}"
    return text[:1].lower() + text[1:]


def shown(value: object) -> str:
    """A value as it is written in Python, without the rest of a long one."""
    try:
        text = repr(value)
    except ValueError:  # of a whole number of thousands of digits
        text = "a number too long to show"
    return shortened(text)


def shortened(text: str) -> str:
    """A text without the rest of a long one."""
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}…"


def unknown(name: str, known: Iterable[str], kind: str = "") -> str:
    """Message that no name of a kind, such as "setting", is this, with similar or all names."""
    names = sorted(known)
    problem = f"there is no {kind} {shown(name)}" if kind else f"there is no {shown(name)}"
    by_case = {each.casefold(): each for each in names}
    nearest = difflib.get_close_matches(name.casefold(), by_case, n=2)
    if nearest:
        return f"{problem}; did you mean {' or '.join(repr(by_case[near]) for near in nearest)}?"
    if len(names) > MOST_NAMES:
        return f"{problem}; it is not one of the {len(names)} known ones; check its spelling"
    return f"{problem}; choose from {', '.join(names)}"
