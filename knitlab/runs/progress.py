"""Progress: a bar over the estimated work of a run, so that its remaining time is realistic."""

import sys
import time
from collections.abc import Mapping
from io import StringIO
from threading import Event, Thread
from typing import TextIO

from tqdm import tqdm

from knitlab.solvers.case import Case
from knitlab.solvers.methods import METHODS

BAR = "{desc} {percentage:3.0f}% |{bar}| {elapsed} elapsed, {remaining} left"
LINE = "{desc}, {percentage:.1f} %, {elapsed} elapsed, {remaining} left"
SECONDS_BETWEEN_LINES = 30.0
SECONDS_BETWEEN_CLOCKS = 1.0  # time between updates of the elapsed time on a terminal


class ProgressBar:
    """A bar over all states of some cases; off a terminal a line every half minute."""

    def __init__(self, cases: Mapping[str, Case], shown: bool, file: TextIO | None = None) -> None:
        file = file or sys.stderr or StringIO()  # a process may have no standard error
        self._cases = cases
        self._states = dict.fromkeys(cases, 0.0)
        self._ended = 0
        self._total = sum(METHODS[case.method].work(case, case.states) for case in cases.values())
        on_terminal = file.isatty()
        self._interval = SECONDS_BETWEEN_CLOCKS if on_terminal else SECONDS_BETWEEN_LINES
        self._closed = Event()
        self._clock = Thread(target=self._refresh_regularly, daemon=True)
        self._bar = tqdm(
            desc=f"0/{len(cases)} cases",
            total=self._total,
            smoothing=0,
            disable=not shown,
            file=file if on_terminal else _LogLines(file),
            bar_format=BAR if on_terminal else LINE,
            mininterval=0.1 if on_terminal else SECONDS_BETWEEN_LINES,
            miniters=0,  # the amount of work of an update is arbitrary
        )

    def __enter__(self) -> "ProgressBar":
        if not self._bar.disable:
            self._clock.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._closed.set()
        if self._clock.is_alive():
            self._clock.join()
        self._bar.close()

    def reached(self, case_id: str, states: float) -> None:
        """Record how many states of a case are done; a fraction is part of a state."""
        case = self._cases[case_id]
        work = METHODS[case.method].work
        advance = work(case, states) - work(case, self._states[case_id])
        if advance > 0:
            self._states[case_id] = states
            # Round-off must not move the bar past its end.
            self._bar.update(min(advance, self._total - self._bar.n))

    def ended(self, case_id: str) -> None:
        """Record that a case has ended, with whatever result."""
        self._ended += 1
        self.reached(case_id, self._cases[case_id].states)
        self._bar.set_description_str(f"{self._ended}/{len(self._cases)} cases", refresh=False)

    def write(self, line: str) -> None:
        """Print a line above the bar."""
        self._bar.write(line, file=sys.stderr)

    def _refresh_regularly(self) -> None:
        while not self._closed.wait(self._interval):
            if time.time() - self._bar.last_print_t >= self._interval:
                self._bar.refresh()
                self._bar.last_print_t = time.time()


class _LogLines:
    """Writes each update of the bar as a line, for output that is not a terminal."""

    def __init__(self, file: TextIO) -> None:
        self._file = file

    def write(self, text: str) -> None:
        if line := text.strip():
            self._file.write(f"{line}\n")
