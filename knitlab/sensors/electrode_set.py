"""Any number of electrodes on a fabric, by the ridges or the grid cells that they cover."""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise, product
from typing import NamedTuple

import numpy as np
import xarray as xr

from knitlab.cubes.recorded_case import recorded_case
from knitlab.io.errors import InputError, Mistake, invalid, shown
from knitlab.model.electrodes import (
    Capacitor,
    ElectrodeLayout,
    Electrodes,
    Strip,
    ridge_lines,
    ridge_strip,
)
from knitlab.model.network import MeshShape
from knitlab.model.pattern import Along
from knitlab.observables.capacitance.panels import PanelChart, panel_chart
from knitlab.solvers.case import Case

ALONG: tuple[Along, Along] = ("course", "wale")  # by axis
Group = tuple[Strip, ...]


class ElectrodeKind(NamedTuple):
    """A way to name an electrode: what names look like, and the strip that a name means."""

    pattern: str  # regular expression
    example: str
    strip: Callable[[re.Match[str], Case, ElectrodeLayout], Strip | None]  # None: no such strip


def sensor_case(case_file: xr.Dataset) -> tuple[Case, Capacitor]:
    """The case of a case file, and its capacitor; InputError if it has none, or was sheared."""
    case = recorded_case(case_file)
    if case.capacitor is None:
        raise invalid(case.label, "has no electrodes; simulate it with layout = checkerboard")
    if "length_shear" in case_file:
        raise invalid(case.label, "was sheared; simulate it with load = warp, weft or biaxial")
    return case, case.capacitor


@dataclass(frozen=True)
class ElectrodeSet:
    """Electrodes by name; ``axis`` is the one that they are periodic along, None on a sample."""

    names: tuple[str, ...]
    groups: tuple[Group, ...]
    along: int
    shape: MeshShape

    @property
    def axis(self) -> int | None:
        """The axis along which all electrodes repeat with the fabric."""
        return self.along if self.shape.periodic else None

    def overlapping(self, one: int, other: int) -> bool:
        """Whether two electrodes cover a part of the fabric in common."""
        shared = (a.shared(b) for a in self.groups[one] for b in self.groups[other])
        return any(strip is not None and strip.area > 0 for strip in shared)

    def chart(self, level: int, bare: bool = False) -> PanelChart:
        """Panels of all electrodes; with number ``len(names)``, those of the cloth between them."""
        charts = [
            panel_chart(Electrodes((group, ()), ALONG[self.along]), self.shape, level)
            for group in [*map(self._divided, self.groups), *([self._bare] if bare else [])]
        ]
        number = np.repeat(np.arange(len(charts)), [len(chart.cell) for chart in charts])
        cells, corners = ([getattr(c, name) for c in charts] for name in ("cell", "corners"))
        return PanelChart(np.concatenate(cells), np.concatenate(corners), number)

    def _divided(self, group: Group) -> Group:
        """An electrode, divided where others cross it, for there its charge is concentrated."""
        pieces = []
        others = [strip for each in self.groups if each is not group for strip in each]
        for strip in group:
            shared = [strip, *filter(None, map(strip.shared, others))]
            crossing = [each.extents for each in shared if each.area > 0]
            x, y = (sorted({end for pair in crossing for end in pair[k]}) for k in (0, 1))
            pieces += [Strip(*a, *b) for a, b in product(pairwise(x), pairwise(y))]
        return tuple(pieces)

    @property
    def _bare(self) -> Group:
        """What no electrode covers, if all of them are as long as the fabric; or InputError."""
        across = 1 - self.along
        cells = self.shape.cells_x, self.shape.cells_y
        strips = [strip for group in self.groups for strip in group]
        if any(strip.extents[self.along] != (0, cells[self.along]) for strip in strips):
            message = "needs electrodes that are ridges from end to end; leave it out"
            raise invalid("cloth_permittivity", message)
        ends = sorted(strip.extents[across] for strip in strips)
        lines = [0.0, *(end for pair in ends for end in pair), float(cells[across])]
        gaps = [(a, b) for a, b in zip(lines[::2], lines[1::2], strict=True) if b > a]
        whole = 0.0, float(cells[self.along])
        return tuple(Strip(*gap, *whole) if across == 0 else Strip(*whole, *gap) for gap in gaps)


