"""Outlines: drawings and tables of widths, their edges, and how far they are apart."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from knitlab.export.pieces.outline import Outline, read_outline
from tests.refusals import refused

SQUARE = np.array([[0.0, 0.0], [40.0, 0.0], [40.0, 40.0], [0.0, 40.0]])


def drawn(folder, inside, size='width="100mm" height="80mm" viewBox="0 0 100 80"'):
    path = folder / "piece.svg"
    path.write_text(f'<svg xmlns="http://www.w3.org/2000/svg" {size}>{inside}</svg>')
    return path


@pytest.mark.parametrize(
    ("inside", "size"),
    [
        ('<circle cx="50" cy="40" r="30"/>', 'width="100mm" height="80mm" viewBox="0 0 100 80"'),
        ('<circle cx="500" cy="400" r="300"/>', 'width="10cm" height="8cm" viewBox="0 0 1000 800"'),
        (
            '<g transform="translate(20 10) scale(2)">'
            '<path d="M0 15 a15 15 0 1 0 30 0 a15 15 0 1 0 -30 0 z"/></g>',
            'width="100mm" height="80mm" viewBox="0 0 100 80"',
        ),
    ],
)
def test_a_drawn_circle_has_its_chords(tmp_path, inside, size):
    outline = read_outline(drawn(tmp_path, inside, size))
    assert outline.size == pytest.approx((60, 60), rel=1e-3)
    heights = np.array([5.0, 20.0, 30.0, 51.0])
    left, right = outline.edges(heights)
    np.testing.assert_allclose(right, np.sqrt(30**2 - (heights - 30) ** 2), rtol=2e-3)
    np.testing.assert_allclose(left, -right, atol=1e-3)


@pytest.mark.parametrize(
    "inside",
    [
        '<path d="M20 10 h60 v60 h-60"/>',
        '<path d="M20 10 h60 v60 h-60 z"/>',
        '<polyline points="20,10 80,10 80,70 20,70"/>',
        '<rect x="20" y="10" width="60" height="60"/>',
    ],
)
def test_a_line_that_is_not_closed_is_closed_as_if_it_were_filled(tmp_path, inside):
    left, right = read_outline(drawn(tmp_path, inside)).edges(np.array([1.0, 59.0]))
    np.testing.assert_allclose([left, right], [[-30, -30], [30, 30]], rtol=1e-5)


def test_a_drawing_has_its_top_above_its_bottom(tmp_path):
    outline = read_outline(drawn(tmp_path, '<path d="M40 10 L60 10 L90 70 L10 70 Z"/>'))
    left, right = outline.edges(np.array([0.0, 60.0]))
    np.testing.assert_allclose(right - left, [80, 20], rtol=1e-4)


@given(st.lists(st.floats(5, 200), min_size=2, max_size=6), st.floats(0, 1))
def test_widths_are_those_of_the_table(widths, place):
    length = 30.0 * np.arange(len(widths))
    left, right = Outline.of_widths(length, widths).edges(np.array([place * length[-1]]))
    assert right - left == pytest.approx(np.interp(place * length[-1], length, widths), rel=1e-3)
    assert left == pytest.approx(-right)


@pytest.mark.parametrize("unit", [("mm", 1), ("cm", 0.1), ("in", 1 / 25.4)])
def test_a_table_of_widths_is_read_in_its_unit(tmp_path, unit):
    path = tmp_path / "sleeve.csv"
    name, factor = unit
    rows = "".join(f"{at * factor},{width * factor}\n" for at, width in ((0, 100), (200, 160)))
    path.write_text(f"length [{name}],width [{name}]\n{rows}")
    assert read_outline(path).size == pytest.approx((160, 200))


@given(st.floats(-30, 30), st.floats(-30, 30))
def test_the_distance_of_a_moved_square_is_how_far_it_moved(across, along):
    """Of two squares, the farthest points are corners whose nearest ones are corners or edges."""
    square = Outline(SQUARE)
    moved = Outline(SQUARE + np.array([across, along]))
    assert square.distance(moved) == pytest.approx(np.hypot(across, along), abs=0.1)
    assert moved.centred_on(square).distance(square) == pytest.approx(0, abs=1e-9)


def test_a_centre_is_that_of_the_area():
    triangle = Outline(np.array([[0.0, 0.0], [30.0, 0.0], [0.0, 60.0]]))
    np.testing.assert_allclose(triangle.centre, [10, 20])


@pytest.mark.parametrize(
    ("inside", "size", "words"),
    [
        ('<rect width="10" height="10"/>', 'viewBox="0 0 100 80"', ("piece.svg", "width", "mm")),
        ('<rect width="10" height="10"/>', 'width="100px" height="80px"', ("100px", "mm")),
        ("", 'width="100mm" height="80mm" viewBox="0 0 100 80"', ("0 closed", "one")),
        (
            '<rect width="10" height="10"/><circle cx="50" cy="50" r="9"/>',
            'width="100mm" height="80mm" viewBox="0 0 100 80"',
            ("2 closed", "one"),
        ),
        (
            '<path d="M0 0 h60 v60 h-20 v-40 h-20 v40 h-20 z"/>',
            'width="100mm" height="80mm" viewBox="0 0 100 80"',
            ("4 times", "turn"),
        ),
    ],
)
def test_a_drawing_without_one_outline_is_refused(tmp_path, inside, size, words):
    with refused(*words):
        read_outline(drawn(tmp_path, inside, size))


def test_what_is_no_drawing_is_refused(tmp_path):
    path = tmp_path / "piece.svg"
    path.write_text("length,width\n0,10\n")
    with refused("piece.svg", "no drawing"):
        read_outline(path)
    with refused("other.svg"):
        read_outline(tmp_path / "other.svg")


@pytest.mark.parametrize(
    ("length", "width", "words"),
    [
        ([5], [10], ("1 row", "two")),
        ([0, 0], [10, 20], ("ascend",)),
        ([0, 10], [10, 0], ("0 mm", "above 0")),
    ],
)
def test_widths_that_make_no_outline_are_refused(length, width, words):
    with refused("outline", *words):
        Outline.of_widths(length, width)
