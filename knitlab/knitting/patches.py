"""From any stitch chart to a pattern: its patches, their stripes, and what is neither.

All courses of a row of patches are alike, or change between two kinds of course if it has garter;
so do all wales of a column with rib. Each axis is therefore cut into bands by itself: a back stripe
that repeats, with an equal front stripe before it, is a period, and where no stripes are, courses
that are equal make one band. Then each patch is the one of rib, garter and plain knit that has the
fewest stitches of another kind, and these are named.
"""

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from jaxtyping import Bool

from knitlab.fabric.pattern import KNIT_OF_LETTER
from knitlab.fabric.settings import GarterStart
from knitlab.io.atomic_write import atomic_write
from knitlab.io.errors import fault
from knitlab.knitting.bands import PER_RIB_STITCH, Band, bands_of
from knitlab.knitting.chart import StitchChart
from knitlab.measure.knit_size import Gauge
from knitlab.sweep.parameters import defaults
from knitlab.sweep.patterns import Pattern, is_pattern_name

ODD_STITCHES = (0, 1, 2)  # in which courses or wales may differ and still count as alike
SLENDER = (2, 1)  # lengths of a stripe over its width, at least, that are tried
MOST_SHIFTS = 8  # along each axis, if a chart does not begin with a patch
MOST_BANDS = 48  # along each axis, of a chart that has a pattern
MOST_PATCHES = 12  # that are described one by one
STARTS: tuple[GarterStart, GarterStart] = "valley", "mountain"


