"""Errors in the user's input, collected so that one message lists them all."""

import difflib
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from knitlab.io.limits import MAX_CHOICES, MAX_LISTED, MAX_SHOWN


@dataclass(frozen=True)
class Mistake:
    """One mistake in the input: where it is, what is wrong, and what to do."""

    path: str
    message: str

    def __str__(self) -> str:
        return f"{self.path}: {self.message}"


class InputError(ValueError):
    """Invalid input; carries every mistake that was found."""

    def __init__(self, mistakes: Iterable[Mistake]) -> None:
        self.mistakes = tuple(mistakes)
        super().__init__(self.mistakes)

    def __str__(self) -> str:
        return "\n".join(map(str, self.mistakes))


BadInput = InputError  # the name until version 0.1
"""Deprecated: :class:`InputError`."""


class MachineError(InputError):
    """What this machine or its environment prevents, whatever the design."""


class CannotWrite(MachineError):
    """A file that cannot be written."""


class ErrorCollector:
    """Collects the mistakes of several checks, each run in ``with collector:``."""

    def __init__(self) -> None:
        self.all: list[Mistake] = []

    def __enter__(self) -> None:
        """Begin a check."""

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> bool:
        self.all += error.mistakes if isinstance(error, InputError) else ()
        return isinstance(error, InputError)


def invalid(path: str, message: str) -> InputError:
    """An :class:`InputError` with a single mistake."""
    return InputError([Mistake(path, message)])


def raise_if_any(mistakes: Collection[Mistake]) -> None:
    """Raise :class:`InputError` with mistakes, if there are any."""
    if mistakes:
        raise InputError(mistakes)


def pydantic_mistakes(
    error: ValidationError, source: str, known: Mapping[str, str] | None = None
) -> list[Mistake]:
    """Mistakes that pydantic reports; for a misspelt key, with the nearest known one."""
    entries = error.errors()
    # Without those that only follow from others: lists that these left empty.
    inner = {entry["loc"][:-1] for entry in entries}
    mistakes: list[Mistake] = []
    for entry in entries[:MAX_LISTED]:
        cause = entry.get("ctx", {}).get("error")
        if isinstance(cause, InputError):
            mistakes += cause.mistakes
        elif entry["type"] != "too_short" or entry["loc"] not in inner:
            key = shortened(".".join(map(str, entry["loc"])))
            where = ": ".join(filter(None, (source, key)))
            mistakes.append(Mistake(where, _message(entry, known or {})))
    return mistakes


@contextmanager
def naming(source: str) -> Iterator[None]:
    """Raise what pydantic or a ValueError says of a value as InputError that names its source."""
    try:
        yield
    except InputError:
        raise
    except ValidationError as error:
        raise InputError(pydantic_mistakes(error, source)) from error
    except ValueError as error:
        raise invalid(source, str(error)) from error


def _message(entry: ErrorDetails, known: Mapping[str, str]) -> str:
    kind, given, key = entry["type"], entry["input"], entry["loc"][-1] if entry["loc"] else ""
    if kind == "missing":
        return "is missing; add it"
    if kind == "extra_forbidden" and key in known:
        table = known[str(key)]
        return f"belongs to {f'[{table}]' if table else 'the top level'}; move it"
    if kind == "extra_forbidden":
        hint = "is not a known key; remove it or check its spelling"
        return unknown(str(key), known, "setting") if known else hint
    single_values = ("bool_type", "float_type", "int_type", "literal_error", "string_type")
    if isinstance(given, list) and kind in single_values:
        if isinstance(key, int):
            return f"is a list within a list, {shown(given)}; remove one pair of brackets"
        return f"is a list, {shown(given)}; give one value"
    text = f"{entry['msg']}, but is {shown(given)}"
    if kind == "value_error":
        text = str(entry["ctx"]["error"])
    return text[:1].lower() + text[1:]


def failed_import(error: BaseException) -> str:
    """The library whose import raised an error, of whatever type; empty if none did."""
    modules = list[str]()
    trace = error.__traceback__
    while trace is not None:
        if trace.tb_frame.f_code.co_name == "<module>":
            modules.append(trace.tb_frame.f_globals["__name__"])
        trace = trace.tb_next
    if isinstance(error, ImportError) and error.name:
        modules.append(error.name)
    libraries = (module.partition(".")[0] for module in modules)
    return next((each for each in libraries if each not in ("knitlab", "__main__")), "")


def shown(value: object) -> str:
    """A value as it is written in Python, without the rest of a long one."""
    try:
        text = repr(value)
    except ValueError:  # of a whole number of thousands of digits
        text = "a number too long to show"
    return shortened(text)


def shortened(text: str) -> str:
    """A text without the rest of a long one."""
    return text if len(text) <= MAX_SHOWN else f"{text[:MAX_SHOWN]}…"


def unknown(name: str, known: Iterable[str], kind: str = "") -> str:
    """Message that no name of a kind, such as "setting", is this, with similar or all names."""
    names = sorted(known)
    message = f"there is no {kind} {shown(name)}" if kind else f"there is no {shown(name)}"
    by_case = {each.casefold(): each for each in names}
    nearest = difflib.get_close_matches(name.casefold(), by_case, n=2)
    if nearest:
        return f"{message}; did you mean {' or '.join(repr(by_case[near]) for near in nearest)}?"
    if len(names) > MAX_CHOICES:
        return f"{message}; it is not one of the {len(names)} known ones; check its spelling"
    return f"{message}; choose from {', '.join(names)}"
