"""The samples of a cube that a claim is about, and which of them have a complete test."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import Annotated

import numpy as np
import xarray as xr
from pydantic import Field, PositiveInt

from knitlab.cube.cube_file import base_dims
from knitlab.cube.schema import DESIGN_DIMS, STRIPE_DIMS, VARIABLES, Status
from knitlab.io.toml import StrictModel
from knitlab.validation.finding import Labels, NotMeasured

Design = Annotated[tuple[PositiveInt, PositiveInt], Field(strict=False)]
BOUNDARY = "periodic"
"""Boundary of the pure stripes of claims: the paper computes them without ends."""


class Checkerboards(StrictModel):
    """Checkerboards (n_stripe, n_subunit) that a claim is about.

    Attributes:
        designs: these designs; by default all in the cube.
        n_stripe: only designs with these n_stripe, by default any.
        without: designs to leave out.
        at_least: number of designs in the paper.
    """

    designs: Annotated[tuple[Design, ...], Field(strict=False)] = ()
    n_stripe: Annotated[tuple[PositiveInt, ...], Field(strict=False)] = ()
    without: Annotated[tuple[Design, ...], Field(strict=False)] = ()
    at_least: PositiveInt = 1


class PureStripes(StrictModel):
    """Pure stripes that a claim is about.

    Attributes:
        smallest, largest: range of stitches across the stripe, by knit.
        at_least: number of stripes in the paper.
    """

    smallest: dict[str, int] = Field(default_factory=dict)
    largest: dict[str, int] = Field(default_factory=dict)
    at_least: PositiveInt = 1


@dataclass(frozen=True)
class Samples:
    """Samples that a claim is about.

    Attributes:
        cube: the cube of the samples.
        complete: labels of the samples with a complete test.
        wanted: number of samples that the claim is about.
        counted: what is counted: designs or stripes.
    """

    cube: xr.Dataset
    complete: tuple[Labels, ...]
    wanted: int
    counted: str

    def values(self, of: Callable[[xr.Dataset], float]) -> dict[Labels, float]:
        """A number for each complete sample, without samples for which it is not finite."""
        found = {labels: of(one_sample(self.cube, labels)) for labels in self.complete}
        return {labels: value for labels, value in found.items() if np.isfinite(value)}

    def too_few(self, measured: int) -> NotMeasured:
        """The exception for too few measured samples."""
        count = f"{measured} of {self.wanted} {self.counted}"
        none = f"none of the {self.counted}"
        return NotMeasured(f"{count if measured else none} measured", self.wanted, self.counted)


def checkerboards(cube: xr.Dataset, about: Checkerboards, *variables: str) -> Samples:
    """The checkerboards of a cube that a claim is about.

    Args:
        cube: the cube, at one value of every swept setting.
        about: which of them.
        variables: names of variables that the cube must have.

    Raises:
        NotMeasured: if the cube has no checkerboards, or lacks a variable.
    """
    statuses = _statuses(cube, DESIGN_DIMS, "checkerboards", variables)
    asked: tuple[Labels, ...] = about.designs or tuple(
        labels
        for labels, status in statuses.items()
        if status != Status.excluded
        and (not about.n_stripe or labels[0] in about.n_stripe)
        and labels not in about.without
    )
    complete = tuple(labels for labels in asked if statuses.get(labels) == Status.ok)
    wanted = len(asked) if about.designs else max(about.at_least, len(asked))
    return Samples(cube[["status", *variables]], complete, wanted, "designs")


def stripes(cube: xr.Dataset, about: PureStripes, *variables: str) -> Samples:
    """The pure stripes of a cube that a claim is about; see :func:`checkerboards`."""
    statuses = {
        labels: status
        for labels, status in _statuses(cube, STRIPE_DIMS, "pure stripes", variables).items()
        if labels[-1] == BOUNDARY
    }
    if not statuses:
        raise NotMeasured(f"no {BOUNDARY} pure stripes in this cube")
    asked = [
        (knit, n, boundary)
        for (knit, n, boundary), status in statuses.items()
        if status != Status.excluded
        and about.smallest.get(str(knit), 0) <= int(n) <= about.largest.get(str(knit), int(n))
    ]
    complete = tuple(labels for labels in asked if statuses[labels] == Status.ok)
    wanted = max(about.at_least, len(asked))
    return Samples(cube[["status", *variables]], complete, wanted, "stripes")


def _statuses(
    cube: xr.Dataset, dims: tuple[str, ...], kind: str, variables: tuple[str, ...]
) -> dict[Labels, int]:
    """The status of every sample of a cube, by its labels."""
    if base_dims(cube) != dims:
        raise NotMeasured(f"no {kind} in this cube")
    if missing := sorted(set(variables) - set(map(str, cube.data_vars))):
        raise NotMeasured(f"no {', '.join(missing)} in this cube")
    labels = product(*(cube[dim].values.tolist() for dim in dims))
    return dict(zip(labels, cube["status"].values.ravel().tolist(), strict=True))


def one_sample(cube: xr.Dataset, labels: Labels) -> xr.Dataset:
    """A cube at the labels of one sample."""
    return cube.sel(dict(zip(base_dims(cube), labels, strict=True)))


def name_of(labels: Labels) -> str:
    """The name of a sample in text: ``(4, 16)``, or ``rib 4``."""
    first, second = labels[:2]
    return f"{first} {second}" if isinstance(first, str) else f"({first}, {second})"


def unit_of(variable: str) -> str:
    """The unit of a variable, to follow a number; empty for a plain number."""
    unit = VARIABLES[variable].units
    return "" if unit == "1" else f" {unit}"
