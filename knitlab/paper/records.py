"""Judgements of claims as table rows."""

from collections.abc import Iterable, Sequence
from typing import Any

from knitlab.paper.judgement import Judgement, contrary
from knitlab.paper.margin import Verdict


def records(judgements: Sequence[Judgement]) -> list[dict[str, Any]]:
    """One table row for each claim.

    All values are texts but ``margin``, which is ``None`` where nothing was measured, and the
    counts ``judged`` and ``wanted``.
    """
    return [_record(its) for its in judgements]


def _record(its: Judgement) -> dict[str, Any]:
    statement, finding = its.claim.statement, its.finding
    samples = its.samples if finding.at else ()
    return {
        "claim": its.claim.name,
        "topic": statement.topic,
        "verdict": finding.verdict.value,
        "grade": finding.grade.value,
        "margin": finding.margin,
        "measured": finding.measured,
        "judged": finding.judged,
        "wanted": finding.wanted,
        "counted": finding.counted,
        "text": statement.text,
        "measured_along": statement.measured_along or "",
        "place": statement.place,
        "threshold_of": its.claim.threshold_of,
        "ours": ", ".join(statement.knitlab),
        "change": its.sensitivity,
        "why_not": (statement.why_not or "") if finding.verdict is Verdict.fails else "",
        "figure": statement.figure or "",
        "cube": ", ".join(map(str, its.cubes)),
        "boundary": _joined(sample.boundary for sample in samples),
        "unit_cells": _joined(sample.size for sample in samples),
        "reading": _joined(sample.options for sample in samples),
        "contrary": contrary(its.contrary, str),
    }


def _joined(texts: Iterable[str]) -> str:
    """Different texts, each once."""
    return " | ".join(dict.fromkeys(text for text in texts if text))
