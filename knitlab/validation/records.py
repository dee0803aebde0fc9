"""Judgements of claims as table rows."""

from collections.abc import Iterable, Sequence
from typing import Any

from knitlab.validation.judgement import Judgement, contrary
from knitlab.validation.margin import Verdict


def records(judgements: Sequence[Judgement]) -> list[dict[str, Any]]:
    """One table row for each claim.

    All values are texts but ``margin``, which is ``None`` where nothing was measured, and the
    counts ``judged`` and ``wanted``.
    """
    return [_record(each) for each in judgements]


def _record(each: Judgement) -> dict[str, Any]:
    statement, finding = each.claim.statement, each.finding
    samples = each.samples if finding.at else ()
    return {
        "claim": each.claim.name,
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
        "threshold_of": each.claim.threshold_of,
        "ours": ", ".join(statement.knitlab),
        "change": each.sensitivity,
        "why_not": (statement.why_not or "") if finding.verdict is Verdict.fails else "",
        "figure": statement.figure or "",
        "cube": ", ".join(map(str, each.cubes)),
        "boundary": _joined(sample.boundary for sample in samples),
        "unit_cells": _joined(sample.size for sample in samples),
        "reading": _joined(sample.options for sample in samples),
        "contrary": contrary(each.contrary, str),
    }


def _joined(texts: Iterable[str]) -> str:
    """Different texts, each once."""
    return " | ".join(dict.fromkeys(text for text in texts if text))
