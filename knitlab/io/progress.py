"""Progress: a bar on a terminal, lines in a log, and nothing of what ends within two seconds.

Whatever takes long goes through its parts by :func:`each`; a :class:`Progress` shows how many are
done. Nobody else needs to know of the other.
"""

import itertools
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from io import StringIO
from threading import Event, Thread
from typing import Any, TextIO, TypeVar

import numpy as np
from tqdm import tqdm

Item = TypeVar("Item")
Listener = Callable[[float, str], object]
"""Function of the share that is done, from 0 to 1, and of what is being done."""

SECONDS_UNTIL_SHOWN = 2.0
SECONDS_BETWEEN_LINES = 30.0
SECONDS_BETWEEN_CLOCKS = 1.0  # time between updates of the elapsed time on a terminal
BAR = "{desc} {percentage:3.0f}% |{bar}| {elapsed} elapsed{left}"
LINE = "{desc}, {percentage:.1f} %, {elapsed} elapsed{left}"
WITHOUT_TOTAL = "{desc}, {elapsed} elapsed"

_listener: ContextVar[Listener | None] = ContextVar("listener", default=None)
_shown = True


def show_progress(shown: bool) -> None:
    """Choose whether this process shows the progress of what takes more than two seconds.

    Args:
        shown: whether to show it; so it is until this function is called.

    Example:
        >>> kl.show_progress(False)
        >>> kl.show_progress(True)
    """
    global _shown
    _shown = shown


@contextmanager
def listening(listener: Listener) -> Iterator[None]:
    """Call a function of whatever :func:`each` reports."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


@contextmanager
def part(start: float = 0.0, end: float = 1.0, name: str = "") -> Iterator[None]:
    """Count what is reported within as a part of the work, from one share of it to another."""
    outer = _listener.get()
    if outer is None:
        yield
        return

    def inner(share: float, doing: str = "") -> None:
        outer(start + share * (end - start), ", ".join(filter(None, (name, doing))))

    inner(0.0)
    with listening(inner):
        yield
    inner(1.0)


def each(items: Sequence[Item], name: str) -> Iterator[Item]:
    """Go through items that take the same time."""
    count = len(items)
    for number, item in enumerate(items):
        with part(number / count, (number + 1) / count, f"{name} {number + 1}/{count}"):
            yield item


def report(share: float, doing: str) -> None:
    """Report which share of a part of the work is done, and what is being done."""
    if (listener := _listener.get()) is not None:
        listener(share, doing)


def counter(total: int, name: str) -> Callable[[], None]:
    """A function that reports how often it was called, also by other threads."""
    numbers, listener = itertools.count(1), _listener.get()

    def count() -> None:
        number = next(numbers)
        if listener is not None:
            listener(number / total, f"{name} {number}/{total}")

    return count


class Progress:
    """What is done of some work, as :func:`each` or :meth:`reached` reports it.

    Args:
        doing: what is done, as it is shown first.
        shown: whether to show it, after two seconds.
        total: of the work, in any unit; None if it is not known.
        expected: time that the work is expected to take, shown until some is done [s].
        file: where to show it; by default the error stream.
    """

    def __init__(
        self,
        doing: str,
        shown: bool = True,
        total: float | None = 1.0,
        expected: float | None = None,
        file: TextIO | None = None,
    ) -> None:
        file = file or sys.stderr or StringIO()  # a process may have no standard error
        on_terminal = file.isatty()
        self._interval = SECONDS_BETWEEN_CLOCKS if on_terminal else SECONDS_BETWEEN_LINES
        self._closed = Event()
        self._clock = Thread(target=self._refresh_regularly, daemon=True)
        self._file = file
        self._bar = _Bar(
            desc=doing,
            total=total,
            disable=not (shown and _shown),
            file=file if on_terminal else _LogLines(file),
            bar_format=WITHOUT_TOTAL if total is None else BAR if on_terminal else LINE,
            smoothing=0,
            delay=SECONDS_UNTIL_SHOWN,
            mininterval=0.1 if on_terminal else SECONDS_BETWEEN_LINES,
            miniters=0,  # the amount of work of an update is arbitrary
        )
        self._bar.expected = expected

    def __enter__(self) -> "Progress":
        self._listening = listening(self.reached)
        self._listening.__enter__()
        if not self._bar.disable:
            self._clock.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._listening.__exit__(None, None, None)
        self._closed.set()
        if self._clock.is_alive():
            self._clock.join()
        self._bar.close()

    def reached(self, done: float, doing: str = "") -> None:
        """Record how much is done, in all; what was done before is not undone."""
        if doing:
            self._bar.set_description_str(doing, refresh=False)
        # Round-off must not move the bar past its end.
        total = np.inf if self._bar.total is None else self._bar.total
        if (advance := min(done, total) - self._bar.n) > 0:
            self._bar.update(advance)

    def write(self, line: str) -> None:
        """Print a line above the bar."""
        self._bar.write(line, file=self._file)

    def _refresh_regularly(self) -> None:
        wait = SECONDS_UNTIL_SHOWN
        while not self._closed.wait(wait):
            if time.time() - self._bar.last_print_t >= wait:
                self._bar.refresh()
                self._bar.last_print_t = time.time()
            wait = self._interval


class _Bar(tqdm):
    """A bar that knows the expected time before anything is done."""

    expected: float | None = None

    @property
    def format_dict(self) -> dict[str, Any]:
        shown = dict(super().format_dict)
        elapsed, done = shown["elapsed"], shown["n"]
        left = None if self.expected is None else max(self.expected - elapsed, 0.0)
        if done and self.total is not None:
            left = elapsed * (self.total - done) / done
        about = "" if done else "about "
        shown["left"] = "" if left is None else f", {about}{self.format_interval(left)} left"
        return shown


class _LogLines:
    """Writes each update of the bar as a line, for output that is not a terminal."""

    def __init__(self, file: TextIO) -> None:
        self._file = file

    def write(self, text: str) -> None:
        if line := text.strip():
            self._file.write(f"{line}\n")
