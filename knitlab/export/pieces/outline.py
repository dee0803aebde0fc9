"""The outline of a finished piece: a closed line that every course crosses twice."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from knitlab.io.errors import invalid
from knitlab.io.table_file import read_columns

EXAMPLE = "write it as in 'length [mm],width [mm]'"
SVG = ".svg"
WIDENING = "widening"  # a column of the table [1]
CURVE_POINTS = 64  # on a curve of a drawing
POINTS = 2000  # at equal distances, that stand for a line
MIN_SIZE = 1e-6  # of an outline [mm]
PHYSICAL = ("mm", "cm", "in", "pt", "pc", "q")

Points = Float[np.ndarray, "point 2"]
Along = Float[np.ndarray, " place"]
Places = Sequence[float] | Float[np.ndarray, " place"]


@dataclass(frozen=True, eq=False)
class Outline:
    """A closed line, x along the courses and y along the wales.

    Attributes:
        points: its corners in order; the lowest has y = 0, and x = 0 is in the middle [mm].
        widening: strain along the courses that the stretched piece is to have, by its place from 0
            to 1 along the relaxed piece; None if any is good [1].
    """

    points: Points
    widening: tuple[Along, Along] | None = None

    @classmethod
    def of(cls, points: Points, name: str) -> "Outline":
        """The outline through points; InputError if a course would cross it more than twice."""
        low, high = points.min(axis=0), points.max(axis=0)
        if not (np.isfinite(points).all() and (high - low).min() > MIN_SIZE):
            raise invalid(name, "has no area; give a closed outline")
        outline = cls(points - [(low[0] + high[0]) / 2, low[1]])
        levels = np.unique(outline.points[:, 1])
        for height in (levels[1:] + levels[:-1]) / 2:
            crossings = len(outline._crossings(height))
            if crossings != 2:
                message = f"is crossed {crossings} times at a height of {height:.4g} mm; a course"
                hint = "crosses a piece twice: give a shape without holes and arms, or turn it"
                raise invalid(name, f"{message} {hint}")
        return outline

    @classmethod
    def of_widths(
        cls,
        length: Places,
        width: Places,
        widening: Places | None = None,
        name: str = "outline",
    ) -> "Outline":
        """The symmetrical outline with a width at every place along the length [mm].

        ``widening`` is the wanted strain along the courses at these places [1]. InputError, with
        the ``name``, if the places do not ascend, a width is not above 0 or a strain is none.
        """
        half, at = np.asarray(width, float) / 2, np.asarray(length, float)
        if len(at) < 2:
            raise invalid(name, f"has {len(at)} rows; give the width at two places or more")
        if half.shape != at.shape or not (np.diff(at) > 0).all():
            raise invalid(name, "has lengths that do not ascend; give each once, with its width")
        if not (half > 0).all():
            raise invalid(name, f"has a width of {2 * half.min():g} mm; give all above 0")
        right = np.stack([half, at], axis=1)
        outline = cls.of(np.concatenate([right, (right * [-1, 1])[::-1]]), name)
        if widening is None:
            return outline
        wanted = np.asarray(widening, float)
        if wanted.shape != at.shape or not (np.abs(wanted) < 1).all():
            message = "has a widening that is no strain between -1 and 1; give one for each place"
            raise invalid(name, message)
        return replace(outline, widening=((at - at[0]) / (at[-1] - at[0]), wanted))

    @property
    def size(self) -> tuple[float, float]:
        """Largest width, and length [mm]."""
        width, length = np.ptp(self.points, axis=0).tolist()
        return width, length

    @cached_property
    def line(self) -> Points:
        """Points at equal distances along it [mm]."""
        corners = np.concatenate([self.points, self.points[:1]])
        along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1)))
        at = np.linspace(0, along[-1], POINTS, endpoint=False)
        return np.stack([np.interp(at, along, part) for part in corners.T], axis=1)

    @property
    def centre(self) -> Float[np.ndarray, "2"]:
        """Centre of its area [mm]."""
        (x, y), (u, v) = self.points.T, np.roll(self.points, -1, axis=0).T
        twice = x * v - u * y
        return np.array([(x + u) @ twice, (y + v) @ twice]) / (3 * twice.sum())

    def _crossings(self, height: float) -> Float[np.ndarray, " crossing"]:
        (x, y), (u, v) = self.points.T, np.roll(self.points, -1, axis=0).T
        crossing = (y < height) != (v < height)
        fraction = (height - y[crossing]) / (v[crossing] - y[crossing])
        return x[crossing] + fraction * (u[crossing] - x[crossing])

    def edges(
        self, heights: Float[np.ndarray, " height"]
    ) -> tuple[Float[np.ndarray, " height"], Float[np.ndarray, " height"]]:
        """The left and the right edge at heights [mm]."""
        _, length = self.size
        inside = np.clip(heights, 1e-6 * length, (1 - 1e-6) * length)
        crossings = [self._crossings(height) for height in inside]
        return np.array([x.min() for x in crossings]), np.array([x.max() for x in crossings])

    def distance(self, other: "Outline") -> float:
        """The Hausdorff distance: how far a point of either is at most from the other [mm]."""
        there, back = (
            cKDTree(one).query(line)[0].max()
            for one, line in ((self.line, other.line), (other.line, self.line))
        )
        return float(max(there, back))

    def centred_on(self, other: "Outline") -> "Outline":
        """The same outline, moved so that the centres of both areas coincide."""
        return Outline(self.points + other.centre - self.centre)


def read_outline(path: Path) -> Outline:
    """The outline in a drawing (SVG) or in a table of widths; InputError if there is none."""
    if path.suffix.lower() == SVG:
        return Outline.of(_drawn(path), str(path))
    needed = {"length": "mm", "width": "mm"}
    columns = read_columns(path, needed, EXAMPLE, optional=(WIDENING,), converts=True).numbers
    wanted = columns.get(WIDENING)
    return Outline.of_widths(columns["length"], columns["width"], wanted, str(path))


def _drawn(path: Path) -> Points:
    """The one closed line of a drawing, in mm with y upwards."""
    import svgelements

    try:
        # At 25.4 pixels per inch a pixel is a millimetre.
        drawing = svgelements.SVG.parse(str(path), ppi=25.4, reify=True)
    except OSError as error:
        raise invalid(str(path), f"cannot be read: {error.strerror}") from error
    except Exception as error:  # the library lets through what its XML parser raises
        raise invalid(str(path), f"is no drawing: {error}") from error
    unit = str(drawing.values.get("width", "")).strip().lower()
    if not unit.endswith(PHYSICAL):
        stated = f"width {unit}" if unit else "no width"
        message = f"has {stated}, so that its size is unknown; state its width and height in mm"
        raise invalid(str(path), message)
    lines = [points for element in drawing.elements() for points in _lines(element)]
    if len(lines) != 1:
        message = f"has {len(lines)} closed lines; give one, the outline of the piece"
        raise invalid(str(path), message)
    return lines[0] * [1, -1]


def _lines(element: Any) -> Iterator[Points]:
    """The lines of an element of a drawing, closed as they would be filled."""
    from svgelements import Close, Line, Move, Path, Shape

    if not isinstance(element, Shape):
        return
    for part in Path(element).as_subpaths():
        points = []
        for segment in part:
            if isinstance(segment, Move):
                points.append(segment.end)
                continue
            pieces = 1 if isinstance(segment, Line | Close) else CURVE_POINTS
            points += [segment.point(float(at)) for at in np.linspace(0, 1, pieces + 1)[1:]]
        corners = np.array([(point.x, point.y) for point in points])
        if len(points) > 1 and points[0] == points[-1]:
            corners = corners[:-1]
        if len(corners) > 2:
            yield corners
