"""Labels of points, placed where they cover neither each other nor a point."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Annotation
from matplotlib.transforms import Bbox

DIRECTIONS = ((1, 0), (-1, 0), (1, 1), (-1, 1), (1, -1), (-1, -1), (0, 1), (0, -1))
DISTANCES = (5, 10, 16, 24, 34, 46, 60)
"""Distances from the point that are tried [pt]; a label that is not next to it has a line to it."""
POINT = 3.5
"""Half the width of what a label must not cover at every point [pt]."""


@dataclass(frozen=True)
class Label:
    """The label of a point.

    Attributes:
        x: position of the point.
        y: position of the point.
        text: its text.
        size: size of the type [pt].
        colour: colour of the text.
    """

    x: float
    y: float
    text: str
    size: float = 6
    colour: str = "black"


def place_labels(figure: Figure, axes: Axes, labels: Sequence[Label]) -> list[Annotation]:
    """Write labels beside their points, each where it covers no other label and no point.

    Labels are placed in the given order, each at the first of the distances and directions that
    is free, lies within the axes and is no nearer to another point; far ones have a line to their
    point. One for which none is free is left out. Call it last: the layout of the figure must not
    change any more.

    Args:
        figure: the figure.
        axes: axes that hold the points.
        labels: the labels, the most important first.

    Returns:
        The texts that were written.
    """
    figure.draw_without_rendering()
    scale = figure.dpi / 72
    points = axes.transData.transform([(label.x, label.y) for label in labels]).reshape(-1, 2)
    half = POINT * scale
    taken = [Bbox.from_extents(x - half, y - half, x + half, y + half) for x, y in points]
    inside = axes.get_window_extent()
    written = []
    for label, own in zip(labels, points, strict=True):
        for distance, (right, up) in itertools.product(DISTANCES, DIRECTIONS):
            text = _written(axes, label, (right * distance, up * distance))
            box = text.get_window_extent()
            within = np.all(box.min >= inside.min) and np.all(box.max <= inside.max)
            clear = distance > DISTANCES[0] or _is_nearest(own, points, box)
            if within and clear and not box.count_overlaps(taken):
                taken.append(box)
                written.append(text)
                if distance > DISTANCES[0]:
                    _join(axes, label, text)
                break
            text.remove()
    return written


def _is_nearest(own: np.ndarray, points: np.ndarray, box: Bbox) -> bool:
    """Whether no point is nearer to a box than its own."""
    distances = np.linalg.norm(points - np.clip(points, box.min, box.max), axis=1)
    return bool(np.linalg.norm(own - np.clip(own, box.min, box.max)) <= distances.min() + 1e-6)


def _written(axes: Axes, label: Label, offset: tuple[float, float]) -> Annotation:
    right, up = np.sign(offset).astype(int)
    return axes.annotate(
        label.text,
        (label.x, label.y),
        xytext=offset,
        textcoords="offset points",
        ha=("center", "left", "right")[right],
        va=("center", "bottom", "top")[up],
        fontsize=label.size,
        color=label.colour,
    )


def _join(axes: Axes, label: Label, text: Annotation) -> None:
    """Draw a line from a point to its label."""
    axes.annotate(
        "",
        (label.x, label.y),
        xytext=text.get_position(),
        textcoords="offset points",
        arrowprops={"arrowstyle": "-", "lw": 0.4, "color": "0.5", "shrinkA": 0, "shrinkB": 2},
        zorder=0,
    )
