"""The table of claims, with near misses separate from claims that fail by more."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from knitlab.figures.report.introduction import TopicSummary, cube_name
from knitlab.validation.judged_samples import JudgedSamples
from knitlab.validation.judgement import Judgement, contrary
from knitlab.validation.margin import NEAR, Grade, Verdict, signed

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
        columns: headings of the columns, by name.
        rows: the claims, in the order of their file; the cell ``figure`` is the kind of figure.
        claims: their judgements.
    """

    grade: Grade
    columns: dict[str, str]
    rows: tuple[dict[str, str], ...]
    claims: tuple[Judgement, ...]

    @property
    def heading(self) -> str:
        """Heading of the section."""
        return HEADINGS[self.grade]


@dataclass(frozen=True)
class Page:
    """Content of a page of claims, in any format.

    Attributes:
        title: its title.
        summary: numbers of claims by verdict.
        topics: what a user may rely on, topic by topic.
        sections: the table, grade by grade.
        options: a letter for every set of model options.
    """

    title: str
    summary: str
    topics: Sequence[TopicSummary]
    sections: Sequence[Section]
    options: Mapping[str, str]


def sections(judgements: Sequence[Judgement], options: Mapping[str, str]) -> list[Section]:
    """The claims grade by grade, without empty grades.

    Args:
        judgements: the claims and their verdicts.
        options: a letter for every set of model options, by their text.
    """
    found = []
    for grade in Grade:
        claims = tuple(one for one in judgements if one.finding.grade is grade)
        failing = grade in (Grade.near_miss, Grade.fails)
        columns = COLUMNS | ({"why_not": WHY_NOT} if failing else {})
        if claims:
            rows = tuple(_row(one, options) for one in claims)
            found.append(Section(grade, columns, rows, claims))
    return found


def options_of(judgements: Sequence[Judgement]) -> dict[str, str]:
    """A letter for every set of model options of the judged samples, by their text."""
    texts = dict.fromkeys(
        sample.options
        for its in judgements
        if its.finding.at
        for sample in its.samples
        if sample.options
    )
    return {text: _letters(number) for number, text in enumerate(texts)}


def _letters(number: int) -> str:
    """A to Z, then AA and so on."""
    rest, last = divmod(number, 26)
    return (_letters(rest - 1) if rest else "") + chr(ord("A") + last)


def _row(its: Judgement, options: Mapping[str, str]) -> dict[str, str]:
    statement, finding = its.claim.statement, its.finding
    measured = finding.verdict is not Verdict.not_measured
    others = contrary(its.contrary, cube_name)
    judged_on = [finding.count, *(_sample(sample, options) for sample in its.samples)]
    judged_on += [f"but it {others}"] if others else []
    return {
        "margin": signed(finding.margin),
        "text": statement.text,
        "along": statement.measured_along or "",
        "place": statement.place,
        "measured": finding.text,
        "judged_on": "; ".join(judged_on) if measured else "",
        "threshold": "; ".join(filter(None, [f"{its.claim.threshold_of}'s", its.sensitivity])),
        "figure": statement.figure or "",
        "why_not": statement.why_not or "",
    }


def _sample(sample: JudgedSamples, options: Mapping[str, str]) -> str:
    letter = options.get(sample.options)
    size = f"{sample.size} unit cells" if sample.size else ""
    chosen = f"options {letter}" if letter else ""
    parts = (cube_name(sample.cube), sample.experiment, sample.boundary, size, chosen)
    return ", ".join(part for part in parts if part)
