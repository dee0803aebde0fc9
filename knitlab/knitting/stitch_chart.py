"""Stitch charts: which needle bed knits every stitch of a case, and which stitches are plated.

A stripe is whole stitches wide: n wales of rib, 2n courses of garter. Stripes are counted from the
border of their patch, which holds an even number of them, and alternate between the beds:

- In a rib patch n front wales alternate with n back wales, front first.
- In a garter patch 2n front courses alternate with 2n back courses. Front comes first where the
  model has ``garter_start = "valley"``, back where it has ``"mountain"``.
- Plain knit is knitted on the front bed.

That follows from how plain knit curls, to its back at its sides and to its face at its ends: a
front stripe of rib is a mountain, one of garter a valley. With ``fold_phase = "stripe_centre"`` the
folds of the model run along the middles of these stripes and point to these sides. With
``"stripe_border"`` they run where a front stripe meets a back stripe, and the chart is the same.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool

from knitlab.fabric.pattern import KNIT_OF_LETTER
from knitlab.fabric.stripe import GARTER_STITCHES_PER_RIB_STITCH
from knitlab.io.errors import fault
from knitlab.knitting.chart import Face, StitchChart
from knitlab.knitting.patch_lines import PatchLines, is_turned, patch_lines
from knitlab.knitting.plating import plated_faces, plated_stitches
from knitlab.simulation.case import Case

ASPECT = 2.0
"""Length over width of a sample on a number of needles (paper, "Kinematics": 200 by 400 mm)."""


def stitch_chart(
    case: Case,
    repeats: tuple[int, int] | None = None,
    needles: int | None = None,
    face: Face | None = None,
) -> StitchChart:
    """The stitches of a case.

    Args:
        case: the case. A pure stripe has its ridges along x in the model, whatever its knit; its
            chart has those of rib along the wales, and is about as long as wide in cloth.
        repeats: how often its pattern repeats along the warp (y) and the weft (x) of the model; by
            default as often as in the case.
        needles: in place of that, needles that it fills with as many whole repeats as fit, about
            twice as long as wide.
        face: face of the fabric that conductors lie on; by default that to which their ridges
            point, and for a drawing on both faces A on the front and B on the back.

    Raises:
        BadInput: if the case has single folds, whose angle no stitch sets; if not one repeat fits
            the needles; or if its electrodes cannot be plated by whole stitches.

    Example:
        >>> from knitlab.sweep.plan import make_plan
        >>> (case,) = make_plan("preview", {"n_stripe": 4, "n_subunit": 16}).cases.values()
        >>> chart = stitch_chart(case)
        >>> chart.courses, chart.wales, chart.stitches.in_words(0, 4)
        (64, 32, 'a back knit')
    """
    if case.folds:
        raise fault(
            f"design {case.label}",
            f"has {len(case.folds)} single folds, and no stitch is known to make a fold of a given"
            " rest angle; take a pattern of rib, garter and plain knit alone",
        )
    turned = is_turned(case)
    unit = patch_lines(replace(case, unit_cells=(1, 1)))
    repeat = unit[0].count, unit[1].count
    if needles is not None:
        repeats = _filling(needles, repeat[::-1] if turned else repeat)
        repeats = repeats[::-1] if turned else repeats
    case = replace(case, unit_cells=repeats or case.unit_cells)
    rows, columns = patch_lines(case)
    chart = StitchChart(
        title=case.label,
        front=_front_stitches(case, rows, columns),
        plated=plated_stitches(case, (rows.at_grid_lines, columns.at_grid_lines)),
        plated_face=plated_faces(case, face),
        knit=np.vectorize(KNIT_OF_LETTER.__getitem__)(case.sample.knit),
        row_borders=rows.borders,
        column_borders=columns.borders,
        repeat=repeat,
        periodic=case.options.boundary == "periodic",
    )
    return _turned(chart) if turned else chart


def _filling(needles: int, repeat: tuple[int, int]) -> tuple[int, int]:
    """Repeats along the courses and the wales that fill some needles.

    Raises:
        BadInput: if not one fits.
    """
    courses, wales = repeat
    along_x = needles // wales
    if not along_x:
        raise fault(
            f"needles {needles}", f"one repeat takes {wales} of them; give at least {wales}"
        )
    length = ASPECT * along_x * wales * GARTER_STITCHES_PER_RIB_STITCH
    return max(1, round(length / courses)), along_x


def _front_stitches(
    case: Case, rows: PatchLines, columns: PatchLines
) -> Bool[np.ndarray, "course wale"]:
    knit = case.sample.knit[np.ix_(rows.patch, columns.patch)]
    back_first = case.options.garter_start == "mountain" and not case.pure
    garter = rows.in_first_stripe != back_first
    return np.where(
        knit == "G", garter[:, None], np.where(knit == "R", columns.in_first_stripe, True)
    )


def _turned(chart: StitchChart) -> StitchChart:
    """A chart of pure rib with its ridges along the wales."""
    return replace(
        chart,
        front=chart.front.T,
        plated=chart.plated.T,
        knit=np.full(chart.knit.T.shape, "rib"),
        row_borders=chart.column_borders,
        column_borders=chart.row_borders,
        repeat=chart.repeat[::-1],
    )
