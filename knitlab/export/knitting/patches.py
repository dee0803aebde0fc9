"""From any stitch chart to a pattern: its patches, their stripes, and what is neither.

Each axis is cut into bands: a back stripe that repeats after an equal front stripe is a period, and
equal courses without stripes are one band. Each patch is then the rib, garter or plain knit that
leaves the fewest stitches of another kind, and these are named.
"""

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby, product
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from jaxtyping import Bool

from knitlab.export.knitting.chart import StitchChart
from knitlab.io.errors import invalid
from knitlab.io.names import check_suffix
from knitlab.io.toml import TOML, write_toml
from knitlab.model.pattern import KNIT_OF_LETTER
from knitlab.model.settings import GarterStart
from knitlab.model.stitches import Gauge
from knitlab.model.stripe import GARTER_STITCHES_PER_RIB_STITCH
from knitlab.runs.parameters import defaults
from knitlab.runs.patterns import Pattern, is_pattern_name

ODD_STITCHES = (0, 1, 2)  # in which courses or wales may differ and still count as alike
SLENDER = (2, 1)  # lengths of a stripe over its width, at least, that are tried
MAX_SHIFTS = 8  # along each axis, if a chart does not begin with a patch
MAX_BANDS = 48  # along each axis, of a chart that has a pattern
MAX_PATCHES = 12  # that are described one by one
STARTS: tuple[GarterStart, GarterStart] = "valley", "mountain"
Axis = Literal["course", "wale"]


class Band(NamedTuple):
    """A row or a column of patches: from a course or wale to the next band's."""

    axis: Axis
    start: int
    stop: int
    stripe: int | None  # courses of its garter stripes or wales of its ribs, None without stripes

    @property
    def size(self) -> int:
        """Number of courses or wales."""
        return self.stop - self.start

    @property
    def per_stitch(self) -> int:
        """Courses or wales that are as long as a stitch is wide."""
        return 1 if self.axis == "wale" else GARTER_STITCHES_PER_RIB_STITCH


