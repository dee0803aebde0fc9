"""Progress: a bar over the work of a run, weighed so that its time left is honest."""

import sys
from types import TracebackType

from tqdm import tqdm

from knitlab.sweep.case import Case
from knitlab.sweep.estimate import work


class ProgressBar:
    """A bar over all states of some cases; a case that ends early is credited in full."""

    def __init__(self, cases: dict[str, Case], shown: bool) -> None:
        self._cases = cases
        self._states = dict.fromkeys(cases, 0)
        self._ended = 0
        self._total = sum(work(case, case.states) for case in cases.values())
        self._bar = tqdm(
            total=self._total,
            smoothing=0,
            disable=not shown,
            bar_format="{desc} {percentage:3.0f}% |{bar}| {elapsed} elapsed, {remaining} left",
        )
        self._describe()

    def __enter__(self) -> "ProgressBar":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._bar.close()

    def reached(self, case_id: str, states: int) -> None:
        """Note that a case has this many of its states."""
        case = self._cases[case_id]
        advance = work(case, states) - work(case, self._states[case_id])
        if advance > 0:
            self._states[case_id] = states
            # Round-off must not carry the bar past its end.
            self._bar.update(min(advance, self._total - self._bar.n))

    def ended(self, case_id: str) -> None:
        """Note that a case has ended, whatever became of it."""
        self._ended += 1
        self.reached(case_id, self._cases[case_id].states)
        self._describe()

    def say(self, sentence: str) -> None:
        """Say something above the bar."""
        self._bar.write(sentence, file=sys.stderr)

    def _describe(self) -> None:
        self._bar.set_description_str(f"{self._ended}/{len(self._cases)} cases")
