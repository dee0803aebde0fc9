"""What a user of knitlab may rely on: the claims topic by topic, in sentences."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from knitlab.validation.claims import TOPICS
from knitlab.validation.judgement import Judgement, contrary
from knitlab.validation.margin import GOOD, NEAR, Grade, signed

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


@dataclass(frozen=True)
class TopicSummary:
    """The reliability of the claims of a topic.

    Attributes:
        topic: the topic.
        sentences: pairs of an assessment of reliability and the claims that it applies to.
    """

    topic: str
    sentences: tuple[tuple[str, str], ...]


def introduction(judgements: Sequence[Judgement]) -> list[TopicSummary]:
    """Which claims a user may rely on, topic by topic.

    Claims that hold with a good margin are reliable if all their designs were measured and no other
    cube gives another verdict. Topics without claims are left out.
    """
    topics = []
    for topic in TOPICS:
        groups: dict[str, list[str]] = {group: [] for group in OPENINGS}
        for one in judgements:
            if one.claim.statement.topic == topic:
                groups[reliance(one)].append(_quoted(one))
        sentences = tuple(
            (OPENINGS[group], "; ".join(claims) + ".") for group, claims in groups.items() if claims
        )
        if sentences:
            topics.append(TopicSummary(topic, sentences))
    return topics


def reliance(one: Judgement) -> str:
    """The reliability of a claim: a name of :data:`OPENINGS`."""
    finding = one.finding
    if finding.grade is Grade.not_measured or finding.margin is None:
        return "not measured"
    if finding.grade is not Grade.holds:
        return "near" if finding.grade is Grade.near_miss else "gross"
    if finding.margin < GOOD:
        return "narrow"
    return "reserved" if one.contrary or finding.judged < finding.wanted else "good"


def _quoted(one: Judgement) -> str:
    """The statement, its margin, and its limitations."""
    finding = one.finding
    notes = [signed(finding.margin)]
    if 0 < finding.judged < finding.wanted:
        notes.append(finding.count)
    if one.contrary:
        notes.append(f"but it {contrary(one.contrary, cube_name)}")
    shown = ", ".join(note for note in notes if note)
    return f"“{one.claim.quoted}”" + (f" ({shown})" if shown else "")


def cube_name(path: Path) -> str:
    """The short name of a cube: the last two parts of its path, or of the path of its folder."""
    parts = path.resolve().parts
    parts = parts[:-1] if path.name == "cube.nc" else parts
    return "/".join(parts[-2:]).removesuffix(".nc")
