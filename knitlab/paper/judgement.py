"""Judging claims by cubes: of several, the one whose samples are nearest the paper's decides."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import xarray as xr

from knitlab.io.cube_file import open_cube, swept_dims
from knitlab.io.errors import fault
from knitlab.paper.claims import Claim
from knitlab.paper.finding import Finding
from knitlab.paper.margin import Verdict
from knitlab.paper.sample import JudgedSamples, judged_samples, preference
from knitlab.paper.sample_checks import SampleOrder
from knitlab.paper.threshold import Change, change
from knitlab.tables.selection import choices, refuse_others, selected, selections_along


@dataclass(frozen=True)
class Judgement:
    """A claim, and what was found.

    Attributes:
        claim: the claim.
        finding: what decides it.
        samples: what it was judged on, cube by cube.
        change: what a quarter more or less on knitlab's own numbers would change; ``None`` if the
            threshold is the paper's.
        contrary: cubes that give another verdict, and what was found there.
    """

    claim: Claim
    finding: Finding
    samples: tuple[JudgedSamples, ...]
    change: Change | None = None
    contrary: tuple[tuple[Path, Finding], ...] = ()

    @property
    def cubes(self) -> tuple[Path, ...]:
        """Paths of the cubes that it was found in."""
        return tuple(its.cube for its in self.samples)


@dataclass(frozen=True)
class _Opened:
    path: Path
    cube: xr.Dataset


def judged(
    claims: Sequence[Claim], cubes: Sequence[Path], selections: Sequence[str] = ()
) -> list[Judgement]:
    """Judge claims by cubes.

    Of several cubes that measure a claim, the one with the paper's samples is preferred, as
    :func:`knitlab.paper.sample.preference` says; of equals, the first.

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
    return judged_slices(
        claims, [(path, _one_slice(path, cube, selections)) for path, cube in whole]
    )


def judged_slices(
    claims: Sequence[Claim], slices: Sequence[tuple[Path, xr.Dataset]]
) -> list[Judgement]:
    """Judge claims by cubes that are open; otherwise as :func:`judged`.

    Args:
        claims: the claims.
        slices: path of each cube, and the cube at one value of every swept setting.
    """
    opened = [_Opened(path, cube) for path, cube in slices]
    return [
        _among(claim, claim.test, opened)
        if isinstance(claim.test, SampleOrder)
        else _by_one(claim, opened)
        for claim in claims
    ]


def _by_one(claim: Claim, opened: Sequence[_Opened]) -> Judgement:
    """The judgement by the one cube that is to be preferred."""
    found = [(its, claim.test.finding(its.cube)) for its in opened]
    best, finding = min(found, key=lambda pair: _rank(claim, *pair))
    return Judgement(
        claim,
        finding,
        (judged_samples(best.path, best.cube, finding.at),),
        change(claim.test, best.cube, finding.verdict),
        tuple(
            (its.path, other)
            for its, other in found
            if other.verdict not in (finding.verdict, Verdict.not_measured)
        ),
    )


def _rank(claim: Claim, its: _Opened, finding: Finding) -> tuple[object, ...]:
    nothing = finding.verdict is Verdict.not_measured
    nearness = preference(its.cube, finding.at, claim.test.boundary_of_paper())
    return nothing, finding.wanted == 0, *nearness


def _among(claim: Claim, test: SampleOrder, opened: Sequence[_Opened]) -> Judgement:
    """The judgement by all cubes together, of which those that were used are named."""
    cubes = [its.cube for its in opened]
    places = test.places(cubes).values()
    samples = tuple(
        judged_samples(its.path, its.cube, [place.at for place in places if place.cube == number])
        for number, its in enumerate(opened)
        if number in {place.cube for place in places}
    )
    return Judgement(claim, test.finding_among(cubes), samples)


def _one_slice(path: Path, cube: xr.Dataset, selections: Sequence[str]) -> xr.Dataset:
    """The cube at one value of every swept setting, which stays as a coordinate."""
    swept = swept_dims(cube)
    cube = selected(cube, selections_along(selections, swept))
    if several := [dim for dim in swept if cube.sizes[dim] > 1]:
        raise fault(str(path), f"lies along swept settings; select {choices(cube, several)}")
    return cube.isel(dict.fromkeys(swept, 0))