@dataclass(frozen=True, eq=False)
class ReadChart:
    """A stitch chart as a pattern."""

    chart: StitchChart  # the stitches, with their patches
    rows: tuple[Band, ...]  # of patches in courses, the lowest first
    columns: tuple[Band, ...]  # of patches in wales
    letters: np.ndarray  # knit of every patch: R, G or P, the lowest row first
    garter_start: GarterStart  # the stripe that a garter patch begins with, as the model option
    # Course and wale of the file, from 1, that the chart begins at; not (1, 1) if its pattern only
    # fits when it is moved over the edge.
    begins_at: tuple[int, int]
    odd: Bool[np.ndarray, "course wale"]  # stitches that no patch has

    def __repr__(self) -> str:
        return f"<ReadChart {self.chart.size}, {len(self.messages)} messages>"

    @property
    def n_stripe(self) -> int:
        """The most frequent size of its ribs [wales], or half of its garter stripes [courses]."""
        return self._most_frequent("stripe", min(self._known))

    @property
    def n_subunit(self) -> int:
        """The most frequent width of its patches [wales], or half their height [courses]."""
        return self._most_frequent("size", 0)

    def _most_frequent(self, name: str, default: int) -> int:
        sizes = [(getattr(b, name), b.per_stitch) for b in (*self.rows, *self.columns)]
        counts = Counter(size // per for size, per in sizes if size and size % per == 0)
        return max(counts, key=lambda size: (counts[size], -size), default=default)

    @cached_property
    def _known(self) -> list[int]:
        return defaults().stripes.sizes("rib")

    def _n(self, band: Band) -> int | None:
        """n_stripe of a band; without stripes, one that fits its size, None if none does."""
        if band.stripe is not None:
            return None if band.stripe % band.per_stitch else band.stripe // band.per_stitch
        known = (self.n_stripe, *self._known[::-1])
        return next((n for n in known if band.size % (2 * band.per_stitch * n) == 0), None)

    @cached_property
    def messages(self) -> tuple[str, ...]:
        """What the model cannot represent, by course and wale."""
        return (*self._sizes_that_do_not_fit(), *self._odd_stitches())

    @property
    def problems(self) -> tuple[str, ...]:
        """Deprecated: ``messages``."""
        return self.messages

    def _sizes_that_do_not_fit(self) -> Iterator[str]:
        stripes = {"course": "garter stripes", "wale": "ribs"}
        for band in (*self.rows, *self.columns):
            where = _span(band.axis, range(band.start, band.stop))
            n = self._n(band)
            if n is None and band.stripe is None:
                fitting = ", ".join(str(2 * band.per_stitch * n) for n in self._known)
                message = f"{where}: a patch of this size, {band.size}, does not hold an even"
                yield f"{message} number of stripes; use a multiple of one of {fitting}"
            elif n is None:
                yield f"{where}: garter stripes are {band.stripe} courses high; use an even number"
            elif n not in self._known:
                known = ", ".join(map(str, self._known))
                message = f"{where}: {stripes[band.axis]} have n_stripe {n}; measured: {known}"
                yield f"{message}; give a material that has it"

    def _odd_stitches(self) -> Iterator[str]:
        for row, column in np.ndindex(self.letters.shape):
            low = self.rows[row].start
            left = self.columns[column].start
            odd = self.odd[low : self.rows[row].stop, left : self.columns[column].stop]
            if not odd.any():
                continue
            courses, wales = (np.flatnonzero(odd.any(axis)) for axis in (1, 0))
            knit = KNIT_OF_LETTER[str(self.letters[row, column])]
            where = f"{_span('course', low + courses)}, {_span('wale', left + wales)}"
            front = self.chart.front[low + courses[0], left + wales[0]]
            single = f"a {'knit' if front else 'purl'} is"
            what = single if odd.sum() == 1 else f"{odd.sum()} stitches are"
            yield f"{where}: {what} neither rib nor garter, nor plain; taken as {knit}"

    def pattern(self) -> Pattern:
        """The smallest pattern that repeats; InputError if a size or a stripe does not fit."""
        if messages := list(self._sizes_that_do_not_fit()):
            raise invalid("pattern", "; ".join(messages))
        rows, columns = self.repeat
        letters = tuple("".join(row) for row in self.letters[: len(rows), : len(columns)][::-1])
        lists: dict[str, Any] = {}
        for name, unit, bands in (("row", "courses", rows[::-1]), ("column", "stitches", columns)):
            sizes = tuple(band.size for band in bands)
            stripes = tuple(self._n(band) or 0 for band in bands)
            if set(sizes) != {bands[0].per_stitch * self.n_subunit}:
                lists[f"{name}_{unit}"] = sizes
            if set(stripes) != {self.n_stripe}:
                lists[f"{name}_n_stripe"] = stripes
        return Pattern(source=f"read from {self.chart.title}", rows=letters, **lists)

    @property
    def repeat(self) -> tuple[tuple[Band, ...], tuple[Band, ...]]:
        """The rows and the columns of patches that repeat."""
        return _repeating(self.rows, self.letters), _repeating(self.columns, self.letters.T)

    def save_pattern(self, path: str | Path) -> Path:
        """Write the pattern as a ``.toml`` file for ``[design] pattern_files``, with its name."""
        path = Path(path)
        check_suffix(path, TOML, "a pattern")
        write_toml(path, {pattern_name(path): self.pattern().model_dump(exclude_defaults=True)})
        return path

    def summary(self, gauge: Gauge) -> Iterator[tuple[str, str]]:
        """Names and values of its lines."""
        chart = self.chart
        yield "chart", chart.size
        yield "repeats", chart.repeats_in_words
        if self.begins_at != (1, 1):
            yield "begins at", "course {}, wale {} of the file".format(*self.begins_at)
        rows, columns = self.repeat
        if len(rows) * len(columns) <= MAX_PATCHES:
            for (i, row), (j, column) in product(enumerate(rows), enumerate(columns)):
                knit = KNIT_OF_LETTER[self.letters[i, j]]
                across = {"rib": column, "garter": row}.get(knit)
                stripe = f", stripes of {across.stripe} {across.axis}s" if across else ""
                spans = (_span(band.axis, range(band.start, band.stop)) for band in (row, column))
                yield "patch", f"{', '.join(spans)}: {knit}{stripe}"
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
        width, length = chart.flat_size(gauge)
        yield "size flat", f"{width:.0f} × {length:.0f} mm (width × length)"


def pattern_name(path: Path) -> str:
    """Name of the pattern in a file."""
    name = re.sub(r"\W+", "_", path.stem)
    return name if is_pattern_name(name) else f"{name}_chart"


def _span(name: str, numbers: np.ndarray | range) -> str:
    first = numbers[0] + 1
    last = numbers[-1] + 1
    return f"{name} {first}" if first == last else f"{name}s {first} to {last}"


def _repeating(bands: tuple[Band, ...], letters: np.ndarray) -> tuple[Band, ...]:
    """The first bands, in a number that divides that of all, after which they begin again."""
    keys = [(b.size, b.stripe, "".join(of)) for b, of in zip(bands, letters, strict=True)]
    numbers = (n for n in range(1, len(keys) + 1) if len(keys) % n == 0)
    return bands[: next(n for n in numbers if keys == keys[:n] * (len(keys) // n))]


def read_patches(front: Bool[np.ndarray, "course wale"], title: str) -> ReadChart:
    """The patches of a chart, course 0 first; if its edges do not fit, of one moved over them."""
    changes = (np.flatnonzero((of[1:] != of[:-1]).any(axis=1)) + 1 for of in (front, front.T))
    moved = product(*([0, *numbers[:MAX_SHIFTS].tolist()] for numbers in changes))
    tried = list[ReadChart]()
    for shifts, tolerances in (([(0, 0)], ODD_STITCHES), ([*moved], ODD_STITCHES[:1])):
        for tolerance, slender in product(tolerances, SLENDER):
            tried += [
                _read(front, title, start, shift, tolerance, slender)
                for start, shift in product(STARTS, shifts)
            ]
            best = min(tried, key=lambda r: (r.odd.sum(), len(r.messages), r.letters.size))
            if not best.messages:
                return best
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
    rows = find_bands(front[::-1] if back_first else front, "course", tolerance, slender)
    if back_first:
        courses = len(front)
        rows = [b._replace(start=courses - b.stop, stop=courses - b.start) for b in rows[::-1]]
    columns = find_bands(front.T, "wale", tolerance, slender)
    if len(rows) * len(columns) > MAX_BANDS**2:
        # No pattern, and slow to describe patch by patch.
        rows = [Band("course", 0, len(front), None)]
        columns = [Band("wale", 0, front.shape[1], None)]
    letters = np.full((len(rows), len(columns)), "P")
    odd = np.zeros(front.shape, bool)
    for (i, row), (j, column) in product(enumerate(rows), enumerate(columns)):
        patch = np.s_[row.start : row.stop, column.start : column.stop]
        wrong = {letter: front[patch] != knit for letter, knit in _knits(row, column, back_first)}
        letters[i, j] = min(wrong, key=lambda letter: int(wrong[letter].sum()))
        odd[patch] = wrong[letters[i, j]]
    repeat = _repeating((*rows,), letters), _repeating((*columns,), letters.T)
    knit = np.vectorize(KNIT_OF_LETTER.__getitem__)(letters)
    borders = np.array([0, *(b.stop for b in rows)]), np.array([0, *(b.stop for b in columns)])
    size = repeat[0][-1].stop, repeat[1][-1].stop
    none = np.zeros(front.shape, int)
    chart = StitchChart(title, front, none, ("front", "front"), knit, *borders, size, True)
    begins_at = shift[0] + 1, shift[1] + 1
    return ReadChart(chart, (*rows,), (*columns,), letters, garter_start, begins_at, odd)


def _knits(row: Band, column: Band, back_first: bool) -> Iterator[tuple[str, np.ndarray]]:
    shape = row.size, column.size
    yield "P", np.ones(shape, bool)
    if column.stripe is not None:
        yield "R", np.broadcast_to(np.arange(column.size) // column.stripe % 2 == 0, shape)
    if row.stripe is not None:
        first = (np.arange(row.size) // row.stripe % 2 == 0) != back_first
        yield "G", np.broadcast_to(first[:, None], shape)


def find_bands(
    lines: Bool[np.ndarray, "line stitch"], axis: Axis, tolerance: int, slender: int
) -> list[Band]:
    """Courses in rows of patches, or wales in columns, whose stripes begin on the front bed."""
    kinds, examples = _kinds(lines, tolerance)
    # Runs of lines that are alike, by their kind and number of lines.
    runs = [(kind, len(list(of))) for kind, of in groupby(kinds)]
    bands = list[Band]()
    k = 0
    start = 0
    while k < len(runs):
        (kind, first) = runs[k]
        (other, size) = (*runs, (-1, 0))[k + 1]
        k += 1
        if size > first or not _are_stripes(examples, kind, other, axis, slender * size):
            size = 0
        if first > size:
            bands.append(Band(axis, start, start + first - size, None))
        start += first
        if size:
            stop = start + size
            k = k + 1
            while runs[k : k + 2] == [(kind, size), (other, size)]:
                stop = stop + 2 * size
                k = k + 2
            bands.append(Band(axis, start - size, stop, size))
            start = stop
    return bands


def _kinds(
    lines: Bool[np.ndarray, "line stitch"], tolerance: int
) -> tuple[list[int], list[Bool[np.ndarray, " stitch"]]]:
    if not tolerance:
        _, firsts, exact = np.unique(lines, axis=0, return_index=True, return_inverse=True)
        return exact.ravel().tolist(), list(lines[firsts])
    examples = list[np.ndarray]()
    kinds = []
    for line in lines:
        alike = (k for k, each in enumerate(examples) if (each != line).sum() <= tolerance)
        kind = next(alike, len(examples))
        if kind == len(examples):
            examples.append(line)
        kinds.append(kind)
    usual = [np.mean(lines[np.array(kinds) == k], axis=0) >= 0.5 for k in range(len(examples))]
    return kinds, usual


def _are_stripes(
    examples: list[Bool[np.ndarray, " stitch"]], first: int, second: int, axis: Axis, least: int
) -> bool:
    """Whether two kinds of lines are front and back stripes, as long as some lines are high."""
    if second < 0 or (examples[second] & ~examples[first]).any():
        return False
    differ = examples[first] & ~examples[second]
    lengths = [len(list(of)) for changes, of in groupby(differ.tolist()) if changes]
    # 2 courses are a wale high.
    scale = GARTER_STITCHES_PER_RIB_STITCH ** (1 if axis == "course" else -1)
    return bool(differ.all()) or least <= scale * min(lengths, default=0)
