"""Model options ranked by the paper's claims: under which of them most of the claims hold."""

import itertools
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from knitlab.cube.cube_file import base_dims, model_options, swept_dims
from knitlab.cube.schema import DESIGN_DIMS, Status
from knitlab.validation.claims import Claim, read_claims
from knitlab.validation.finding import Finding
from knitlab.validation.judgement import judged_slices
from knitlab.validation.margin import Grade

Label = str | float
Options = dict[str, Label]

OF_STRIPES = ("cell_size", "hinge_stiffness", "length_scale")
"""Options that change the tension curve of a pure stripe. The phase only shifts its folds, hinges
that rest flat stay flat, and the walls are for patterned fabric."""
NAMES = (
    *OF_STRIPES,
    "fold_phase",
    "hinges",
    "garter_start",
    "fold_angle",
    "z_max",
    "ending",
    "damping_ratio",
    "relax_time",
    "strain_rate",
    "drag",
)
"""Names of the options."""
OF_MOTION = ("ending", "damping_ratio", "relax_time", "strain_rate")
"""Options of what moves in time: the shape at which a sample comes to rest depends on its motion,
too."""
CLIPPED = 1.0
"""Margins beyond this count as this in a sum, so that no gross claim outweighs the rest."""


@dataclass(frozen=True)
class RankedOptions:
    """One set of model options, and what was found of the claims under it.

    Attributes:
        options: the options by name.
        findings: what was found of every claim, by the name of the claim.
        designs: number of checkerboards that it was judged on; fewer make it easier for claims to
            hold.
    """

    options: Options
    findings: dict[str, Finding]
    designs: int

    def count(self, grade: Grade) -> int:
        """How many claims have a grade."""
        return sum(finding.grade is grade for finding in self.findings.values())

    @property
    def decided(self) -> int:
        """How many claims were measured."""
        return len(self.findings) - self.count(Grade.not_measured)

    @property
    def score(self) -> tuple[int, int, float]:
        """What it is ranked by: claims that hold, near misses, and the sum of clipped margins."""
        margins = (each.margin for each in self.findings.values() if each.margin is not None)
        total = sum(max(-CLIPPED, min(CLIPPED, margin)) for margin in margins)
        return self.count(Grade.holds), self.count(Grade.near_miss), total


def ranked_options(
    cubes: Sequence[tuple[Path, xr.Dataset]], claims: Sequence[Claim] | None = None
) -> list[RankedOptions]:
    """Rank the model options of cubes by how many of the paper's claims hold under them.

    Options are judged by all slices of all cubes that were computed with them; slices of pure
    stripes serve all options that do not differ in :data:`OF_STRIPES`. Of options under which
    equally many claims hold, those with more near misses come first, then those with the larger
    sum of margins.

    Args:
        cubes: paths and cubes of checkerboards or pure stripes, with or without swept settings.
        claims: the claims; by default those of ``params/claims.toml``.

    Returns:
        The options of the checkerboards, the best first; if there is no checkerboard, those of
        the pure stripes.
    """
    claims = read_claims() if claims is None else claims
    slices = [(path, one, options_of(one)) for path, cube in cubes for one in _slices(cube)]
    of_boards = [each for each in slices if base_dims(each[1]) == DESIGN_DIMS]
    of_stripes = [each for each in slices if base_dims(each[1]) != DESIGN_DIMS]
    found: list[Options] = []
    for _, _, each in of_boards or of_stripes:
        options = each if of_boards else _of_stripes(each)
        if options not in found:
            found.append(options)
    ranked = []
    for options in found:
        boards = [(path, one) for path, one, each in of_boards if each == options]
        stripes = [
            (path, one)
            for path, one, each in of_stripes
            if _of_stripes(each) == _of_stripes(options)
        ]
        judgements = judged_slices(claims, [*boards, *stripes])
        findings = {each.claim.name: each.finding for each in judgements}
        designs = {design for _, one in boards for design in _complete(one)}
        ranked.append(RankedOptions(options, findings, len(designs)))
    return sorted(ranked, key=lambda each: each.score, reverse=True)


def differing(ranked: Sequence[RankedOptions]) -> list[str]:
    """The names of the options that differ, in the order of :data:`NAMES`."""
    return [name for name in NAMES if len({each.options.get(name) for each in ranked}) > 1]


def options_of(cube: xr.Dataset) -> Options:
    """The model options of one slice of a cube.

    Args:
        cube: a cube at one value of every swept setting, which stays as a coordinate.
    """
    parameters: dict[str, Any] = json.loads(cube.attrs.get("parameters", "{}"))
    solver, motion = (parameters.get(table, {}) for table in ("solver", "dynamics"))
    stated: Options = {
        "drag": solver.get("drag", 0.0),
        **{name: motion[name] for name in OF_MOTION if name in motion},
        **parameters.get("sheet", {}),
        **model_options(cube),
        **{str(key): each.item() for key, each in cube.coords.items() if not each.dims},
    }
    if not stated["drag"]:
        del stated["drag"]
    return {name: _plain(stated[name]) for name in NAMES if name in stated}


def _plain(label: Any) -> Label:
    """A label as Python has it; netCDF attributes are NumPy's numbers."""
    return label.item() if isinstance(label, np.generic) else label


def _slices(cube: xr.Dataset) -> Iterator[xr.Dataset]:
    """A cube at one value of every swept setting, for all of these."""
    dims = swept_dims(cube)
    for places in itertools.product(*(range(cube.sizes[dim]) for dim in dims)):
        yield cube.isel(dict(zip(dims, places, strict=True)))


def _complete(cube: xr.Dataset) -> list[tuple[int, ...]]:
    """The designs of one slice that have a complete test."""
    stacked = cube["status"].stack(design=DESIGN_DIMS)
    return list(stacked["design"].values[stacked.values == Status.ok])


def _of_stripes(options: Options) -> Options:
    return {name: each for name, each in options.items() if name in OF_STRIPES}
