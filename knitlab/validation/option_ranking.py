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
from knitlab.validation.claims import Claim
from knitlab.validation.judgement import judged_slices
from knitlab.validation.margin import CheckResult, Grade
from knitlab.validation.samples import by_labels

Options = dict[str, str | float]

OF_STRIPES = ("cell_size", "hinge_stiffness", "length_scale")
"""Options that change the tension curve of a pure stripe. The phase only shifts its folds, hinges
that rest flat stay flat, and the walls are for patterned fabric."""
OF_MOTION = ("ending", "damping_ratio", "relax_time", "strain_rate")
"""Options of what moves in time: the shape at which a sample comes to rest depends on its motion,
too."""
OF_FABRIC = ("fold_phase", "hinges", "garter_start", "fold_angle", "z_max")
NAMES = (*OF_STRIPES, *OF_FABRIC, *OF_MOTION, "drag")
"""Names of the options."""
CLIPPED = 1.0
"""Margins beyond this count as this in a sum, so that no gross claim outweighs the rest."""


@dataclass(frozen=True)
class RankedOptions:
    """One set of model options, and the results of the checks of the claims under it.

    Attributes:
        options: the options by name.
        results: the result of every check, by the name of the claim.
        designs: number of checkerboards that it was judged on; fewer make it easier for claims to
            hold.
    """

    options: Options
    results: dict[str, CheckResult]
    designs: int

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
        margins = [each.margin for each in self.results.values() if each.margin is not None]
        total = float(np.clip(margins, -CLIPPED, CLIPPED).sum())
        return self.count(Grade.holds), self.count(Grade.near_miss), total


def ranked_options(
    cubes: Sequence[tuple[Path, xr.Dataset]], claims: Sequence[Claim]
) -> list[RankedOptions]:
    """Rank the model options of cubes by how many claims hold under them, the best first.

    Options are judged by all slices of all cubes that were computed with them; slices of pure
    stripes serve all options that do not differ in :data:`OF_STRIPES`. Of options under which
    equally many claims hold, those with more near misses come first, then those with the larger
    sum of margins. They are those of the checkerboards; without these, those of the pure stripes.

    Args:
        cubes: paths and cubes of checkerboards or pure stripes, with or without swept settings.
        claims: the claims.
    """
    slices = [(path, one, options_of(one)) for path, cube in cubes for one in _slices(cube)]
    of_boards = [each for each in slices if base_dims(each[1]) == DESIGN_DIMS]
    of_stripes = [
        (path, one, _of_stripes(options))
        for path, one, options in slices
        if base_dims(one) != DESIGN_DIMS
    ]
    distinct: list[Options] = []
    for _, _, options in of_boards or of_stripes:
        if options not in distinct:
            distinct.append(options)
    ranked = []
    for options in distinct:
        boards = [(path, one) for path, one, each in of_boards if each == options]
        stripes = [(path, one) for path, one, each in of_stripes if each == _of_stripes(options)]
        judgements = judged_slices(claims, [*boards, *stripes])
        designs = {
            design
            for _, one in boards
            for design, status in by_labels(one["status"]).items()
            if status == Status.ok
        }
        results = {each.claim.name: each.result for each in judgements}
        ranked.append(RankedOptions(options, results, len(designs)))
    return sorted(ranked, key=lambda each: each.score, reverse=True)


def differing(ranked: Sequence[RankedOptions]) -> list[str]:
    """The names of the options that differ, in the order of :data:`NAMES`."""
    return [name for name in NAMES if len({each.options.get(name) for each in ranked}) > 1]


def options_of(cube: xr.Dataset) -> Options:
    """The model options of a cube at one value of every swept setting."""
    parameters: dict[str, Any] = json.loads(cube.attrs.get("parameters", "{}"))
    motion = parameters.get("dynamics") or {}
    stated: dict[str, Any] = {
        "drag": (parameters.get("solver") or {}).get("drag", 0.0),
        **{name: motion[name] for name in OF_MOTION if name in motion},
        **parameters.get("sheet", {}),
        **model_options(cube),
        **{str(name): each.item() for name, each in cube.coords.items() if not each.dims},
    }
    if not stated["drag"]:
        del stated["drag"]
    # NetCDF attributes are NumPy's numbers.
    return {
        name: stated[name].item() if isinstance(stated[name], np.generic) else stated[name]
        for name in NAMES
        if name in stated
    }


def _slices(cube: xr.Dataset) -> Iterator[xr.Dataset]:
    """A cube at one value of every swept setting, for all of these."""
    dims = swept_dims(cube)
    for indices in itertools.product(*(range(cube.sizes[dim]) for dim in dims)):
        yield cube.isel(dict(zip(dims, indices, strict=True)))


def _of_stripes(options: Options) -> Options:
    return {name: each for name, each in options.items() if name in OF_STRIPES}
