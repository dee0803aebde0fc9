"""Charts of stitch_chart are read back as the same patches and stripes; what is none is named."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import knitlab as kl
from knitlab.api.simulation import case_of_design
from knitlab.export.knitting.patches import read_patches
from knitlab.export.knitting.stitch_chart import stitch_chart
from tests.export.knitting.charts import case_of
from tests.refusals import refused

PAPER = kl.defaults().designs.root["paper"].pairs
STARTS = ["valley", "mountain"]


def knits_of(chart):
    """The knit of every stitch, by the patch that it lies in."""
    rows, columns = np.diff(chart.row_borders), np.diff(chart.column_borders)
    return np.repeat(np.repeat(chart.knit, rows, axis=0), columns, axis=1)


def chart_of(design, start):
    parameters = kl.defaults().with_tables(model=kl.Model(garter_start=start))
    return stitch_chart(case_of_design(design, [0.0], parameters, kl.Protocol(), electrodes=False))


def assert_is_read_back(chart):
    read = read_patches(chart.front, "any")
    assert read.messages == ()
    # The pattern makes the same stitches, through the model.
    design = kl.Design(
        read.n_stripe,
        read.n_subunit,
        boundary="periodic",
        pattern=read.pattern(),
        unit_cells=read.chart.repeats,
    )
    course, wale = read.begins_at
    begun = np.roll(chart.front, (1 - course, 1 - wale), (0, 1))
    assert (chart_of(design, read.garter_start).front == begun).all()
    return read


@pytest.mark.parametrize("design", PAPER, ids=str)
def test_every_design_of_the_paper_is_read_back(design):
    n_stripe, n_subunit = design
    read = assert_is_read_back(stitch_chart(case_of(n_stripe=n_stripe, n_subunit=n_subunit)))
    assert (read.n_stripe, read.n_subunit) == design
    assert read.begins_at == (1, 1)
    assert read.pattern().rows == ("GR", "RG")
    assert read.pattern().column_stitches is None


@pytest.mark.parametrize("start", STARTS)
@pytest.mark.parametrize(
    "pattern", ["basket", "ribbed_bands", "framed", "graded", "graded_stripes"]
)
def test_other_patterns_are_read_back(pattern, start):
    sizes = {} if pattern.startswith("graded") else {"n_stripe": 4, "n_subunit": 16}
    workflow = "periodic" if sizes else "graded"
    chart = stitch_chart(case_of(workflow, pattern=pattern, garter_start=start, **sizes))
    read = assert_is_read_back(chart)
    assert read.garter_start == start
    assert (knits_of(read.chart) == knits_of(chart)).all()


def has_no_plain_line(rows):
    """A whole row or column of plain knit may also be the end of a garter patch or of a rib one."""
    return all(set(line) != {"P"} for line in (*rows, *map("".join, zip(*rows, strict=True))))


@st.composite
def patterns(draw):
    """Patterns of up to 3 × 3 patches with sizes and stripes of their own, all three knits."""
    rows, columns = draw(st.integers(1, 3)), draw(st.integers(1, 3))
    letters = draw(
        st.lists(
            st.text("RGP", min_size=columns, max_size=columns), min_size=rows, max_size=rows
        ).filter(has_no_plain_line)
    )
    n = st.sampled_from([2, 4])
    row_n = draw(st.lists(n, min_size=rows, max_size=rows))
    column_n = draw(st.lists(n, min_size=columns, max_size=columns))
    # At least 16 wales or 32 courses, so that every stripe is longer than it is wide.
    multiple = st.integers(1, 3)
    return kl.Pattern(
        rows=letters,
        row_n_stripe=row_n,
        column_n_stripe=column_n,
        row_courses=[32 * draw(multiple) for _ in range(rows)],
        column_stitches=[16 * draw(multiple) for _ in range(columns)],
    )


@given(patterns(), st.sampled_from(STARTS))
def test_any_pattern_of_slender_stripes_is_read_back_as_the_same_stitches(pattern, start):
    """Where several patterns have the same stitches, one may be found that begins elsewhere."""
    assert_is_read_back(chart_of(kl.Design(2, 8, boundary="periodic", pattern=pattern), start))


def test_a_chart_that_begins_within_a_stripe_is_moved_over_its_edges():
    front = stitch_chart(case_of(n_stripe=4, n_subunit=16)).front
    read = read_patches(np.roll(front, (12, 6), (0, 1)), "any")
    assert (read.messages, read.begins_at) == ((), (13, 7))
    assert (read.chart.front == front).all()


@pytest.mark.slow
def test_a_stitch_that_fits_no_patch_is_named_and_its_pattern_kept():
    front = stitch_chart(case_of(n_stripe=4, n_subunit=16)).front.copy()
    front[4, 6] = ~front[4, 6]
    read = read_patches(front, "any")
    (message,) = read.messages
    assert "course 5, wale 7" in message
    assert read.pattern().rows == ("GR", "RG")


@pytest.mark.parametrize(
    ("front", "words"),
    [
        (np.ones((8, 6)), ["wales 1 to 6", "even number"]),
        (np.tile([1, 1, 1, 0, 0, 0], (24, 4)), ["wales 1 to 24", "n_stripe 3", "material"]),
        (np.tile([[1], [1], [1], [0], [0], [0]], (4, 8)), ["3 courses", "even number"]),
    ],
    ids=["plain of no stripes", "rib of no stripe", "odd garter"],
)
def test_sizes_that_no_stripe_has_are_named(front, words):
    read = read_patches(np.array(front, bool), "any")
    assert any(all(word in each for word in words) for each in read.messages)
    if "material" not in "".join(read.messages):
        with refused("pattern"):
            read.pattern()
