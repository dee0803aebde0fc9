"""Claims: what the paper says, judged by cubes (``params/claims.toml``)."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import xarray as xr
from pydantic import Field, TypeAdapter, ValidationError

from knitlab.maps.claim_tests import (
    CurveWithin,
    Finding,
    Follows,
    Laboratory,
    LargestAtCentre,
    LessThan,
    LowestOfAll,
    Monotonic,
    RisesAndFalls,
    Spread,
    ValueWithin,
    Verdict,
)
from knitlab.maps.line_claim_tests import CommonSlope, DepartsMost, Linear
from knitlab.maps.sample_claim_tests import SampleOrder, TradesOff
from knitlab.maps.selection import choices, refuse_others, selected, selections_along
from knitlab.maps.stripe_claim_tests import SameCurves, StripeOrder, StripeToe
from knitlab.sweep.cube_file import open_cube, swept_dims
from knitlab.sweep.faults import BadInput, Fault, fault, faults_of
from knitlab.sweep.shipped import shipped
from knitlab.sweep.strict import Strict
from knitlab.sweep.toml import read_toml

CLAIMS = "claims.toml"
Test = Annotated[
    CommonSlope
    | CurveWithin
    | DepartsMost
    | Follows
    | Laboratory
    | LargestAtCentre
    | LessThan
    | Linear
    | LowestOfAll
    | Monotonic
    | RisesAndFalls
    | SameCurves
    | SampleOrder
    | Spread
    | StripeOrder
    | StripeToe
    | TradesOff
    | ValueWithin,
    Field(discriminator="test"),
]
_TESTS: TypeAdapter[Test] = TypeAdapter(Test)


class Words(Strict):
    """What stands beside the test of a claim.

    Attributes:
        text: what the paper says.
        place: where it says so.
        figure: kind of figure that shows it, if any.
    """

    text: str = Field(min_length=1)
    place: str = Field(min_length=1)
    figure: str | None = None


@dataclass(frozen=True)
class Claim:
    """A statement of the paper and its test."""

    name: str
    words: Words
    test: Test


@dataclass(frozen=True)
class Judgement:
    """A claim, and what was found.

    Attributes:
        claim: the claim.
        finding: what decides it.
        cubes: paths of the cubes that it was found in.
    """

    claim: Claim
    finding: Finding
    cubes: tuple[Path, ...]


def read_claims(path: Path | None = None) -> list[Claim]:
    """The claims of a file, by default of knitlab's own.

    Raises:
        BadInput: with every fault of the file.
    """
    path = path or shipped("params") / CLAIMS
    claims, faults = [], list[Fault]()
    for name, table in read_toml(path).items():
        source = f"{path}: {name}"
        if not isinstance(table, dict):
            faults.append(Fault(source, "is not a table; give each claim one"))
            continue
        words = {key: value for key, value in table.items() if key in Words.model_fields}
        rest = {key: value for key, value in table.items() if key not in words}
        try:
            claims.append(Claim(name, Words.model_validate(words), _TESTS.validate_python(rest)))
        except ValidationError as error:
            faults += faults_of(error, source)
    if faults:
        raise BadInput(faults)
    return claims


def judged(
    claims: Sequence[Claim], cubes: Sequence[Path], selections: Sequence[str] = ()
) -> list[Judgement]:
    """Judge claims by cubes; of several, the first that measures a claim decides it.

    Args:
        claims: the claims.
        cubes: cubes, or results folders that hold one.
        selections: texts ``NAME=VALUE`` that choose of swept settings.

    Raises:
        BadInput: if a cube cannot be read or lies along a setting of which none is selected, or
            if a selection is of nothing that a cube was swept along.
    """
    whole = [(path, open_cube(path)) for path in cubes]
    swept = sorted({dim for _, cube in whole for dim in swept_dims(cube)})
    remedy = f"select of {', '.join(swept)}" if swept else "leave it out: there are none"
    refuse_others(selections, swept, f"is of no swept setting of these cubes; {remedy}")
    opened = [(path, _one_slice(path, cube, selections)) for path, cube in whole]
    judgements = []
    for claim in claims:
        if isinstance(claim.test, SampleOrder):
            among = claim.test.finding_among([cube for _, cube in opened])
            judgements.append(Judgement(claim, among, tuple(path for path, _ in opened)))
            continue
        found = [Judgement(claim, claim.test.finding(cube), (path,)) for path, cube in opened]
        decided = [its for its in found if its.finding.verdict is not Verdict.not_measured]
        judgements.append(min(decided or found, key=lambda its: _distance(its.finding)))
    return judgements


def _distance(finding: Finding) -> int:
    """How little a finding has to do with its claim: a cube of other designs says the least."""
    return int(finding.measured.endswith("in this cube"))


def _one_slice(path: Path, cube: xr.Dataset, selections: Sequence[str]) -> xr.Dataset:
    swept = swept_dims(cube)
    cube = selected(cube, selections_along(selections, swept))
    if several := [dim for dim in swept if cube.sizes[dim] > 1]:
        raise fault(str(path), f"lies along swept settings; --select {choices(cube, several)}")
    return cube.isel(dict.fromkeys(swept, 0), drop=True)


def counted(judgements: Sequence[Judgement]) -> dict[str, int]:
    """How many claims hold, fail and are not measured."""
    return {
        verdict.value: sum(its.finding.verdict is verdict for its in judgements)
        for verdict in Verdict
    }


def records(judgements: Sequence[Judgement]) -> list[dict[str, Any]]:
    """One table row a claim."""
    return [
        {
            "claim": its.claim.name,
            "verdict": its.finding.verdict.value,
            "measured": its.finding.measured,
            "text": its.claim.words.text,
            "place": its.claim.words.place,
            "figure": its.claim.words.figure or "",
            "cube": ", ".join(map(str, its.cubes)),
        }
        for its in judgements
    ]
