"""Stitch charts: which needle bed knits every stitch of a case, and which stitches are plated.

A stripe is n wales of rib or 2n courses of garter, counted from the border of its patch, front bed
first; of garter with ``garter_start = "mountain"`` back first. A front stripe of rib is a mountain,
one of garter a valley. With ``fold_phase = "stripe_border"`` the model's folds lie half a stripe
later, and their conductors are plated half a stripe before. Single folds are lines on one bed
between panels of 1 × 1 rib, which does not curl.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import binary_dilation

from knitlab.export.knitting.chart import Face, StitchChart
from knitlab.io.errors import InputError, Mistake, invalid
from knitlab.model.electrodes import BadLayout, ElectrodeLayout, ridge_lines
from knitlab.model.network import Spans
from knitlab.model.pattern import KNIT_OF_LETTER
from knitlab.model.stripe import GARTER_STITCHES_PER_RIB_STITCH
from knitlab.solvers.case import Case

FOLD_WALES = 2  # width of a single fold's line on one bed, that of the narrowest stripe measured
MAX_STITCHES = 4_000_000  # of a chart; a machine has some 500 needles
ASPECT = 2.0  # length over width of a sample on needles (paper, "Kinematics": 200 by 400 mm)


def stitch_chart(
    case: Case,
    repeats: tuple[int, int] | None = None,
    needles: int | None = None,
    face: Face | None = None,
) -> StitchChart:
    """The stitches of a case, repeated ``repeats`` times along (warp, weft) or to fill needles.

    Conductors lie on ``face``; by default where their ridges point, or A in front and B behind.
    """
    if case.folds and set(case.sample.knit.ravel()) != {"P"}:
        message = f"has {len(case.folds)} single folds beside rib or garter, which fold anyway"
        raise invalid(f"design {case.label}", f"{message}; use a pattern of plain knit")
    turned = is_turned(case)
    unit = _patch_lines(replace(case, unit_cells=(1, 1)))
    repeat = unit[0].size, unit[1].size
    if needles is not None:
        courses, wales = repeat[::-1] if turned else repeat
        if not (along_x := needles // wales):
            message = f"are too few: one repeat takes {wales}; give at least {wales}"
            raise invalid(f"needles {needles}", message)
        length = ASPECT * along_x * wales * GARTER_STITCHES_PER_RIB_STITCH
        along_y = max(1, round(length / courses))
        repeats = (along_x, along_y) if turned else (along_y, along_x)
    case = replace(case, unit_cells=repeats or case.unit_cells)
    stitches = math.prod(repeat) * math.prod(case.unit_cells)
    if stitches > MAX_STITCHES:
        message = f"make {stitches:,} stitches; take fewer repeats, for at most {MAX_STITCHES:,}"
        raise invalid(f"repeats {case.unit_cells}", message)
    rows, columns = _patch_lines(case)
    knit = case.sample.knit[np.ix_(rows.patch, columns.patch)]
    garter = (rows.first != (case.options.garter_start == "mountain" and not case.pure))[:, None]
    front = np.where(knit == "G", garter, np.where(knit == "R", columns.first, True))
    if case.folds:
        front = _panels(case, rows, columns)
    plated = _plated_stitches(case, rows, columns)
    knit = np.vectorize(KNIT_OF_LETTER.__getitem__)(case.sample.knit)
    borders = (rows.borders, columns.borders)
    periodic = case.options.boundary == "periodic"
    if case.folds:
        knit = np.full(knit.shape, "panel")
    if turned:
        front = front.T
        plated = plated.T
        borders = borders[::-1]
        repeat = repeat[::-1]
        knit = np.full(knit.T.shape, "rib")
    faces = _plated_faces(case, face)
    spans = None if case.spans is None else _course_spans(case.spans, rows, columns)
    return StitchChart(case.label, front, plated, faces, knit, *borders, repeat, periodic, spans)


def _course_spans(
    spans: Spans, rows: "_PatchLines", columns: "_PatchLines"
) -> Int[np.ndarray, "course 2"]:
    """First wale, and the one after the last, of every course of a shaped piece.

    An edge that moves by no more than a wale in a course goes straight from the middle of a row to
    the next; one that moves by more has a step between them.
    """
    lines = rows.grid_lines
    courses = np.arange(rows.size) + 0.5
    edges = []
    for edge in columns.grid_lines[np.array(spans)].T:
        at, wale = [], []
        for row, here in enumerate(edge):
            at.append((lines[row] + lines[row + 1]) / 2)
            wale.append(here)
            after = edge[min(row + 1, len(edge) - 1)]
            if abs(after - here) > lines[row + 1] - lines[row]:
                at += [lines[row + 1]] * 2
                wale += [here, after]
        # Halves are rounded up, so that an even slope moves by equal steps.
        edges.append(np.floor(np.interp(courses, at, wale) + 0.5).astype(int))
    return np.stack(edges, axis=1)


def is_turned(case: Case) -> bool:
    """Whether the chart of a case is turned: pure rib has its ridges along x in the model."""
    return case.pure and case.weft.knit == "rib"


class _PatchLines(NamedTuple):
    borders: Int[np.ndarray, " border"]
    patch: Int[np.ndarray, " stitch"]  # row or column that a course or wale lies in
    first: Bool[np.ndarray, " stitch"]  # whether in the first, third, … stripe of that
    grid_lines: Float[np.ndarray, " line"]  # courses or wales before each grid line of the model

    @property
    def size(self) -> int:
        return int(self.borders[-1])

    def between(self, ends: tuple[float, float]) -> Int[np.ndarray, " stitch"]:
        """Courses or wales, at least one, between grid coordinates, also beyond its edges."""
        lines = self.grid_lines
        position = np.array(ends)
        count = len(lines) - 1
        stitch = np.interp(position % count, np.arange(count + 1), lines)
        low, high = np.floor(position // count * lines[-1] + stitch + 0.5).astype(int)
        return np.arange(low, max(high, low + 1))


def _lines_along(
    stripe: Int[np.ndarray, " patch"], periods: Int[np.ndarray, " patch"], cells_per_period: int
) -> _PatchLines:
    """Lines of rows or columns with a number of periods of two stripes, of ``stripe`` stitches."""
    borders = np.concatenate([[0], np.cumsum(2 * stripe * periods)])
    patch = np.repeat(np.arange(len(periods)), np.diff(borders))
    in_patch = np.arange(borders[-1]) - borders[patch]
    cells = np.repeat(2 * stripe / cells_per_period, cells_per_period * periods)
    grid_lines = np.concatenate([[0], np.cumsum(cells)])
    return _PatchLines(borders, patch, in_patch // stripe[patch] % 2 == 0, grid_lines)


def _patch_lines(case: Case) -> tuple[_PatchLines, _PatchLines]:
    """The rows and the columns of patches of a case; pure ones by the stitch's shape of 1:2."""
    sample = case.sample
    grading = case.grading
    warp = (case.warp,) if grading is None else grading.warp
    weft = (case.weft,) if grading is None else grading.weft
    rows = np.array([stripe.n for stripe in warp])[sample.row_stripe]
    columns = np.array([stripe.n for stripe in weft])[sample.column_stripe]
    if is_turned(case):
        columns = columns * GARTER_STITCHES_PER_RIB_STITCH
    elif case.pure:
        columns = np.maximum(1, columns // GARTER_STITCHES_PER_RIB_STITCH)
    cells = sample.cells_per_period
    of_rows = _lines_along(rows, sample.row_periods, cells)
    return of_rows, _lines_along(columns, sample.column_periods, cells)


def _panels(case: Case, rows: _PatchLines, columns: _PatchLines) -> Bool[np.ndarray, "course wale"]:
    front = np.tile(np.arange(columns.size) % 2 == 0, (rows.size, 1))
    # Those along courses go through where they cross others.
    folds = sorted(case.sample.grid_folds(), key=lambda each: each[0].along == "course")
    for fold, line, *ends in folds:
        across, along = (columns, rows) if fold.along == "wale" else (rows, columns)
        width = FOLD_WALES * (1 if fold.along == "wale" else GARTER_STITCHES_PER_RIB_STITCH)
        middle = int(np.rint(across.grid_lines[line]))
        first, last = np.rint(along.grid_lines[ends]).astype(int).tolist()
        lines = np.arange(middle - width // 2, middle + width // 2)
        if case.options.boundary != "periodic":
            lines = lines[(lines >= 0) & (lines < across.size)]
        on_front = (fold.sense == "mountain") == (fold.along == "wale")
        stitches = np.ix_(lines % across.size, np.arange(first, last))
        (front.T if fold.along == "wale" else front)[stitches] = on_front
    return front


def _plated_stitches(
    case: Case, rows: _PatchLines, columns: _PatchLines
) -> Int[np.ndarray, "course wale"]:
    """Electrode of every stitch, 0 where none; it goes on over the seam of periodic fabric."""
    plated = np.zeros((rows.size, columns.size), int)
    if case.capacitor is None:
        return plated
    try:
        electrodes = case.electrodes
    except BadLayout as error:
        raise InputError(Mistake("layout", message) for message in error.messages) from error
    late = (not case.capacitor.layout.mask) and case.options.fold_phase == "stripe_border"
    shift = np.zeros(2)
    shift[1 - electrodes.axis] = late * case.sample.cells_per_period / 4
    for number, strips in enumerate(electrodes.strips, start=1):
        for strip in strips:
            x, y = strip.extents - shift[:, None]
            courses = rows.between(y)
            wales = columns.between(x)
            plated[np.ix_(courses % rows.size, wales % columns.size)] = number
    touching = binary_dilation(plated == 1, np.ones((3, 3))) & (plated == 2)
    if touching.any():
        course, wale = np.argwhere(touching)[0].tolist()
        where = f"course {course + 1}, wale {wale + 1}, as whole stitches"
        hint = "choose a smaller width, or ridges farther apart"
        raise invalid("layout", f"electrodes A and B touch at {where}; {hint}")
    return plated


def _plated_faces(case: Case, face: Face | None) -> tuple[Face, Face]:
    layout = ElectrodeLayout() if case.capacitor is None else case.capacitor.layout
    if (chosen := face or layout.face) != "both":
        return chosen, chosen
    if layout.mask:
        return "front", "back"
    lines = ridge_lines(layout, case.sample, case.options)
    mountains = ridge_lines(replace(layout, face="front"), case.sample, case.options)
    of_a, of_b = (lines[number - 1] in mountains for number in layout.ridges)
    return "front" if of_a else "back", "front" if of_b else "back"
