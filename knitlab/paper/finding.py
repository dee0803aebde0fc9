"""What the test of a claim found in a cube."""

from dataclasses import dataclass

from knitlab.paper.margin import Grade, Verdict, grade_of, verdict_of

Labels = tuple[str | int, ...]
"""Labels of one sample along the cube's dimensions: (4, 16), or ("rib", 4, "periodic")."""


@dataclass(frozen=True)
class Finding:
    """What a test found.

    Attributes:
        margin: distance to the threshold as in :mod:`knitlab.paper.margin`; ``None`` if the claim
            could not be measured.
        text: the measured values that decide it, or what is missing, in words.
        judged: number of designs, stripes, lines or samples that it was judged on.
        wanted: how many the claim is about; 0 if the cube has nothing to do with it.
        counted: what is counted: designs, stripes, lines or samples.
        at: labels of the samples that it was judged on.
        cubes: of several cubes, the number of the one that each of these samples is in.
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
        """The verdict, with near misses apart from other failures."""
        return grade_of(self.margin)

    @property
    def count(self) -> str:
        """What it was judged on: ``12 of 15 designs``; empty if on nothing."""
        return f"{self.judged} of {self.wanted} {self.counted}" if self.judged else ""

    @property
    def measured(self) -> str:
        """The text, and how many samples it is about if some are missing."""
        partial = self.verdict is not Verdict.not_measured and self.judged < self.wanted
        return f"{self.text}; judged on {self.count}" if partial else self.text


class NotMeasured(Exception):
    """The cube has too little to test a claim.

    Attributes:
        finding: the finding without a margin that says what is missing.
    """

    def __init__(self, reason: str, wanted: int = 0, counted: str = "designs") -> None:
        self.finding = Finding(None, reason, 0, wanted, counted)
        super().__init__(reason)
