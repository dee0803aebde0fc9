"""Model options ranked by the paper's claims: under which of them most of the claims hold."""

import itertools
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from knitlab.claims.claims import Claim
from knitlab.claims.judgement import Slice, judged_slices
from knitlab.claims.margin import CheckResult, Grade
from knitlab.claims.samples import stated_options, values_by_label
from knitlab.cubes.cube_file import base_dims, cube_name, parameters_of, swept_dims
from knitlab.observables.schema import DESIGN_DIMS
from knitlab.observables.status import Status

Options = tuple[tuple[str, str | float], ...]  # names and values, in the order of NAMES

STRIPE_OPTIONS = ("cell_size", "hinge_stiffness", "length_scale")
"""Options that change the tension curve of a pure stripe. The phase only shifts its folds, hinges
that rest flat stay flat, and the walls are for patterned fabric."""
FABRIC_OPTIONS = ("fold_phase", "hinges", "garter_start", "fold_angle", "z_max")
MOTION_OPTIONS = ("ending", "damping_ratio", "relax_time", "strain_rate", "drag")
NAMES = STRIPE_OPTIONS + FABRIC_OPTIONS + MOTION_OPTIONS
CLIPPED = 1.0  # margins beyond count as this in a sum, so that no claim outweighs the rest


@dataclass(frozen=True)
class RankedOptions:
    """One set of model options, and the result of every check by the name of its claim."""

    options: dict[str, str | float]
    results: dict[str, CheckResult]
    designs: int  # checkerboards that it was judged on; fewer make it easier for claims to hold

    def count(self, grade: Grade) -> int:
        """How many claims have a grade."""
        return sum(result.grade is grade for result in self.results.values())

    @property
    def decided(self) -> int:
        """How many claims were measured."""
        return len(self.results) - self.count(Grade.not_measured)

    @property
    def score(self) -> tuple[int, int, float]:
        """What it is ranked by: claims that hold, near misses, and the sum of clipped margins."""
        margins = [each.margin or 0.0 for each in self.results.values()]
        total = float(np.clip(margins, -CLIPPED, CLIPPED).sum())
        return self.count(Grade.holds), self.count(Grade.near_miss), total


def ranked_options(cubes: Sequence[xr.Dataset], claims: Sequence[Claim]) -> list[RankedOptions]:
    """Rank the model options of cubes by :attr:`RankedOptions.score`, the best first."""
    boards = defaultdict[Options, list[Slice]](list)
    stripes = defaultdict[Options, list[Slice]](list)
    for cube in cubes:
        dims = swept_dims(cube)
        for indices in itertools.product(*(range(cube.sizes[dim]) for dim in dims)):
            one = cube.isel(dict(zip(dims, indices, strict=True)))
            options = tuple(ranking_options(one).items())
            if base_dims(one) == DESIGN_DIMS:
                boards[options].append((Path(cube_name(cube)), one))
            else:
                stripes[_of_stripes(options)].append((Path(cube_name(cube)), one))
    ranked = []
    for options in [*(boards or stripes)]:
        judgements = judged_slices(claims, [*boards[options], *stripes[_of_stripes(options)]])
        designs = {
            labels
            for _, one in boards[options]
            for labels, status in values_by_label(one["status"]).items()
            if status == Status.ok
        }
        results = {each.claim.name: each.result for each in judgements}
        ranked.append(RankedOptions(dict(options), results, len(designs)))
    return sorted(ranked, key=lambda each: each.score, reverse=True)


def differing(ranked: Sequence[RankedOptions]) -> list[str]:
    """The names of the options that differ, in the order of :data:`NAMES`."""
    return [name for name in NAMES if len({each.options.get(name) for each in ranked}) > 1]


def ranking_options(cube: xr.Dataset) -> dict[str, str | float]:
    """The model options of a cube at one value of every swept setting."""
    parameters = parameters_of(cube)
    stated = {**(parameters.get("solver") or {}), **(parameters.get("dynamics") or {})}
    stated |= stated_options(cube)
    # NetCDF attributes are numbers of NumPy, whose text is another one.
    values = {name: np.asarray(stated[name]).item() for name in NAMES if name in stated}
    return {name: value for name, value in values.items() if (name, value) != ("drag", 0)}


def _of_stripes(options: Options) -> Options:
    return tuple((name, value) for name, value in options if name in STRIPE_OPTIONS)
