"""Stitch charts: stripes by their stitches, and the folds of the model they come from."""

import itertools

import numpy as np
import pytest

import knitlab as kl
from knitlab.export.knitting.stitch_chart import stitch_chart
from knitlab.model.fold_lines import patch_senses
from tests.export.knitting.charts import case_of
from tests.refusals import refused

DESIGN = {"n_stripe": 4, "n_subunit": 16}
PATTERNS = ["checkerboard", "basket", "ribbed_bands", "framed", "graded_stripes"]


def runs(line):
    """Lengths of the runs of equal values of a line."""
    return np.diff([0, *(np.flatnonzero(np.diff(line)) + 1), len(line)]).tolist()


def test_a_rib_patch_alternates_n_wales_and_a_garter_patch_2n_courses():
    chart = stitch_chart(case_of(**DESIGN))
    rib, garter = chart.front[:32, :16], chart.front[:32, 16:]
    assert runs(rib[0]) == [4, 4, 4, 4]
    assert (rib == rib[0]).all()
    assert runs(garter[:, 0]) == [8, 8, 8, 8]
    assert (garter == garter[:, :1]).all()
    assert rib[0, 0]
    assert garter[0, 0]


@pytest.mark.parametrize("pattern", PATTERNS)
def test_sizes_are_those_that_the_cube_counts(pattern):
    case = case_of(**DESIGN, pattern=pattern)
    chart = stitch_chart(case)
    assert chart.front.shape == (case.stitches.courses, case.stitches.wales)
    assert (chart.row_borders[-1], chart.column_borders[-1]) == chart.front.shape


def lines_in_stitches(case):
    """Whole stitches before each grid line, along y and x."""
    return [np.concatenate([[0], np.cumsum(of)]).astype(int) for of in case.stitches_per_cell]


@pytest.mark.parametrize("pattern", PATTERNS)
@pytest.mark.parametrize("garter_start", ["valley", "mountain"])
def test_folds_at_stripe_centres_are_mountains_in_front_ribs_and_valleys_in_front_garters(
    pattern, garter_start
):
    case = case_of(**DESIGN, pattern=pattern, fold_phase="stripe_centre", garter_start=garter_start)
    chart, (rows, columns) = stitch_chart(case), lines_in_stitches(case)
    rib, garter = patch_senses(case.sample, case.options)
    assert rib.any()
    for row, column in np.argwhere(rib):
        assert chart.front[rows[row], columns[column]] == (rib[row, column] > 0)
    for row, column in np.argwhere(garter):
        assert chart.front[rows[row], columns[column]] == (garter[row, column] < 0)


@pytest.mark.parametrize("pattern", PATTERNS)
def test_folds_at_stripe_borders_lie_just_where_the_bed_changes_within_like_patches(pattern):
    case = case_of(**DESIGN, pattern=pattern, fold_phase="stripe_border")
    chart, (rows, columns) = stitch_chart(case), lines_in_stitches(case)
    for sense, cells, along in zip(
        patch_senses(case.sample, case.options),
        (case.sample.knit_cells("rib"), case.sample.knit_cells("garter")),
        (1, 0),
        strict=True,
    ):
        changes = chart.front != np.roll(chart.front, 1, axis=along)
        at_lines = changes[np.ix_(rows[:-1], columns[:-1])]
        assert ((sense != 0) == (at_lines & (cells & np.roll(cells, 1, axis=along)))).all()


@pytest.mark.slow
def test_needles_are_filled_with_whole_repeats_twice_as_long_as_wide():
    chart = stitch_chart(case_of(**DESIGN), needles=360)
    sample = case_of("paper", **DESIGN)
    assert chart.repeats == sample.unit_cells == (22, 11)
    assert chart.difference(stitch_chart(sample).stitches) is None


def test_pure_rib_is_turned_and_pure_garter_is_not():
    rib, garter = (
        stitch_chart(case_of("stripes", knit=[knit], n=[4], boundaries=["periodic"]))
        for knit in ("rib", "garter")
    )
    assert set(runs(rib.front[0])) == {4}
    assert (rib.front == rib.front[0]).all()
    assert set(runs(garter.front[:, 0])) == {4}
    assert (garter.front == garter.front[:, :1]).all()
    assert rib.courses == 2 * rib.wales
    assert garter.courses == 2 * garter.wales


