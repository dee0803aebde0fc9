"""Progress of the cases of a run, in the time that they are expected to take."""

from collections.abc import Mapping
from typing import TextIO

from knitlab.io.progress import Progress
from knitlab.runs.batches import seconds_of_states, seconds_to_measure
from knitlab.solvers.case import Case


class CaseProgress:
    """Shows how much of some cases is done; ``at_once`` of them run at the same time.

    After its states, a case is measured.
    """

    def __init__(
        self,
        cases: Mapping[str, Case],
        shown: bool = True,
        at_once: int = 1,
        file: TextIO | None = None,
    ) -> None:
        self._cases = cases
        self._to_measure = {name: seconds_to_measure(case) for name, case in cases.items()}
        self._done = dict.fromkeys(cases, 0.0)  # seconds
        self._all_done = 0.0
        self._ended = 0
        total = sum(self._seconds(name, case.states + 1) for name, case in cases.items())
        self._progress = Progress(self._words(), shown, total, total / max(at_once, 1), file)

    def __enter__(self) -> "CaseProgress":
        self._progress.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self._progress.__exit__(*error)

    def reached(self, case_id: str, states: float, doing: str = "") -> None:
        """Record how many states of a case are done, and what is done with it after them."""
        # Those of unloading are beyond its states.
        self._advance(case_id, states if doing else min(states, self._cases[case_id].states))
        self._progress.reached(self._all_done, self._words(doing))

    def ended(self, case_id: str) -> None:
        """Record that a case has ended, with whatever result."""
        self._ended += 1
        self._advance(case_id, self._cases[case_id].states + 1)
        self._progress.reached(self._all_done, self._words())

    def write(self, line: str) -> None:
        """Print a line above the bar."""
        self._progress.write(line)

    def _advance(self, case_id: str, states: float) -> None:
        advance = max(self._seconds(case_id, states) - self._done[case_id], 0.0)
        self._done[case_id] += advance
        self._all_done += advance

    def _seconds(self, case_id: str, states: float) -> float:
        case = self._cases[case_id]
        measured = min(max(states - case.states, 0.0), 1.0)
        return (
            seconds_of_states(case, min(states, case.states)) + measured * self._to_measure[case_id]
        )

    def _words(self, doing: str = "") -> str:
        return f"{self._ended}/{len(self._cases)} cases" + (f", {doing}" if doing else "")
