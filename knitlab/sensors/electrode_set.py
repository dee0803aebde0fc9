"""Any number of electrodes on a fabric, by the ridges or the grid cells that they cover."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations, pairwise, product

import numpy as np
import xarray as xr

from knitlab.cubes.recorded_case import recorded_case
from knitlab.io.errors import InputError, Mistake, invalid, shown
from knitlab.model.electrodes import Capacitor, ElectrodeLayout, Electrodes, Strip, ridge_lines
from knitlab.model.network import MeshShape
from knitlab.model.pattern import Along
from knitlab.observables.capacitance.panels import PanelChart, panel_chart
from knitlab.solvers.case import Case

ALONG: tuple[Along, Along] = ("course", "wale")  # by axis
Group = tuple[Strip, ...]
REMEDY = "give ridges such as w1 or c2, joined as w1+w3, or grid cells such as 0:2/4:8"


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

    def charts(self, level: int, bare: bool = False) -> PanelChart:
        """Panels of all electrodes; with number ``len(names)``, those of the cloth between them."""
        groups = [*map(self._divided, self.groups), *([self._bare] if bare else [])]
        charts = [
            panel_chart(Electrodes((group, ()), ALONG[self.along]), self.shape, level)
            for group in groups
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
            pieces += [
                Strip(*columns, *rows) for columns, rows in product(pairwise(x), pairwise(y))
            ]
        return tuple(pieces)

    @property
    def _bare(self) -> Group:
        """What no electrode covers, if all of them are as long as the fabric; or InputError."""
        across = 1 - self.along
        cells = self.shape.cells_x, self.shape.cells_y
        strips = [strip for group in self.groups for strip in group]
        if any(strip.extents[self.along] != (0, cells[self.along]) for strip in strips):
            message = "is of cloth whose electrodes are ridges from end to end; leave it out"
            raise invalid("cloth_permittivity", message)
        ends = sorted(strip.extents[across] for strip in strips)
        lines = [0.0, *(end for pair in ends for end in pair), float(cells[across])]
        gaps = [(a, b) for a, b in zip(lines[::2], lines[1::2], strict=True) if b > a]
        whole = 0.0, float(cells[self.along])
        return tuple(Strip(*gap, *whole) if across == 0 else Strip(*whole, *gap) for gap in gaps)


def electrode_set(case: Case, capacitor: Capacitor, names: Sequence[str] = ()) -> ElectrodeSet:
    """The named electrodes, or every ridge of the layout's face; InputError if they are impossible.

    ``w2`` is the second ridge along a wale, ``c1`` the first along a course, counted in the whole
    fabric on the face of the layout, and ``left:right/bottom:top`` a rectangle of grid cells.
    """
    shape, layout = case.mesh_shape, capacitor.layout
    ridges = partial(_ridges, case, layout)
    if not names:
        letter = layout.along[0]
        names = [f"{letter}{k + 1}" for k in range(len(ridges(letter)))]
    if len(names) < 2 or len(set(names)) < len(names):
        raise invalid("electrodes", f"are {', '.join(names) or 'none'}; give two or more different")
    letters = {part[:1] for name in names for part in name.split("+")} & {"w", "c"}
    if shape.periodic and letters == {"w", "c"}:
        message = "cross those along courses, and periodic fabric repeats along one direction"
        raise invalid("electrodes along wales", f"{message}; simulate with boundary = clamped")
    groups = tuple(tuple(_strips(name, ridges)) for name in names)
    only = letters.pop() if len(letters) == 1 else layout.along[0]
    of_set = ElectrodeSet(tuple(names), groups, 0 if only == "c" else 1, shape)
    if mistakes := list(_faults(of_set, capacitor)):
        raise InputError(Mistake("electrodes", each) for each in mistakes)
    return of_set


def _faults(of_set: ElectrodeSet, capacitor: Capacitor) -> Iterator[str]:
    """What is wrong with electrodes on their fabric."""
    ends = 0.0, float((of_set.shape.cells_x, of_set.shape.cells_y)[of_set.along])
    for one, other in combinations(range(len(of_set.names)), 2):
        pair = Electrodes((of_set.groups[one], of_set.groups[other]), ALONG[of_set.along])
        for each in pair.mistakes(of_set.shape):
            if "touch" not in each or not capacitor.dielectric_thickness:
                names = f"{of_set.names[one]} (A) and {of_set.names[other]} (B)"
                yield f"{each}, of {names}; separate them, or set dielectric_thickness"
    if of_set.shape.periodic:
        for name, group in zip(of_set.names, of_set.groups, strict=True):
            if any(strip.extents[of_set.along] != ends for strip in group):
                yield f"{name} does not continue across the boundary of periodic fabric"


def _ridges(case: Case, layout: ElectrodeLayout, letter: str) -> list[Strip]:
    """The ridges along wales (w) or courses (c) as electrodes of the layout's width and span."""
    wale, sample = letter == "w", case.sample
    layout = replace(layout, along="wale" if wale else "course", within="fabric")
    start, end = (fraction * sample.grid[not wale] for fraction in layout.span)
    strips = []
    for line in ridge_lines(layout, sample, case.options):
        stripe = sample.cells_per_period / 2
        across = case.stitches_per_cell[wale][line % sample.grid[wale]]
        width = stripe if layout.width == "stripe" else layout.width / across
        low, high = line - width / 2, line + width / 2
        strips.append(Strip(low, high, start, end) if wale else Strip(start, end, low, high))
    return strips


def _strips(name: str, ridges: "partial[list[Strip]]") -> Iterator[Strip]:
    """The strips of a name."""
    for part in name.split("+"):
        if cells := re.fullmatch(r"(\d+):(\d+)/(\d+):(\d+)", part):
            left, right, bottom, top = map(float, cells.groups())
            if left < right and bottom < top:
                yield Strip(left, right, bottom, top)
                continue
        elif (ridge := re.fullmatch(r"([wc])([1-9]\d*)", part)) is not None:
            known, number = ridges(ridge[1]), int(ridge[2])
            if number > len(known):
                message = f"is not there: this fabric has {len(known)} ridges of this kind"
                raise invalid(f"electrode {part}", f"{message}; choose one of them")
            yield known[number - 1]
            continue
        raise invalid(
            f"electrode {shown(part)}", f"is no ridge or rectangle of grid cells; {REMEDY}"
        )