def electrode_set(case: Case, capacitor: Capacitor, names: Sequence[str] = ()) -> ElectrodeSet:
    """The named electrodes, or every ridge of the layout's face.

    ``w2`` is the second ridge along a wale of the fabric, ``c1`` the first along a course, and
    ``left:right/bottom:top`` a rectangle of grid cells.
    """
    shape = case.mesh_shape
    layout = capacitor.layout
    if not names:
        count = len(ridge_lines(replace(layout, within="fabric"), case.sample, case.options))
        names = [f"{layout.along[0]}{k + 1}" for k in range(count)]
    if len(names) < 2 or len(set(names)) < len(names):
        raise invalid("electrodes", f"are {', '.join(names) or 'none'}; give two different names")
    letters = {part[:1] for name in names for part in name.split("+")} & {"w", "c"}
    if shape.periodic and letters == {"w", "c"}:
        message = "cross those along courses, but periodic electrodes repeat along one direction"
        raise invalid("electrodes along wales", f"{message}; simulate with boundary = clamped")
    groups = tuple(tuple(_strips(name, case, layout)) for name in names)
    only = letters.pop() if len(letters) == 1 else layout.along[0]
    electrodes = ElectrodeSet(tuple(names), groups, 0 if only == "c" else 1, shape)
    if mistakes := list(_mistakes(electrodes, capacitor)):
        raise InputError(Mistake("electrodes", each) for each in mistakes)
    return electrodes


def _mistakes(chosen: ElectrodeSet, capacitor: Capacitor) -> Iterator[str]:
    ends = 0.0, float((chosen.shape.cells_x, chosen.shape.cells_y)[chosen.along])
    named = list(zip(chosen.names, chosen.groups, strict=True))
    for (name, group), (other_name, other) in combinations(named, 2):
        for each in Electrodes((group, other), ALONG[chosen.along]).mistakes(chosen.shape):
            if "touch" not in each or not capacitor.dielectric_thickness:
                names = f"{name} (A) and {other_name} (B)"
                yield f"{each}, of {names}; separate them, or set dielectric_thickness"
    if chosen.shape.periodic:
        for name, group in named:
            if any(strip.extents[chosen.along] != ends for strip in group):
                yield f"{name} does not continue across the boundary of periodic fabric"


def _ridge(name: re.Match[str], case: Case, layout: ElectrodeLayout) -> Strip:
    along: Along = "wale" if name[1] == "w" else "course"
    layout = replace(layout, along=along, within="fabric")
    lines = ridge_lines(layout, case.sample, case.options)
    number = int(name[2])
    if number > len(lines):
        message = f"does not exist: this fabric has {len(lines)} ridges of this kind"
        raise invalid(f"electrode {name[0]}", f"{message}; choose one of them")
    return ridge_strip(layout, case.sample, case.stitches_per_cell, lines[number - 1])


def _rectangle(name: re.Match[str], case: Case, layout: ElectrodeLayout) -> Strip | None:
    left, right, bottom, top = map(float, name.groups())
    return Strip(left, right, bottom, top) if left < right and bottom < top else None


KINDS = (
    ElectrodeKind(r"([wc])([1-9]\d*)", "a ridge such as w1 or c2", _ridge),
    ElectrodeKind(r"(\d+):(\d+)/(\d+):(\d+)", "grid cells such as 0:2/4:8", _rectangle),
)
"""Every way to name an electrode."""


def _strips(name: str, case: Case, layout: ElectrodeLayout) -> Iterator[Strip]:
    """The strips of a name, whose parts are joined by ``+``."""
    for part in name.split("+"):
        matches = ((kind, re.fullmatch(kind.pattern, part)) for kind in KINDS)
        strips = (kind.strip(match, case, layout) for kind, match in matches if match)
        strip = next(strips, None)
        if strip is None:
            examples = ", or ".join(kind.example for kind in KINDS)
            message = f"is not a ridge or a rectangle of grid cells; give {examples}, joined by +"
            raise invalid(f"electrode {shown(part)}", message)
        yield strip
