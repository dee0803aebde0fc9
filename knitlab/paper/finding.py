"""What the test of a claim found in a cube."""

from dataclasses import dataclass

from knitlab.paper.margin import Grade, Verdict, grade_of, verdict_of

Labels = tuple[str | int, ...]


@dataclass(frozen=True)
class Finding:
    """What a test found.

    Attributes:
        margin: distance to the threshold as in :mod:`knitlab.paper.margin`; ``None`` if the claim
            could not be measured.
        figures: the figures that decide it, in words.
        judged: of how many designs, stripes, lines or samples they are.
        wanted: how many the claim is about; 0 if the cube has nothing to do with it.
        counted: what is counted: designs, stripes, lines or samples.
        at: labels of what was judged along the cube's own dimensions of designs or stripes.
    """

    margin: float | None
    figures: str
    judged: int = 0
    wanted: int = 0
    counted: str = "designs"
    at: tuple[Labels, ...] = ()

    @property
    def verdict(self) -> Verdict:
        """Whether the claim holds."""
        return verdict_of(self.margin)

    @property
    def grade(self) -> Grade:
        """The same, with near misses apart."""
        return grade_of(self.margin)

    @property
    def count(self) -> str:
        """Of how many it was judged: ``12 of 15 designs``; nothing if of none."""
        return f"{self.judged} of {self.wanted} {self.counted}" if self.judged else ""

    @property
    def measured(self) -> str:
        """The figures, and of how many they are if that is not all."""
        partial = self.verdict is not Verdict.not_measured and self.judged < self.wanted
        return f"{self.figures}; judged on {self.count}" if partial else self.figures


def not_measured(figures: str, wanted: int = 0, counted: str = "designs") -> Finding:
    """The finding of a test that had too little to go by."""
    return Finding(None, figures, 0, wanted, counted)
