"""Readings ranked by the paper's claims: which way to read the model does what the paper says."""

import itertools
import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from knitlab.io.cube_file import base_dims, swept_dims
from knitlab.io.design_status import Status
from knitlab.io.plain_cube import stated_options
from knitlab.io.schema import DESIGN_DIMS
from knitlab.paper.claims import Claim, read_claims
from knitlab.paper.finding import Finding
from knitlab.paper.judgement import judged_slices
from knitlab.paper.margin import Grade

Label = str | float
Settings = dict[str, Label]

OF_STRIPES = ("cell_size", "hinge_stiffness", "length_scale")
"""Settings that change the tension curve of a pure stripe. The phase only shifts its folds, hinges
that rest flat stay flat, and the walls are for patterned fabric."""
SETTINGS = (
    *OF_STRIPES,
    "fold_phase",
    "hinges",
    "garter_start",
    "fold_angle",
    "z_max",
    "ending",
    "damping_factor",
    "drag",
)
"""Settings that make a reading."""
CLIPPED = 1.0
"""Margins beyond this count as this in a sum, so that no gross claim outweighs the rest."""


@dataclass(frozen=True)
class RankedReading:
    """One reading of the model, and what the claims make of it.

    Attributes:
        settings: its choices by name.
        findings: what was found of every claim, by the name of the claim.
        designs: how many checkerboards it was judged on; fewer make it easier for claims to hold.
    """

    settings: Settings
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
        margins = (its.margin for its in self.findings.values() if its.margin is not None)
        total = sum(max(-CLIPPED, min(CLIPPED, margin)) for margin in margins)
        return self.count(Grade.holds), self.count(Grade.near_miss), total


def ranked_readings(
    cubes: Sequence[tuple[Path, xr.Dataset]], claims: Sequence[Claim] | None = None
) -> list[RankedReading]:
    """Rank the readings that cubes were computed with by how many of the paper's claims hold.

    A reading is judged by all slices of all cubes that were computed with it, the paper's own
    samples first; slices of pure stripes serve every reading that does not differ in
    :data:`OF_STRIPES`. Of readings with equally many claims that hold, the one with more near
    misses comes first, then the one with the larger sum of margins.

    Args:
        cubes: paths and cubes, along swept settings or not, of checkerboards or pure stripes.
        claims: the claims; by default those of ``params/claims.toml``.

    Returns:
        The readings of the checkerboards, the best first; if there is no checkerboard, those of
        the pure stripes.
    """
    claims = read_claims() if claims is None else claims
    slices = [(path, one, settings_of(one)) for path, cube in cubes for one in _slices(cube)]
    of_patterns = [its for its in slices if base_dims(its[1]) == DESIGN_DIMS]
    of_stripes = [its for its in slices if base_dims(its[1]) != DESIGN_DIMS]
    shared = () if of_patterns else OF_STRIPES
    readings = _each_once(_only(its, shared) for _, _, its in of_patterns or of_stripes)
    ranked = []
    for settings in readings:
        mine = [(path, one) for path, one, its in of_patterns if its == settings]
        stripes = [
            (path, one)
            for path, one, its in of_stripes
            if _only(its, OF_STRIPES) == _only(settings, OF_STRIPES)
        ]
        judgements = judged_slices(claims, [*mine, *stripes])
        findings = {its.claim.name: its.finding for its in judgements}
        measured = {design for _, one in mine for design in _measured(one)}
        ranked.append(RankedReading(settings, findings, len(measured)))
    return sorted(ranked, key=lambda reading: reading.score, reverse=True)


def differing(readings: Sequence[RankedReading]) -> list[str]:
    """The settings in which readings differ, in the order of :data:`SETTINGS`."""
    return [
        name for name in SETTINGS if len({reading.settings.get(name) for reading in readings}) > 1
    ]


def settings_of(cube: xr.Dataset) -> Settings:
    """The reading that one slice of a cube was computed with.

    Args:
        cube: a cube at one value of every swept setting, which stays as a coordinate.
    """
    parameters: dict[str, Any] = json.loads(cube.attrs.get("parameters", "{}"))
    solver = parameters.get("solver", {})
    stated: Settings = {
        "ending": solver.get("ending", "steady"),
        "damping_factor": 1.0,
        "drag": solver.get("drag", 0.0),
        **parameters.get("sheet", {}),
        **stated_options(cube.attrs),
        **{str(key): its.item() for key, its in cube.coords.items() if not its.dims},
    }
    if stated["ending"] == "steady":
        del stated["damping_factor"]  # it moves no equilibrium
    if not stated["drag"]:
        del stated["drag"]
    return {name: _plain(stated[name]) for name in SETTINGS if name in stated}


def _plain(label: Any) -> Label:
    """A label as Python has it; netCDF attributes are NumPy's numbers."""
    return label.item() if isinstance(label, np.generic) else label


def _slices(cube: xr.Dataset) -> Iterator[xr.Dataset]:
    """A cube at one value of every swept setting, for all of these."""
    dims = swept_dims(cube)
    for places in itertools.product(*(range(cube.sizes[dim]) for dim in dims)):
        yield cube.isel(dict(zip(dims, places, strict=True)))


def _measured(cube: xr.Dataset) -> list[tuple[int, ...]]:
    """The designs of one slice that have a complete test."""
    stacked = cube["status"].stack(design=DESIGN_DIMS)
    return list(stacked["design"].values[stacked.values == Status.ok])


def _only(settings: Settings, names: Sequence[str]) -> Settings:
    """The settings of some names, or all if none is given."""
    return {name: its for name, its in settings.items() if not names or name in names}


def _each_once(settings: Iterable[Settings]) -> list[Settings]:
    found: list[Settings] = []
    for its in settings:
        if its not in found:
            found.append(its)
    return found
