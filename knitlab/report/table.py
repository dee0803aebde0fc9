"""The table of claims as a page shows it, near misses apart from claims that fail by more."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from knitlab.paper.judgement import Judgement
from knitlab.paper.margin import NEAR, Grade, Verdict, signed
from knitlab.paper.records import contrary
from knitlab.paper.sample import JudgedSamples
from knitlab.report.introduction import TopicSummary, cube_name

COLUMNS = {
    "margin": "margin",
    "text": "what the paper says",
    "along": "along",
    "place": "where",
    "measured": "what was measured",
    "judged_on": "judged on",
    "threshold": "threshold",
    "figure": "figure",
}
WHY_NOT = "why not, as far as it is known"
HEADINGS = {
    Grade.holds: "What holds",
    Grade.near_miss: f"Near misses: they fail by at most {NEAR:g}",
    Grade.fails: f"What fails by more than {NEAR:g}",
    Grade.not_measured: "What was not measured",
}


@dataclass(frozen=True)
class Section:
    """Claims of one grade.

    Attributes:
        grade: the grade.
        columns: heads of the columns, by name.
        rows: the claims, in the order of their file; the cell ``figure`` is the kind of figure.
        claims: their judgements.
    """

    grade: Grade
    columns: dict[str, str]
    rows: tuple[dict[str, str], ...]
    claims: tuple[Judgement, ...]

    @property
    def heading(self) -> str:
        """What stands above it."""
        return HEADINGS[self.grade]


@dataclass(frozen=True)
class Page:
    """What a page of claims says, whatever its format.

    Attributes:
        title: its title.
        said: how many claims hold.
        passages: what a user may rely on, topic by topic.
        sections: the table, grade by grade.
        readings: the short name of every reading.
    """

    title: str
    said: str
    passages: Sequence[TopicSummary]
    sections: Sequence[Section]
    readings: Mapping[str, str]


def sections(judgements: Sequence[Judgement], readings: Mapping[str, str]) -> list[Section]:
    """The claims grade by grade; a grade that no claim has is left out.

    Args:
        judgements: the claims and what was found.
        readings: the short name of every reading.
    """
    found = []
    for grade in Grade:
        claims = tuple(its for its in judgements if its.finding.grade is grade)
        failing = grade in (Grade.near_miss, Grade.fails)
        columns = COLUMNS | ({"why_not": WHY_NOT} if failing else {})
        if claims:
            rows = tuple(_row(its, readings) for its in claims)
            found.append(Section(grade, columns, rows, claims))
    return found


def readings_of(judgements: Sequence[Judgement]) -> dict[str, str]:
    """A letter for every reading of the model that some claim was judged under."""
    texts = dict.fromkeys(
        sample.reading
        for its in judgements
        if its.finding.at
        for sample in its.samples
        if sample.reading
    )
    return {text: _letters(number) for number, text in enumerate(texts)}


def _letters(number: int) -> str:
    """A to Z, then AA and so on."""
    rest, last = divmod(number, 26)
    return (_letters(rest - 1) if rest else "") + chr(ord("A") + last)


def _row(its: Judgement, readings: Mapping[str, str]) -> dict[str, str]:
    words, finding, test = its.claim.words, its.finding, its.claim.test
    measured = finding.verdict is not Verdict.not_measured
    others = contrary(its.contrary, cube_name)
    judged_on = [finding.count, *(_sample(sample, readings) for sample in its.samples)]
    judged_on += [f"but it {others}"] if others else []
    return {
        "margin": signed(finding.margin),
        "text": words.text,
        "along": words.measured_along or "",
        "place": words.place,
        "measured": finding.figures,
        "judged_on": "; ".join(judged_on) if measured else "",
        "threshold": f"{test.threshold_of}'s"
        + (f"; {its.change}" if str(its.change or "") else ""),
        "figure": words.figure or "",
        "why_not": words.why_not or "",
    }


def _sample(sample: JudgedSamples, readings: Mapping[str, str]) -> str:
    name = readings.get(sample.reading)
    size = f"{sample.size} unit cells" if sample.size else ""
    reading = f"reading {name}" if name else ""
    parts = (cube_name(sample.cube), sample.experiment, sample.boundary, size, reading)
    return ", ".join(part for part in parts if part)
