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
from knitlab.claims.samples import by_labels, stated_options
from knitlab.cubes.cube_file import base_dims, cube_name, parameters_of, swept_dims
from knitlab.observables.schema import DESIGN_DIMS, Status

Key = tuple[tuple[str, str | float], ...]  # options, in the order of NAMES

OF_STRIPES = ("cell_size", "hinge_stiffness", "length_scale")
"""Options that change the tension curve of a pure stripe. The phase only shifts its folds, hinges
that rest flat stay flat, and the walls are for patterned fabric."""
OF_FABRIC = ("fold_phase", "hinges", "garter_start", "fold_angle", "z_max")
OF_MOTION = ("ending", "damping_ratio", "relax_time", "strain_rate")  # on which rest depends, too
NAMES = (*OF_STRIPES, *OF_FABRIC, *OF_MOTION, "drag")
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
    """Rank the model options of cubes by :attr:`RankedOptions.score`, the best first.

    Options are judged by all slices that were computed with them; slices of pure stripes serve all
    options that do not differ in :data:`OF_STRIPES`.
    """
    boards, stripes = defaultdict[Key, list[Slice]](list), defaultdict[Key, list[Slice]](list)
    for cube in cubes:
        path, dims = Path(cube_name(cube)), swept_dims(cube)
        for indices in itertools.product(*(range(cube.sizes[dim]) for dim in dims)):
            one = cube.isel(dict(zip(dims, indices, strict=True)))
            key = tuple(options_of(one).items())
            if base_dims(one) == DESIGN_DIMS:
                boards[key].append((path, one))
            else:
                stripes[_of_stripes(key)].append((path, one))
    ranked = []
    for key in [*(boards or stripes)]:
        judgements = judged_slices(claims, [*boards[key], *stripes[_of_stripes(key)]])
        statuses = [by_labels(one["status"]).items() for _, one in boards[key]]
        designs = {each for items in statuses for each, status in items if status == Status.ok}
        results = {each.claim.name: each.result for each in judgements}
        ranked.append(RankedOptions(dict(key), results, len(designs)))
    return sorted(ranked, key=lambda each: each.score, reverse=True)


def differing(ranked: Sequence[RankedOptions]) -> list[str]:
    """The names of the options that differ, in the order of :data:`NAMES`."""
    return [name for name in NAMES if len({each.options.get(name) for each in ranked}) > 1]


def options_of(cube: xr.Dataset) -> dict[str, str | float]:
    """The model options of a cube at one value of every swept setting."""
    parameters = parameters_of(cube)
    motion = parameters.get("dynamics") or {}
    drag = (parameters.get("solver") or {}).get("drag")
    of_motion = {name: motion[name] for name in OF_MOTION if name in motion}
    stated = ({"drag": drag} if drag else {}) | of_motion | stated_options(cube)
    # NetCDF attributes are NumPy's numbers.
    return {
        name: stated[name].item() if isinstance(stated[name], np.generic) else stated[name]
        for name in NAMES
        if name in stated
    }


def _of_stripes(key: Key) -> Key:
    return tuple((name, each) for name, each in key if name in OF_STRIPES)
