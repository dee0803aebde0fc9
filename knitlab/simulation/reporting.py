"""Reporting: progress of a search for equilibria, including parts of a state."""

import time
from collections.abc import Callable

Progress = Callable[[str, float], None]
"""Function of a case's identifier and of the number of its finished states, with a fraction."""
SECONDS_BETWEEN_REPORTS = 1.0
USUAL_FACTORISATIONS = 20
"""Number of factorisations after which half of a state is reported as done."""


class Reporter:
    """Reports finished states, and fractions of the next one.

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

    def factorised(self) -> None:
        """Count a factorisation, and report the fraction at most once a second."""
        self._factorisations += 1
        now = time.monotonic()
        if now - self._last >= SECONDS_BETWEEN_REPORTS:
            self._last = now
            fraction = self._factorisations / (self._factorisations + USUAL_FACTORISATIONS)
            self._report(self._states + fraction)