@dataclass(frozen=True, eq=False)
class ReadChart:
    """A stitch chart as a pattern.

    Attributes:
        chart: the stitches, with the patches that were found.
        rows, columns: its rows of patches in courses, the lowest first, and columns in wales.
        letters: knit of every patch: R, G or P, the lowest row first.
        garter_start: which of its stripes a garter patch begins with, as the model option.
        begins_at: course and wale of the file, from 1, that the chart begins at; not (1, 1) if its
            pattern only fits when it is moved over the edge.
        odd: stitches that no patch has, (course, wale).
    """

    chart: StitchChart
    rows: tuple[Band, ...]
    columns: tuple[Band, ...]
    letters: np.ndarray
    garter_start: GarterStart
    begins_at: tuple[int, int]
    odd: Bool[np.ndarray, "course wale"]

    def __repr__(self) -> str:
        return f"<ReadChart {self.chart.size}, {len(self.problems)} problems>"

    @property
    def n_stripe(self) -> int:
        """The most frequent size of its ribs [wales], or half of its garter stripes [courses]."""
        return self._most_frequent("n", min(self._known))

    @property
    def n_subunit(self) -> int:
        """The most frequent width of its patches [wales], or half their height [courses]."""
        return self._most_frequent("size", 0)

    def _most_frequent(self, name: str, default: int) -> int:
        sizes: Counter[int] = Counter()
        for axis, bands in (("course", self.rows), ("wale", self.columns)):
            for band in bands:
                size, per = band.stripe if name == "n" else band.size, PER_RIB_STITCH[axis]
                if size is not None and size % per == 0:
                    sizes[size // per] += 1
        return max(sizes, key=lambda size: (sizes[size], -size), default=default)

    @cached_property
    def _known(self) -> list[int]:
        """Values of n_stripe that the stripe tables have."""
        return defaults().stripes.sizes("rib")

    def _n(self, axis: str, band: Band) -> int | None:
        """n_stripe of a band; without stripes, one that fits its size, None if none does."""
        per = PER_RIB_STITCH[axis]
        if band.stripe is not None:
            return band.stripe // per if band.stripe % per == 0 else None
        for n in (self.n_stripe, *self._known[::-1]):
            if band.size % (2 * per * n) == 0:
                return n
        return None

    @cached_property
    def problems(self) -> tuple[str, ...]:
        """What the model cannot represent, by course and wale."""
        return (*self._sizes_that_do_not_fit(), *self._odd_stitches())

    def _sizes_that_do_not_fit(self) -> Iterator[str]:
        stripes = {"course": "garter stripes", "wale": "ribs"}
        for axis, bands in (("course", self.rows), ("wale", self.columns)):
            for band in bands:
                where = _span(axis, np.arange(band.start, band.stop))
                n = self._n(axis, band)
                if n is None and band.stripe is None:
                    fitting = ", ".join(str(2 * PER_RIB_STITCH[axis] * n) for n in self._known)
                    problem = f"{where}: a patch of this size, {band.size}, holds no even number of"
                    yield f"{problem} stripes; take a multiple of one of {fitting}"
                elif n is None:
                    problem = f"{where}: garter stripes {band.stripe} courses high"
                    yield f"{problem}; take an even number"
                elif n not in self._known:
                    known = ", ".join(map(str, self._known))
                    problem = f"{where}: {stripes[axis]} of n_stripe {n}, measured are {known}"
                    yield f"{problem}; give a material that has it"

    def _odd_stitches(self) -> Iterator[str]:
        for row, column in np.ndindex(self.letters.shape):
            low, left = self.rows[row].start, self.columns[column].start
            odd = self.odd[low : self.rows[row].stop, left : self.columns[column].stop]
            if not odd.any():
                continue
            courses, wales = (np.flatnonzero(odd.any(axis)) for axis in (1, 0))
            knit = KNIT_OF_LETTER[str(self.letters[row, column])]
            where = f"{_span('course', low + courses)}, {_span('wale', left + wales)}"
            front = self.chart.front[low + courses[0], left + wales[0]]
            what = f"a {'knit' if front else 'purl'}" if odd.sum() == 1 else f"{odd.sum()} stitches"
            verb = "is" if odd.sum() == 1 else "are"
            yield f"{where}: {what} {verb} neither rib nor garter, nor plain; taken as {knit}"

    def pattern(self) -> Pattern:
        """The smallest pattern that repeats; BadInput if a size or a stripe does not fit."""
        if problems := list(self._sizes_that_do_not_fit()):
            raise fault("pattern", "; ".join(problems))
        rows, columns = self.repeat
        letters = tuple("".join(row) for row in self.letters[: len(rows), : len(columns)][::-1])
        lists: dict[str, Any] = {}
        for name, axis, bands in (
            ("row", "course", rows[::-1]),
            ("column", "wale", columns),
        ):
            unit = "courses" if name == "row" else "stitches"
            sizes = tuple(band.size for band in bands)
            stripes = tuple(self._n(axis, band) or 0 for band in bands)
            if set(sizes) != {PER_RIB_STITCH[axis] * self.n_subunit}:
                lists[f"{name}_{unit}"] = sizes
            if set(stripes) != {self.n_stripe}:
                lists[f"{name}_n_stripe"] = stripes
        return Pattern(source=f"read from {self.chart.title}", rows=letters, **lists)

    @property
    def repeat(self) -> tuple[tuple[Band, ...], tuple[Band, ...]]:
        """The rows and the columns of patches that repeat."""
        counts = []
        for bands, letters in ((self.rows, self.letters), (self.columns, self.letters.T)):
            keys = [(b.size, b.stripe, "".join(of)) for b, of in zip(bands, letters, strict=True)]
            counts.append(_shortest_repeat(keys))
        return self.rows[: counts[0]], self.columns[: counts[1]]

    def save_pattern(self, path: str | Path) -> Path:
        """Write the pattern as a file for ``[design] pattern_files``, named as the file.

        Args:
            path: the file, ``.toml``.

        Raises:
            BadInput: if a size or a stripe does not fit, or the file cannot be written.
        """
        path = Path(path)
        if path.suffix != ".toml":
            raise fault(f"output {path}", "has no suffix .toml; give it one")
        table = {pattern_name(path): self.pattern().model_dump(exclude_defaults=True)}
        with atomic_write(path) as temporary:
            temporary.write_text(tomli_w.dumps(table), encoding="utf-8")
        return path

    def _patches_in_words(
        self, rows: tuple[Band, ...], columns: tuple[Band, ...]
    ) -> Iterator[tuple[str, str]]:
        for (i, row), (j, column) in product(enumerate(rows), enumerate(columns)):
            knit, stripe = KNIT_OF_LETTER[self.letters[i, j]], ""
            if knit != "plain":
                width, of = (column.stripe, "wales") if knit == "rib" else (row.stripe, "courses")
                stripe = f", stripes of {width} {of}"
            spans = (
                _span(axis, np.arange(band.start, band.stop))
                for axis, band in (("course", row), ("wale", column))
            )
            yield "patch", f"{', '.join(spans)}: {knit}{stripe}"

    def flat_size(self, gauge: Gauge) -> tuple[float, float]:
        """Width and length in cloth before it folds, by the size of a stitch [mm]."""
        return self.chart.wales * gauge.stitch_width, self.chart.courses * gauge.stitch_height

    def summary(self, gauge: Gauge) -> Iterator[tuple[str, str]]:
        """Names and values of its lines."""
        chart = self.chart
        yield "chart", chart.size
        size = "{} courses and {} wales".format(*chart.repeat)
        yield "repeats", "{} × {} (warp × weft) of {}".format(*chart.repeats, size)
        if self.begins_at != (1, 1):
            yield "begins at", "course {}, wale {} of the file".format(*self.begins_at)
        rows, columns = self.repeat
        if len(rows) * len(columns) <= MOST_PATCHES:
            yield from self._patches_in_words(rows, columns)
        else:
            for row in self.letters[: len(rows), : len(columns)][::-1]:
                yield "patches", "".join(row)
            for name, bands in (("courses", rows), ("wales", columns)):
                sizes = [f"{b.size} in {b.stripe}s" if b.stripe else str(b.size) for b in bands]
                yield name, ", ".join(sizes)
        if "G" in self.letters:
            yield "garter_start", self.garter_start
        yield "n_stripe", str(self.n_stripe)
        yield "n_subunit", str(self.n_subunit)
        width, length = self.flat_size(gauge)
        yield "size flat", f"{width:.0f} × {length:.0f} mm (width × length)"


def pattern_name(path: Path) -> str:
    """Name of the pattern in a file."""
    name = re.sub(r"\W+", "_", path.stem)
    return name if is_pattern_name(name) else f"{name}_chart"


def _span(name: str, numbers: np.ndarray) -> str:
    first, last = numbers[0] + 1, numbers[-1] + 1
    return f"{name} {first}" if first == last else f"{name}s {first} to {last}"


def _shortest_repeat(keys: Sequence[object]) -> int:
    """The least number of bands, that divides all, after which they begin again."""
    count = len(keys)
    return next(
        n
        for n in range(1, count + 1)
        if count % n == 0 and list(keys) == list(keys[:n]) * (count // n)
    )


def patches_of(front: Bool[np.ndarray, "course wale"], title: str) -> ReadChart:
    """The patches of a chart, course 0 first; if its edges do not fit, of one moved over them."""
    best = _best(front, title, [(0, 0)], ODD_STITCHES)
    if best.problems:
        starts = [
            [0, *(np.flatnonzero((of[1:] != of[:-1]).any(axis=1)) + 1)[:MOST_SHIFTS].tolist()]
            for of in (front, front.T)
        ]
        moved = _best(front, title, list(product(*starts)), ODD_STITCHES[:1])
        best = min(best, moved, key=_badness)
    return best


def _badness(read: ReadChart) -> tuple[int, int, int]:
    return int(read.odd.sum()), len(read.problems), read.letters.size


def _best(
    front: Bool[np.ndarray, "course wale"],
    title: str,
    shifts: list[tuple[int, int]],
    tolerances: tuple[int, ...],
) -> ReadChart:
    tried = []
    for tolerance, slender in product(tolerances, SLENDER):
        tried += [
            _read(front, title, start, shift, tolerance, slender)
            for start, shift in product(STARTS, shifts)
        ]
        if not (best := min(tried, key=_badness)).problems:
            break
    return best


def _read(
    front: Bool[np.ndarray, "course wale"],
    title: str,
    garter_start: GarterStart,
    shift: tuple[int, int],
    tolerance: int,
    slender: int,
) -> ReadChart:
    front = np.roll(front, (-shift[0], -shift[1]), (0, 1))
    back_first = garter_start == "mountain"
    rows = bands_of(front[::-1] if back_first else front, "course", tolerance, slender)
    if back_first:
        courses = len(front)
        rows = [Band(courses - b.stop, courses - b.start, b.stripe) for b in rows[::-1]]
    columns = bands_of(front.T, "wale", tolerance, slender)
    if len(rows) * len(columns) > MOST_BANDS**2:
        # No pattern, and slow to describe patch by patch.
        rows, columns = [Band(0, len(front), None)], [Band(0, front.shape[1], None)]
    letters = np.full((len(rows), len(columns)), "P")
    odd = np.zeros(front.shape, bool)
    for (i, row), (j, column) in product(enumerate(rows), enumerate(columns)):
        part = np.s_[row.start : row.stop, column.start : column.stop]
        wrong = {letter: front[part] != knit for letter, knit in _knits(row, column, back_first)}
        letters[i, j] = min(wrong, key=lambda letter: int(wrong[letter].sum()))
        odd[part] = wrong[letters[i, j]]
    chart = StitchChart(
        title,
        front,
        np.zeros(front.shape, int),
        ("front", "front"),
        np.vectorize(KNIT_OF_LETTER.__getitem__)(letters),
        np.array([0, *(band.stop for band in rows)]),
        np.array([0, *(band.stop for band in columns)]),
        (len(front), front.shape[1]),
        periodic=True,
    )
    begins_at = shift[0] + 1, shift[1] + 1
    read = ReadChart(chart, tuple(rows), tuple(columns), letters, garter_start, begins_at, odd)
    height, width = (sum(band.size for band in bands) for bands in read.repeat)
    return replace(read, chart=replace(chart, repeat=(height, width)))


def _knits(row: Band, column: Band, back_first: bool) -> Iterator[tuple[str, np.ndarray]]:
    """The stitches of a patch as every knit that it may be, by letter."""
    shape = row.size, column.size
    yield "P", np.ones(shape, bool)
    if column.stripe is not None:
        yield "R", np.broadcast_to(np.arange(column.size) // column.stripe % 2 == 0, shape)
    if row.stripe is not None:
        first = (np.arange(row.size) // row.stripe % 2 == 0) != back_first
        yield "G", np.broadcast_to(first[:, None], shape)
