"""The threshold of a claim: whose number it is, and what a quarter more or less would change."""

from dataclasses import dataclass
from typing import Any, ClassVar, Literal, Self

import xarray as xr
from pydantic import Field, model_validator

from knitlab.io.strict_model import StrictModel
from knitlab.paper.finding import Finding
from knitlab.paper.margin import Verdict

QUARTER = (0.75, 1.25)
"""Factors on knitlab's own numbers, to see whether a verdict depends on them."""


class ClaimCheck(StrictModel):
    """What the tests of claims have in common.

    Attributes:
        threshold_of: whether the threshold is a number, or an order, of the paper, or holds a
            number of knitlab's own.
        ours: fields with knitlab's own numbers.
    """

    paper_boundary: ClassVar[str] = "clamped"

    threshold_of: Literal["paper", "knitlab"]
    ours: tuple[str, ...] = Field(default=(), strict=False)

    @model_validator(mode="after")
    def _ours_are_numbers(self) -> Self:
        for name in self.ours:
            if not isinstance(getattr(self, name, None), float):
                raise ValueError(f"ours names {name!r}, which is no number of this test")
        if (self.threshold_of == "knitlab") != bool(self.ours):
            raise ValueError(
                'ours names the numbers of a threshold_of = "knitlab", and of no other'
            )
        return self

    def finding(self, cube: xr.Dataset) -> Finding:
        """What a cube says."""
        raise NotImplementedError

    def boundary_of_paper(self) -> str:
        """Boundary of the samples that the paper made the statement of."""
        return self.paper_boundary

    def scaled(self, factor: float) -> Self:
        """The same test with knitlab's own numbers multiplied by a factor."""
        return self.model_copy(update=self.scaled_numbers(factor))

    def scaled_numbers(self, factor: float) -> dict[str, Any]:
        """The fields that :meth:`scaled` changes, with their new values."""
        return {name: factor * getattr(self, name) for name in self.ours}


@dataclass(frozen=True)
class Change:
    """What other numbers of knitlab's own would change.

    Attributes:
        now: the verdict.
        less: the verdict with these numbers at 0.75 of what they are.
        more: the verdict with them at 1.25.
    """

    now: Verdict
    less: Verdict
    more: Verdict

    def __str__(self) -> str:
        """In words."""
        if self.now is Verdict.not_measured:
            return ""
        changed = [
            f"{_WOULD[verdict]} at {factor - 1:+.0%}"
            for factor, verdict in zip(QUARTER, (self.less, self.more), strict=True)
            if verdict is not self.now
        ]
        return ", ".join(changed) or "the same at -25% and at +25%"


_WOULD = {
    Verdict.holds: "would hold",
    Verdict.fails: "would fail",
    Verdict.not_measured: "would not be measured",
}


def change(test: ClaimCheck, cube: xr.Dataset, now: Verdict) -> Change | None:
    """The verdicts of a test with knitlab's own numbers a quarter smaller and larger.

    Args:
        test: the test.
        cube: the cube that it was judged on.
        now: its verdict there.

    Returns:
        The verdicts, or ``None`` if no number of the test is knitlab's own.
    """
    if not test.ours:
        return None
    less, more = (test.scaled(factor).finding(cube).verdict for factor in QUARTER)
    return Change(now, less, more)
