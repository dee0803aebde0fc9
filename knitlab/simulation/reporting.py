"""Reporting: how far a solver has come, on the way to a state too."""

import time
from collections.abc import Callable
from typing import Any

from knitlab.solvers.solver import Factorise, Result, Solver, SolveSubdomains

Progress = Callable[[str, float], None]
"""Takes a case's identifier and how many of its states are done, with the part of the next one."""
SECONDS_BETWEEN_REPORTS = 1.0
USUAL_FACTORISATIONS = 20
"""After which half of the way to a state is taken to be done."""


class Reporter:
    """Reports the states of a solver, and between them the part of the next one.

    How many factorisations a state takes is not known before; the part that is reported after n of
    them is n / (n + 20), which grows however many there are.

    Args:
        report: takes how many states are done.
    """

    def __init__(self, report: Callable[[float], None]) -> None:
        self._report = report
        self._states = self._factorisations = 0
        self._last = time.monotonic()

    def done(self, states: int) -> None:
        """Note that so many states are done."""
        self._states, self._factorisations = states, 0
        self._report(states)

    def over(self, solver: Solver[Result]) -> Solver[Result]:
        """The same solver, reported on."""
        answer: Any = None
        while True:
            try:
                request = solver.send(answer)
            except StopIteration as end:
                return end.value
            if isinstance(request, Factorise | SolveSubdomains):
                self._factorised()
            answer = yield request

    def _factorised(self) -> None:
        self._factorisations += 1
        now = time.monotonic()
        if now - self._last >= SECONDS_BETWEEN_REPORTS:
            self._last = now
            part = self._factorisations / (self._factorisations + USUAL_FACTORISATIONS)
            self._report(self._states + part)
