"""Reporting: progress of a solver, including parts of a state."""

import time
from collections.abc import Callable
from typing import Any

from knitlab.solvers.solver import Factorise, Result, Solver, SolveSubdomains

Progress = Callable[[str, float], None]
"""Function of a case's identifier and of the number of its finished states, with a fraction."""
SECONDS_BETWEEN_REPORTS = 1.0
USUAL_FACTORISATIONS = 20
"""Number of factorisations after which half of a state is reported as done."""


class Reporter:
    """Reports the finished states of a solver, and fractions of the next one.

    The number of factorisations of a state is not known beforehand. The fraction that is reported
    after n factorisations is n / (n + 20), which increases for any number.

    Args:
        report: called with the number of finished states.
    """

    def __init__(self, report: Callable[[float], None]) -> None:
        self._report = report
        self._states = self._factorisations = 0
        self._last = time.monotonic()

    def done(self, states: int) -> None:
        """Report a number of finished states."""
        self._states, self._factorisations = states, 0
        self._report(states)

    def over(self, solver: Solver[Result]) -> Solver[Result]:
        """The same solver, with its progress reported."""
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
            fraction = self._factorisations / (self._factorisations + USUAL_FACTORISATIONS)
            self._report(self._states + fraction)
