"""The samples of a cube that a claim is about, and how like the paper's they are."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
import xarray as xr
from pydantic import Field, PositiveInt

from knitlab.claims.margin import CheckResult, Labels, NotMeasured
from knitlab.cubes.cube_file import base_dims, is_measured, model_options, parameters_of, source_of
from knitlab.io.toml import StrictModel
from knitlab.observables.schema import DESIGN_DIMS, SOURCE, STRIPE_DIMS, VARIABLES
from knitlab.observables.status import Status

Design = Annotated[tuple[PositiveInt, PositiveInt], Field(strict=False)]
STRIPE_BOUNDARY = "periodic"
"""Boundary of the pure stripes of claims: the paper computes them without ends."""


class Checkerboards(StrictModel):
    """Checkerboards that a claim is about, of which the paper has ``at_least`` so many."""

    dims: ClassVar = DESIGN_DIMS
    kind: ClassVar = "checkerboards"
    counted: ClassVar = "designs"
    designs: Annotated[tuple[Design, ...], Field(strict=False)] = ()
    n_stripe: Annotated[tuple[PositiveInt, ...], Field(strict=False)] = ()
    without: Annotated[tuple[Design, ...], Field(strict=False)] = ()
    at_least: PositiveInt = 1

    def among(self, planned: Iterable[Labels]) -> list[Labels]:
        """The designs that the claim is about, of those that are planned."""
        family = [each for each in planned if each[0] in (self.n_stripe or each)]
        return list(self.designs) or [each for each in family if each not in self.without]


class PureStripes(StrictModel):
    """Pure stripes that a claim is about, by the stitches across; the paper has ``at_least``."""

    dims: ClassVar = STRIPE_DIMS
    kind: ClassVar = f"{STRIPE_BOUNDARY} pure stripes"
    counted: ClassVar = "stripes"
    smallest: dict[str, int] = Field(default_factory=dict)
    largest: dict[str, int] = Field(default_factory=dict)
    at_least: PositiveInt = 1

    def among(self, planned: Iterable[Labels]) -> list[Labels]:
        """The stripes that the claim is about, of those that are planned."""
        return [
            (knit, n, boundary)
            for knit, n, boundary in planned
            if boundary == STRIPE_BOUNDARY
            and self.smallest.get(str(knit), 0) <= int(n) <= self.largest.get(str(knit), int(n))
        ]


About = Checkerboards | PureStripes


@dataclass(frozen=True)
class Samples:
    """Samples of a cube that a claim is about: ``wanted`` many, of which some are complete."""

    cube: xr.Dataset
    complete: dict[Labels, xr.Dataset]
    wanted: int
    counted: str

    @classmethod
    def of(cls, cube: xr.Dataset, about: About, *variables: str) -> "Samples":
        """The samples of a cube that a claim is about; NotMeasured if there are none."""
        if base_dims(cube) != about.dims:
            raise NotMeasured(f"no {about.kind} in this cube")
        if missing := sorted(set(variables) - set(map(str, cube.data_vars))):
            raise NotMeasured(f"no {', '.join(missing)} in this cube")
        statuses = values_by_label(cube["status"])
        planned = [labels for labels, status in statuses.items() if status != Status.excluded]
        samples = about.among(planned)
        cube = cube[["status", *variables]]
        complete = [labels for labels in samples if statuses.get(labels) == Status.ok]
        samples_by_label = {labels: one_sample(cube, labels) for labels in complete}
        return cls(cube, samples_by_label, max(about.at_least, len(samples)), about.counted)

    def values(self, of: str) -> dict[Labels, float]:
        """The value, or the largest of a curve, of the complete samples that have one."""
        dims = base_dims(self.cube)
        curves = self.cube[of].transpose(*dims, ...)
        values = values_by_label(curves.max([dim for dim in curves.dims if dim not in dims]))
        return {labels: values[labels] for labels in self.complete if np.isfinite(values[labels])}

    def result(self, margin: float | None, text: str, at: Iterable[Labels]) -> CheckResult:
        """The result of a check that was judged on some of the samples."""
        at = tuple(at)
        return CheckResult(margin, text, len(at), self.wanted, self.counted, at)

    def too_few(self, measured: int) -> NotMeasured:
        """The exception where too few samples are measured."""
        count = f"{measured} of {self.wanted}" if measured else "none of the"
        return NotMeasured(f"{count} {self.counted} measured", self.wanted, self.counted)


def values_by_label(variable: xr.DataArray) -> dict[Labels, Any]:
    """The values of a variable of designs, by the labels of each."""
    labels = product(*(variable[dim].values.tolist() for dim in variable.dims))
    return dict(zip(labels, variable.values.ravel().tolist(), strict=True))


def one_sample(cube: xr.Dataset, labels: Labels) -> xr.Dataset:
    """A cube at the labels of one sample."""
    return cube.sel(dict(zip(base_dims(cube), labels, strict=True)))


def sample_name(labels: Labels) -> str:
    """The name of a sample in text: ``(4, 16)``, or ``rib 4``."""
    first, second = labels[:2]
    return f"{first} {second}" if isinstance(first, str) else f"({first}, {second})"


def unit_suffix(variable: str) -> str:
    """The unit of a variable, to follow a number; empty for a plain number."""
    unit = VARIABLES[variable].units
    return "" if unit == "1" else f" {unit}"


@dataclass(frozen=True)
class JudgedSamples:
    """Samples of a cube that a claim was judged on, described by texts that may be empty."""

    cube: Path
    boundary: str
    size: str  # unit cells along warp × weft: one size, or smallest and largest
    options: str
    experiment: str = ""

    @classmethod
    def of(cls, path: Path, cube: xr.Dataset, at: Sequence[Labels]) -> "JudgedSamples":
        """Describe the samples ``at`` of a cube at one value of every swept setting."""
        known = {size for labels in at if (size := _unit_cells(cube, labels)) is not None}
        sizes = sorted(known, key=lambda size: (size[0] * size[1], size))
        ends = [f"{cells_y} × {cells_x}" for cells_x, cells_y in (*sizes[:1], *sizes[-1:])]
        boundaries = dict.fromkeys(_boundary_of(cube, labels) for labels in at)
        boundary, span = ", ".join(filter(None, boundaries)), " to ".join(dict.fromkeys(ends))
        options = ", ".join(
            f"{name} {value:g}" if isinstance(value, float) else f"{name} {value}"
            for name, value in stated_options(cube).items()
            if name != "boundary"
        )
        return cls(path, boundary, span, options, source_of(cube) if is_measured(cube) else "")


def preference(cube: xr.Dataset, at: Sequence[Labels]) -> tuple[bool, int, float]:
    """Sort key for cubes: clamped samples first, then more of them, then larger ones."""
    sizes = [np.prod(_unit_cells(cube, labels) or 0) for labels in at]
    another = any(_boundary_of(cube, labels) != "clamped" for labels in at)
    return another, -len(at), -float(np.mean(sizes)) if sizes else 0.0


def _boundary_of(cube: xr.Dataset, labels: Labels) -> str:
    if is_measured(cube):
        return "clamped"
    along = dict(zip(base_dims(cube), labels, strict=True))
    return str((stated_options(cube) | along).get("boundary", ""))


def _unit_cells(cube: xr.Dataset, labels: Labels) -> tuple[int, int] | None:
    """Unit cells of one sample along (weft, warp), as stated or counted in the local strains."""
    names = [name for name in ("unit_cells_x", "unit_cells_y", "strain_xx") if name in cube]
    sample = one_sample(cube[["status", *names]], labels)
    stated = [float(sample.get(f"unit_cells_{axis}", np.nan)) for axis in "xy"]
    if np.isfinite(stated).all():
        return int(stated[0]), int(stated[1])
    if "strain_xx" in sample:
        strained = sample["strain_xx"].notnull().any("applied_strain")
        if strained.any():
            return int(strained.any("cell_y").sum()), int(strained.any("cell_x").sum())
    cells = parameters_of(cube).get("unit_cells")
    return (int(cells[1]), int(cells[0])) if cells else None


def stated_options(cube: xr.Dataset) -> dict[str, Any]:
    """The model options of a cube, with the gap between the walls and the swept settings."""
    z_max = parameters_of(cube).get("sheet", {}).get("z_max")
    swept = {
        str(name): each.item()
        for name, each in cube.coords.items()
        if not each.dims and name not in (SOURCE, *base_dims(cube))
    }
    return model_options(cube) | ({"z_max": z_max} if z_max else {}) | swept
