"""The figure of a stitch chart: colours, counts, legend and the part that is drawn."""

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.patches import Polygon

from knitlab.export.knitting.knitout import knitout
from knitlab.export.knitting.leads import leads
from knitlab.export.knitting.machine import read_machine
from knitlab.export.knitting.specification import Specification
from knitlab.export.knitting.stitch_chart import stitch_chart
from knitlab.figures.stitch_chart import (
    A4,
    BACK,
    ELECTRODES,
    FRONT,
    chart_title,
    drawn_block,
    specification_sheet,
    stitch_chart_figure,
)
from knitlab.model.stitches import Gauge
from tests.export.knitting.charts import case_of
from tests.export.knitting.test_shaping import PIECES, shaped

PLATED = stitch_chart(case_of("sensor", n_stripe=4, n_subunit=16))
FOUR = stitch_chart(case_of("sensor", n_stripe=4, n_subunit=16), (2, 2))


@pytest.fixture
def small_page(monkeypatch):
    """A page on which one of the repeats of a chart has room."""
    monkeypatch.setattr("knitlab.figures.stitch_chart.MAX_DRAWN", FOUR.repeat)


def grey(colour):
    return np.dot(to_rgb(colour), [0.299, 0.587, 0.114])


def texts(figure):
    return [text.get_text() for text in figure.findobj(lambda each: hasattr(each, "get_text"))]


def test_every_stitch_has_the_colour_of_its_bed_and_electrode():
    (image,) = stitch_chart_figure(PLATED).axes[0].images
    drawn = image.get_array()
    assert drawn.shape[:2] == PLATED.front.shape
    bare = PLATED.plated == 0
    assert (drawn[PLATED.front & bare] == to_rgb(FRONT)).all()
    assert (drawn[~PLATED.front & bare] == to_rgb(BACK)).all()
    assert np.allclose(drawn[PLATED.front & (PLATED.plated == 2)], to_rgb(ELECTRODES[2][0]))
    assert np.allclose(drawn[~PLATED.front & (PLATED.plated == 1)], to_rgb(ELECTRODES[1][1]))


def test_beds_differ_without_colour():
    assert grey(FRONT) - grey(BACK) > 0.25
    for on_front, on_back in ELECTRODES.values():
        assert grey(on_front) - grey(on_back) > 0.15


def test_a_stitch_is_drawn_twice_as_wide_as_high_and_both_axes_count():
    axes = stitch_chart_figure(PLATED).axes[0]
    assert axes.get_aspect() == 0.5
    for axis, count in ((axes.xaxis, PLATED.wales), (axes.yaxis, PLATED.courses)):
        labels = [label.get_text() for label in axis.get_ticklabels()]
        assert (labels[0], labels[-1]) == ("1", str(count))


def test_of_a_large_chart_one_repeat_is_drawn_with_its_electrodes(small_page):
    rows, columns = drawn_block(FOUR)
    assert (rows.stop - rows.start, columns.stop - columns.start) == FOUR.repeat
    assert (FOUR.plated[rows, columns] > 0).any()
    assert "2 × 2" in chart_title(FOUR)


def ends_drawn(figure):
    """Markers of the ends of yarns: their kinds and positions, as wale and course from 0."""
    lines = (line for line in figure.axes[0].lines if line.get_marker() in ("o", "s"))
    return {(line.get_marker(), *(line.get_xydata()[0] - 0.5).tolist()) for line in lines}


def test_ends_of_conductive_yarn_are_drawn_at_their_stitches_and_named_beyond_the_edge():
    machine = read_machine()
    ends = leads(knitout(PLATED, machine), PLATED, machine)
    figure = stitch_chart_figure(PLATED, ends)
    kinds = {True: "o", False: "s"}
    assert ends_drawn(figure) == {(kinds[each.enters], each.wale, each.course) for each in ends}
    assert {"A in", "A out", "B in", "B out"} <= set(texts(figure))
    assert ends_drawn(stitch_chart_figure(PLATED)) == set()


def test_of_ends_only_those_in_the_part_that_is_drawn_are_shown(small_page):
    machine = read_machine()
    ends = leads(knitout(FOUR, machine), FOUR, machine)
    rows, columns = drawn_block(FOUR)
    figure = stitch_chart_figure(FOUR, ends)
    shown = [
        each
        for each in ends
        if rows.start <= each.course < rows.stop and columns.start <= each.wale < columns.stop
    ]
    assert 0 < len(ends_drawn(figure)) == len(shown) < len(ends)


def test_the_sheet_states_every_line_of_the_specification():
    machine = read_machine({"waste_courses": 2, "end": "drop"})
    sheet = Specification(PLATED, machine, Gauge(0.5, 0.2), knitout(PLATED, machine))
    figure = specification_sheet(sheet)
    assert tuple(figure.get_size_inches()) == pytest.approx(A4)
    shown = texts(figure)
    assert {name for name, _ in sheet.rows()} <= set(shown)
    assert "plating adds" in shown
    assert "B out" in shown
    # A stitch of 0.5 mm is no stitch of needles 1.69 mm apart, which the sheet says too.
    assert any("Warning: stitch_width is 0.5 mm" in text for text in shown)


def test_a_shaped_piece_is_drawn_within_its_edge():
    piece = shaped(PIECES["steps both ways"])
    axes = stitch_chart_figure(piece).axes[0]
    edge = next(each for each in axes.patches if isinstance(each, Polygon))
    middles = np.argwhere(np.ones(piece.front.shape))[:, ::-1] + 0.5
    assert (edge.get_path().contains_points(middles) == piece.present.ravel()).all()
    for drawn in (*axes.images, *axes.collections):
        path, _ = drawn.get_clip_path().get_transformed_path_and_affine()
        assert len(path) == len(edge.get_path())
    machine = read_machine({"waste_courses": 2})
    sheet = Specification(piece, machine, Gauge(1.35, 0.8), knitout(piece, machine))
    assert "4 to 28 wales a course" in texts(specification_sheet(sheet))
