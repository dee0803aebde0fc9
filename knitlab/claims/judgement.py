"""Judging claims by cubes; if several apply, the one nearest the paper's samples decides."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import xarray as xr

from knitlab.claims.claims import RELAXED_TOPICS, Claim
from knitlab.claims.margin import CheckResult, Grade, signed
from knitlab.claims.samples import JudgedSamples, preference
from knitlab.cubes.cube_file import open_cube, swept_dims
from knitlab.cubes.selection import choices, refuse_others, select, selections_along
from knitlab.cubes.trust import pulled_without_pause
from knitlab.io.errors import invalid

QUARTER = (0.75, 1.25)  # factors on thresholds chosen for knitlab, to test how they matter
WOULD = {Grade.holds: "hold", Grade.fails: "fail", Grade.not_measured: "not be measured"}
Slice = tuple[Path, xr.Dataset]  # path of a cube, and the cube at one value of every swept setting


@dataclass(frozen=True)
class Judgement:
    """A claim, the result that decides it, and the samples that it was judged on, cube by cube."""

    claim: Claim
    result: CheckResult
    samples: tuple[JudgedSamples, ...]
    quarters: tuple[Grade, ...] = ()  # verdicts with knitlab's thresholds at the factors QUARTER
    contrary: tuple[tuple[Path, CheckResult], ...] = ()  # cubes with another verdict

    @property
    def cubes(self) -> tuple[Path, ...]:
        """Paths of the cubes that it was judged on."""
        return tuple(each.cube for each in self.samples)

    @property
    def sensitivity(self) -> str:
        """Effect of changing thresholds chosen for knitlab by a quarter, as text."""
        now = self.result.verdict
        if now is Grade.not_measured or not self.quarters:
            return ""
        changed = [
            f"would {WOULD[verdict]} at {factor - 1:+.0%}"
            for factor, verdict in zip(QUARTER, self.quarters, strict=True)
            if verdict is not now
        ]
        return ", ".join(changed) or "the same at -25% and at +25%"


def judged(
    claims: Sequence[Claim], cubes: Sequence[Path], selections: Mapping[str, Any] = {}
) -> list[Judgement]:
    """Judge claims by cubes or folders; the one whose samples are nearest the paper's decides."""
    opened = [(path, open_cube(path)) for path in cubes]
    all_swept = sorted({dim for _, cube in opened for dim in swept_dims(cube)})
    hint = f"select along {', '.join(all_swept)}" if all_swept else "leave it out: there are none"
    refuse_others(selections, all_swept, f"is not a swept setting of these cubes; {hint}")
    slices = []
    for path, cube in opened:
        swept = swept_dims(cube)
        cube = select(cube, selections_along(selections, swept))
        if several := [dim for dim in swept if cube.sizes[dim] > 1]:
            raise invalid(str(path), f"has swept settings; select {choices(cube, several)}")
        slices.append((path, cube.isel(dict.fromkeys(swept, 0))))
    return judged_slices(claims, slices)


def judged_slices(claims: Sequence[Claim], slices: Sequence[Slice]) -> list[Judgement]:
    """Judge claims by open cubes; see :func:`judged`."""
    return [(_by_all if claim.compares_cubes else _by_nearest)(claim, slices) for claim in claims]


def _by_nearest(claim: Claim, slices: Sequence[Slice]) -> Judgement:
    checked = [(path, cube, claim.check([cube])) for path, cube in slices]
    ranks = [
        (
            result.margin is None,
            result.wanted == 0,
            claim.topic in RELAXED_TOPICS and bool(pulled_without_pause(cube).any()),
            *preference(cube, result.at),
        )
        for _, cube, result in checked
    ]
    path, cube, result = checked[ranks.index(min(ranks))]
    samples = JudgedSamples.of(path, cube, result.at)
    factors = QUARTER if claim.knitlab else ()
    quarters = tuple(claim.check([cube], factor).verdict for factor in factors)
    same = (result.verdict, Grade.not_measured)
    others = tuple((other, each) for other, _, each in checked if each.verdict not in same)
    return Judgement(claim, result, (samples,), quarters, others)


def _by_all(claim: Claim, slices: Sequence[Slice]) -> Judgement:
    result = claim.check([cube for _, cube in slices])
    used = list(zip(result.cubes, result.at, strict=True))
    samples = tuple(
        JudgedSamples.of(*slices[number], [labels for each, labels in used if each == number])
        for number in sorted(set(result.cubes))
    )
    return Judgement(claim, result, samples)


def summary(judgements: Sequence[Judgement]) -> str:
    """Numbers of claims of every grade, as text."""
    counts = Counter(each.result.grade for each in judgements)
    near = counts[Grade.near_miss]
    return (
        f"{counts[Grade.holds]} hold, {near} near miss{'' if near == 1 else 'es'},"
        f" {counts[Grade.fails]} fail, {counts[Grade.not_measured]} not measured"
    )


def listed(judgements: Sequence[Judgement]) -> str:
    """The lines for a terminal: grade, margin, claim and measured values, and the summary."""
    lines = [
        f"{each.result.grade.value:12}  {signed(each.result.margin):>8}"
        f"  {each.claim.name}: {each.result.measured}"
        for each in judgements
    ]
    return "\n".join([*lines, summary(judgements)])


def contrary(others: Sequence[tuple[Path, CheckResult]], name: Callable[[Path], str]) -> str:
    """Verdicts that differ from the deciding one, as text, with the names of their cubes."""
    return ", ".join(
        f"{result.verdict.value} at {signed(result.margin)} on {result.count} of {name(path)}"
        for path, result in others
    )


def record(each: Judgement) -> dict[str, Any]:
    """The table row of a claim: texts, counts, and the margin if it was measured."""
    claim, result = each.claim, each.result
    samples = each.samples if result.at else ()
    described = {
        column: " | ".join(dict.fromkeys(filter(None, (getattr(one, name) for one in samples))))
        for column, name in (("boundary",) * 2, ("unit_cells", "size"), ("options",) * 2)
    }
    return {
        "claim": claim.name,
        "topic": claim.topic,
        "verdict": result.verdict.value,
        "grade": result.grade.value,
        "margin": result.margin,
        "measured": result.measured,
        "judged": result.judged,
        "wanted": result.wanted,
        "counted": result.counted,
        "text": claim.text,
        "measured_along": claim.measured_along or "",
        "place": claim.place,
        "threshold_of": claim.threshold_of,
        "ours": ", ".join(claim.knitlab),
        "change": each.sensitivity,
        "why_not": (claim.why_not or "") if result.verdict is Grade.fails else "",
        "figure": claim.figure or "",
        "cube": ", ".join(map(str, each.cubes)),
        **described,
        "contrary": contrary(each.contrary, str),
    }
