"""What a reader would object to in a figure, found by the boxes that matplotlib draws."""

from collections.abc import Iterable, Iterator
from itertools import combinations
from typing import Any
from unittest.mock import patch

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from tests.figures.explorer.test_colours import lab

ROOM = 0.15  # of its height, by which letters are smaller than the box of their text
LIKE = 12.0  # distance in CIELAB below which two colours are taken for one


def faults(figure: Figure) -> list[str]:
    """Overlapping and slanted texts, texts outside, lines through texts, empty panels, twins."""
    boxes = _texts(figure)
    return [
        *_overlaps(boxes),
        *_outside(figure, boxes),
        *_crossings(figure, boxes),
        *(f"empty panel: {axes.get_title()!r}" for axes in figure.axes if _is_empty(axes)),
        *(twins for legend in figure.findobj(Legend) for twins in _twins(legend)),
    ]


def _texts(figure: Figure) -> list[tuple[Text, Bbox]]:
    """The texts that are drawn, and their boxes in dots."""
    drawn: dict[Text, Bbox] = {}
    draw = Text.draw

    def recorded(text: Text, renderer: Any, *others: Any) -> None:
        if text.get_visible() and text.get_text().strip():
            # The box of an annotation would hold its arrow, too.
            drawn[text] = Text.get_window_extent(text, renderer)
        draw(text, renderer, *others)

    with patch.object(Text, "draw", recorded):
        figure.draw_without_rendering()
    return list(drawn.items())


def _inner(box: Bbox, lines: int) -> Bbox:
    by = ROOM * box.height / lines
    return Bbox.from_extents(box.x0 + 1, box.y0 + by, box.x1 - 1, box.y1 - by)


def _lines(text: Text) -> int:
    return text.get_text().count("\n") + 1


def _overlaps(boxes: list[tuple[Text, Bbox]]) -> Iterator[str]:
    for text, _ in boxes:
        if text.get_rotation() % 90:
            yield f"slanted: {text.get_text()!r}"
    inner = [(text, _inner(box, _lines(text))) for text, box in boxes]
    for (one, its), (other, theirs) in combinations(inner, 2):
        if its.overlaps(theirs):
            yield f"overlap: {one.get_text()!r} and {other.get_text()!r}"


def _outside(figure: Figure, boxes: list[tuple[Text, Bbox]]) -> Iterator[str]:
    x0, y0, x1, y1 = figure.bbox.extents
    for text, box in boxes:
        if box.x0 < x0 - 1 or box.y0 < y0 - 1 or box.x1 > x1 + 1 or box.y1 > y1 + 1:
            yield f"outside: {text.get_text()!r}"


def _crossings(figure: Figure, boxes: list[tuple[Text, Bbox]]) -> Iterator[str]:
    """Texts that a curve crosses, unless they have a background of their own."""
    bare = [
        (text, _inner(box, _lines(text)))
        for text, box in boxes
        if text.get_bbox_patch() is None and not text.get_path_effects()
    ]
    for axes in figure.axes:
        for line in filter(Line2D.get_visible, axes.lines):
            points = _points(line)
            points = points[_within(points, axes.bbox)]
            for text, box in bare:
                if _within(points, box).any():
                    yield f"a line crosses {text.get_text()!r}"


def _points(line: Line2D) -> np.ndarray:
    """Points along a line, or those of its marks, in dots."""
    path = line.get_transform().transform_path(line.get_path())
    if line.get_linestyle() not in ("None", "", " "):
        path = path.interpolated(20)
    return np.asarray(path.vertices)[np.isfinite(path.vertices).all(axis=1)]


def _within(points: np.ndarray, box: Bbox) -> np.ndarray:
    return np.logical_and((points > box.min).all(axis=1), (points < box.max).all(axis=1))


def _is_empty(axes: Axes) -> bool:
    """Whether a panel with a frame shows nothing but lines of reference."""
    if not axes.axison or not axes.get_visible():
        return False
    lines = (line for line in axes.lines if line.get_transform().contains_branch(axes.transData))
    seen = any(np.isfinite(line.get_xydata()).all(axis=1).any() for line in lines)
    marked = [*axes.patches, *axes.collections, *axes.images, *axes.texts]
    return not seen and not marked


def _twins(legend: Legend) -> Iterator[str]:
    """Entries of a legend that look the same."""
    looks = zip(legend.legend_handles, legend.get_texts(), strict=True)
    seen = [(_look(handle), text.get_text()) for handle, text in looks]
    for (one, its), (other, theirs) in combinations(seen, 2):
        if one and other and one[1:] == other[1:] and _alike(one[0], other[0]):
            yield f"look the same: {its!r} and {theirs!r}"


def _look(handle: Artist | None) -> tuple[Any, ...] | None:
    """The colours of a handle, and all else that tells it from others."""
    if isinstance(handle, Line2D):
        hollow = to_rgba(handle.get_markerfacecolor())[3] == 0
        dashes = (
            str(handle._unscaled_dash_pattern) if handle.is_dashed() else handle.get_linestyle()
        )
        mark = handle.get_marker(), hollow, dashes, handle.get_linewidth(), handle.get_markersize()
        return [handle.get_color()], *mark
    if handle is None or not hasattr(handle, "get_facecolor"):
        return None
    colours = np.atleast_2d(handle.get_facecolor()), np.atleast_2d(handle.get_edgecolor())
    if not colours[0].size or colours[0][0, 3] == 0 == colours[1][0, 3]:
        return None  # a note
    return [colours[0][0]], getattr(handle, "get_hatch", str)(), handle.get_linestyle()


def _alike(one: Iterable[Any], other: Iterable[Any]) -> bool:
    pairs = zip(map(to_rgba, one), map(to_rgba, other), strict=True)
    return all(float(np.linalg.norm(_lab(a) - _lab(b))) < LIKE for a, b in pairs)


def _lab(colour: Any) -> np.ndarray:
    red_green_blue, alpha = np.array(colour[:3]), colour[3]
    encoded = 1 - alpha + alpha * red_green_blue
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    return np.asarray(lab(linear[None]))[0]