def test_electrodes_take_whole_stitches_about_their_ridges():
    chart = stitch_chart(case_of("sensor", **DESIGN))
    assert [(chart.plated[0] == number).sum() for number in (1, 2)] == [4, 4]
    assert (chart.plated == chart.plated[0]).all()
    assert chart.plated_face == ("front", "front")


@pytest.mark.parametrize("phase", ["stripe_border", "stripe_centre"])
@pytest.mark.parametrize("start", ["mountain", "valley"])
@pytest.mark.parametrize(
    ("layout", "knit"), [("checkerboard", "rib"), ("checkerboard_courses", "garter")]
)
def test_conductors_of_the_front_cover_mountains_of_curled_knit(phase, start, layout, knit):
    """Rib rises in front stripes, which curl to their back at their sides; garter in back ones."""
    settings = {"layout": layout, "fold_phase": phase, "garter_start": start}
    chart = stitch_chart(case_of("sensor", n_stripe=4, n_subunit=32, **settings))
    in_patches = np.repeat(
        np.repeat(chart.knit == knit, np.diff(chart.row_borders), axis=0),
        np.diff(chart.column_borders),
        axis=1,
    )
    for electrode in (1, 2):
        on_folds = chart.front[in_patches & (chart.plated == electrode)]
        assert len(on_folds) == (4 * 64 if knit == "rib" else 8 * 32)
        assert (on_folds == (knit == "rib")).all()


def test_electrodes_that_touch_as_whole_stitches_are_refused():
    case = case_of("sensor", n_stripe=2, n_subunit=16, width=3.8)
    with refused("layout", "touch", "course 1", "width"):
        stitch_chart(case)


@pytest.mark.parametrize("boundary", ["periodic", "clamped"])
def test_single_folds_are_lines_on_one_bed_between_panels_on_both(boundary):
    chart = stitch_chart(case_of(**DESIGN, pattern="miura", boundary=boundary))
    front = chart.front.copy()
    # Along wales a front line is a mountain, which ends where the next course line begins.
    middle = chart.column_borders[1]
    for row, (low, high) in enumerate(itertools.pairwise(chart.row_borders)):
        assert (front[low + 2 : high - 2, middle - 1 : middle + 1] == (row % 2 == 0)).all()
        front[low + 2 : high - 2, middle - 1 : middle + 1] = [False, True]  # as the rib there
    # Along courses a front line is a valley; the pattern begins with a mountain.
    for row, border in enumerate(chart.row_borders[1:4]):
        assert (front[border - 2 : border + 2] == (row % 2 == 1)).all()
    panel = front[2 : chart.row_borders[1] - 2, 2 : chart.column_borders[2] - 2]
    assert (panel == (np.arange(panel.shape[1]) % 2 == 0)).all()
    assert set(chart.knit.ravel()) == {"panel"}


def test_folds_of_a_pattern_of_one_line():
    fold = {"along": "wale", "at": 1, "theta_0": 1.5, "sense": "valley", "start": 0.5}
    pattern = kl.Pattern(rows=("PP",), folds=[fold])
    sample = kl.knit(kl.Design(2, 8, boundary="periodic", pattern=pattern))
    rib = "".join("kp"[k % 2] for k in range(16))
    letters = ["".join("pk"[int(on)] for on in line) for line in sample.chart.front]
    assert letters == [rib] * 8 + [rib[:7] + "pp" + rib[9:]] * 8
    assert sample.check(interpret=False).mistakes == ()
    assert "here 1.5 rad" in sample.remarks[0]


def test_single_folds_beside_stripes_are_refused():
    pattern = kl.Pattern(rows=("PR", "PP"), folds=[{"along": "course", "at": 1, "theta_0": 1.5}])
    with refused("1 single folds", "plain knit"):
        kl.knit(kl.Design(2, 8, boundary="periodic", pattern=pattern))


def test_less_needles_than_a_repeat_are_refused():
    with refused("needles 20", "32"):
        stitch_chart(case_of(**DESIGN), needles=20)
