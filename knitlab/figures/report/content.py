"""What the page of claims says: the reliability of claims in sentences, and a table row for each.

Near misses are separate from claims that fail by more.
"""

from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path

from knitlab.validation.claims import TOPICS
from knitlab.validation.judgement import Judgement, contrary
from knitlab.validation.margin import GOOD, NEAR, Grade, signed
from knitlab.validation.samples import JudgedSamples

EXPLAINED = (
    "A margin says how far a claim is from its threshold: it holds at 0 and above, and fails below."
    f" The scale is the threshold itself, or the spread of what is compared: {-NEAR:+g} misses a"
    " limit by a quarter of it. A claim about many designs has the margin of the worst of them."
    f" From {GOOD:+g} on the margin is good; from {-NEAR:+g} to 0 the claim is a near miss."
)
OPENINGS = {
    "good": "You may rely on this",
    "reserved": "This holds with a good margin, but designs are missing or another cube disagrees",
    "narrow": "This holds, but only just",
    "near": "Be careful, this is narrowly missed",
    "gross": "Do not rely on this",
    "not measured": "Nothing is known here about this",
}
HEADINGS = {
    Grade.holds: "What holds",
    Grade.near_miss: f"Near misses: they fail by at most {NEAR:g}",
    Grade.fails: f"What fails by more than {NEAR:g}",
    Grade.not_measured: "What was not measured",
}
FIGURE = "figure"
"""Column of the name of a claim's figure."""
WHY_NOT = "why not, as far as it is known"
"""Column of claims that fail."""


def introduction(judgements: Sequence[Judgement]) -> dict[str, list[tuple[str, str]]]:
    """Which claims a user may rely on: pairs of an assessment and its claims, topic by topic."""
    topics: dict[str, list[tuple[str, str]]] = {}
    for topic, (group, opening) in product(TOPICS, OPENINGS.items()):
        claims = [
            _quoted(one)
            for one in judgements
            if one.claim.topic == topic and reliance(one) == group
        ]
        if claims:
            topics.setdefault(topic, []).append((opening, "; ".join(claims) + "."))
    return topics


def reliance(one: Judgement) -> str:
    """The reliability of a claim: a name of :data:`OPENINGS`.

    A claim that holds with a good margin is reliable if all its designs were measured and no other
    cube gives another verdict.
    """
    result = one.result
    if result.margin is None:
        return "not measured"
    if result.grade is not Grade.holds:
        return "near" if result.grade is Grade.near_miss else "gross"
    if result.margin < GOOD:
        return "narrow"
    return "reserved" if one.contrary or result.judged < result.wanted else "good"


def _quoted(one: Judgement) -> str:
    """The statement, its margin, and its limitations."""
    result = one.result
    notes = [
        signed(result.margin),
        result.count if result.judged < result.wanted else "",
        f"but it {contrary(one.contrary, cube_name)}" if one.contrary else "",
    ]
    shown = ", ".join(filter(None, notes))
    return f"“{one.claim.quoted}”" + (f" ({shown})" if shown else "")


def cube_name(path: Path) -> str:
    """The short name of a cube: the last two parts of its path, or of the path of its folder."""
    parts = path.resolve().parts
    parts = parts[:-1] if path.name == "cube.nc" else parts
    return "/".join(parts[-2:]).removesuffix(".nc")


def letters_of_options(judgements: Sequence[Judgement]) -> dict[str, str]:
    """A letter for every set of model options of the judged samples, by their text."""
    samples = [sample for one in judgements if one.result.at for sample in one.samples]
    texts = dict.fromkeys(sample.options for sample in samples if sample.options)
    return {text: _letters(number) for number, text in enumerate(texts)}


def _letters(number: int) -> str:
    """A to Z, then AA and so on."""
    rest, last = divmod(number, 26)
    return (_letters(rest - 1) if rest else "") + chr(ord("A") + last)


def row(one: Judgement, letters: Mapping[str, str]) -> dict[str, str]:
    """The cells of a claim by the heading of their column; letters stand for model options."""
    claim, result = one.claim, one.result
    judged_on = [result.count, *(_sample(sample, letters) for sample in one.samples)]
    if one.contrary:
        judged_on.append(f"but it {contrary(one.contrary, cube_name)}")
    cells = {
        "margin": signed(result.margin),
        "what the paper says": claim.text,
        "along": claim.measured_along or "",
        "where": claim.place,
        "what was measured": result.text,
        "judged on": "" if result.margin is None else "; ".join(judged_on),
        "threshold": "; ".join(filter(None, [f"{claim.threshold_of}'s", one.sensitivity])),
        FIGURE: claim.figure or "",
    }
    failing = result.grade in (Grade.near_miss, Grade.fails)
    return cells | ({WHY_NOT: claim.why_not or ""} if failing else {})


def _sample(sample: JudgedSamples, letters: Mapping[str, str]) -> str:
    letter = letters.get(sample.options)
    size = f"{sample.size} unit cells" if sample.size else ""
    options = f"options {letter}" if letter else ""
    return ", ".join(
        filter(None, (cube_name(sample.cube), sample.experiment, sample.boundary, size, options))
    )
