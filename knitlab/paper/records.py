"""Judgements of claims as table rows, as lines for a terminal, and counted."""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from knitlab.paper.finding import Finding
from knitlab.paper.judgement import Judgement
from knitlab.paper.margin import Grade, Verdict, signed


def counted(judgements: Sequence[Judgement]) -> dict[Grade, int]:
    """How many claims hold, are near misses, fail and are not measured."""
    counts = Counter(its.finding.grade for its in judgements)
    return {grade: counts[grade] for grade in Grade}


def summary(judgements: Sequence[Judgement]) -> str:
    """How many claims hold, are near misses, fail and are not measured, in words."""
    counts = counted(judgements)
    near = counts[Grade.near_miss]
    return (
        f"{counts[Grade.holds]} hold, {near} near miss{'' if near == 1 else 'es'},"
        f" {counts[Grade.fails]} fail, {counts[Grade.not_measured]} not measured"
    )


def listed(judgements: Sequence[Judgement]) -> str:
    """The lines for a terminal: grade, margin, claim and figures, and how many hold."""
    lines = [
        f"{its.finding.grade.value:12}  {signed(its.finding.margin):>8}"
        f"  {its.claim.name}: {its.finding.measured}"
        for its in judgements
    ]
    return "\n".join([*lines, summary(judgements)])


def records(judgements: Sequence[Judgement]) -> list[dict[str, Any]]:
    """One table row a claim.

    All are texts but ``margin``, which is ``None`` where nothing was measured, and the counts
    ``judged`` and ``wanted``.
    """
    return [_record(its) for its in judgements]


def _record(its: Judgement) -> dict[str, Any]:
    words, finding, test = its.claim.words, its.finding, its.claim.test
    samples = its.samples if finding.at else ()
    return {
        "claim": its.claim.name,
        "topic": words.topic,
        "verdict": finding.verdict.value,
        "grade": finding.grade.value,
        "margin": finding.margin,
        "measured": finding.measured,
        "judged": finding.judged,
        "wanted": finding.wanted,
        "counted": finding.counted,
        "text": words.text,
        "measured_along": words.measured_along or "",
        "place": words.place,
        "threshold_of": test.threshold_of,
        "ours": ", ".join(test.ours),
        "change": str(its.change or ""),
        "why_not": (words.why_not or "") if finding.verdict is Verdict.fails else "",
        "figure": words.figure or "",
        "cube": ", ".join(map(str, its.cubes)),
        "boundary": _joined(sample.boundary for sample in samples),
        "unit_cells": _joined(sample.size for sample in samples),
        "reading": _joined(sample.reading for sample in samples),
        "contrary": contrary(its.contrary, str),
    }


def _joined(texts: Iterable[str]) -> str:
    """Different texts, each once."""
    return " | ".join(dict.fromkeys(text for text in texts if text))


def contrary(found: Sequence[tuple[Path, Finding]], name: Callable[[Path], str]) -> str:
    """What cubes say that give another verdict than the one that was preferred, in words.

    Args:
        found: the cubes, and what was found in each.
        name: gives the name that a cube is to be called by.
    """
    return ", ".join(
        f"{finding.verdict.value} at {signed(finding.margin)} on {finding.count} of {name(path)}"
        for path, finding in found
    )
