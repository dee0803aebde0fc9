"""Findings: results of the tests of claims."""

from dataclasses import dataclass

from knitlab.validation.margin import Grade, Verdict, grade_of, verdict_of

Labels = tuple[str | int, ...]
"""Labels of one sample along the cube's dimensions: (4, 16), or ("rib", 4, "periodic")."""


@dataclass(frozen=True)
class Finding:
    """The result of a test.

    Attributes:
        margin: distance to the threshold as in :mod:`.margin`; ``None`` if the claim
            could not be measured.
        text: the values that decide it, or what is missing.
        judged: number of designs, stripes, lines or samples that it was judged on.
        wanted: number that the claim is about; 0 if the cube has none of them.
        counted: what is counted: designs, stripes, lines or samples.
        at: labels of the samples that it was judged on.
        cubes: for a test on several cubes, the index of the cube of each of these samples.
    """

    margin: float | None
    text: str
    judged: int = 0
    wanted: int = 0
    counted: str = "designs"
    at: tuple[Labels, ...] = ()
    cubes: tuple[int, ...] = ()

    @property
    def verdict(self) -> Verdict:
        """Whether the claim holds."""
        return verdict_of(self.margin)

    @property
    def grade(self) -> Grade:
        """The verdict, with near misses separate from other failures."""
        return grade_of(self.margin)

    @property
    def count(self) -> str:
        """What it was judged on: ``12 of 15 designs``; empty if on nothing."""
        return f"{self.judged} of {self.wanted} {self.counted}" if self.judged else ""

    @property
    def measured(self) -> str:
        """The text, with the number of samples if some are missing."""
        partial = self.verdict is not Verdict.not_measured and self.judged < self.wanted
        return f"{self.text}; judged on {self.count}" if partial else self.text


class NotMeasured(Exception):
    """The cube has too little to test a claim.

    Attributes:
        finding: a finding without a margin that states what is missing.
    """

    def __init__(self, reason: str, wanted: int = 0, counted: str = "designs") -> None:
        self.finding = Finding(None, reason, 0, wanted, counted)
        super().__init__(reason)
