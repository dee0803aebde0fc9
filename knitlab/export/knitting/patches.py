"""From any stitch chart to a pattern: its patches, their stripes, and what is neither.

Each axis is cut into bands: a back stripe that repeats after an equal front stripe is a period, and
equal courses without stripes are one band. Each patch is then the rib, garter or plain knit that
leaves the fewest stitches of another kind, and these are named.
"""

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import product
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Int

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
MAX_KINDS = 500  # of lines, up to which almost equal ones are alike
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

    def stitches(self, back_first: bool) -> Bool[np.ndarray, " line"]:
        """Whether each of its lines is knit in a patch of its stripes; plain knit has none."""
        if self.stripe is None:
            return np.ones(self.size, bool)
        return (np.arange(self.size) // self.stripe % 2 == 0) != back_first


@dataclass(frozen=True, eq=False)
class ReadChart:
    """A stitch chart as a pattern."""

    title: str
    front: Bool[np.ndarray, "course wale"]  # its stitches, from the course and wale it begins at
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

    @cached_property
    def chart(self) -> StitchChart:
        """The stitches with their patches."""
        rows, columns = self.repeat
        return StitchChart(
            title=self.title,
            front=self.front,
            plated=np.zeros(self.front.shape, int),
            plated_face=("front", "front"),
            knit=np.vectorize(KNIT_OF_LETTER.__getitem__)(self.letters),
            row_borders=np.array([0, *(band.stop for band in self.rows)]),
            column_borders=np.array([0, *(band.stop for band in self.columns)]),
            repeat=(rows[-1].stop, columns[-1].stop),
            periodic=True,
        )

    @property
    def n_stripe(self) -> int:
        """The most frequent size of its ribs [wales], or half of its garter stripes [courses]."""
        return self._most_frequent("stripe", min(_measured()))

    @property
    def n_subunit(self) -> int:
        """The most frequent width of its patches [wales], or half their height [courses]."""
        return self._most_frequent("size", 0)

    def _most_frequent(self, name: str, default: int) -> int:
        sizes = [(getattr(b, name), b.per_stitch) for b in (*self.rows, *self.columns)]
        counts = Counter(size // per for size, per in sizes if size and size % per == 0)
        return max(counts, key=lambda size: (counts[size], -size), default=default)

    def _n(self, band: Band) -> int | None:
        """n_stripe of a band; without stripes, one that fits its size, None if none does."""
        if band.stripe is not None:
            return None if band.stripe % band.per_stitch else band.stripe // band.per_stitch
        known = (self.n_stripe, *_measured()[::-1])
        return next((n for n in known if band.size % (2 * band.per_stitch * n) == 0), None)

    @cached_property
    def messages(self) -> tuple[str, ...]:
        """What the model cannot represent, by course and wale."""
        return (*self._sizes_that_do_not_fit(), *self._odd_stitches())

    @property
    def problems(self) -> tuple[str, ...]:
        """Deprecated: ``messages``."""
        return self.messages

    @property
    def has_no_pattern(self) -> bool:
        """Whether it is a single patch of plain knit, as a chart of too many bands is read."""
        return self.letters.size == 1 and self.rows[0].stripe is self.columns[0].stripe is None

    def is_better(self, other: "ReadChart") -> bool:
        """Whether fewer stitches are odd, or as many and fewer sizes do not fit."""
        more_odd = int(self.odd.sum()) - int(other.odd.sum())
        if more_odd:
            return more_odd < 0
        own = len(self.messages), self.letters.size
        return own < (len(other.messages), other.letters.size)

    def _sizes_that_do_not_fit(self) -> Iterator[str]:
        stripes = {"course": "garter stripes", "wale": "ribs"}
        for band in (*self.rows, *self.columns):
            where = _span(band.axis, range(band.start, band.stop))
            n = self._n(band)
            if n is None and band.stripe is None:
                fitting = ", ".join(str(2 * band.per_stitch * n) for n in _measured())
                message = f"{where}: a patch of this size, {band.size}, does not hold an even"
                yield f"{message} number of stripes; use a multiple of one of {fitting}"
            elif n is None:
                yield f"{where}: garter stripes are {band.stripe} courses high; use an even number"
            elif n not in _measured():
                known = ", ".join(map(str, _measured()))
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
            front = self.front[low + courses[0], left + wales[0]]
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
        return Pattern(source=f"read from {self.title}", rows=letters, **lists)

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


@cache
def _measured() -> list[int]:
    return defaults().stripes.sizes("rib")


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
    reader = _Reader(front, title)
    best = reader.read(STARTS[0], (0, 0), ODD_STITCHES[0], SLENDER[0])
    for shifts, tolerances in (([(0, 0)], ODD_STITCHES), ([*moved], ODD_STITCHES[:1])):
        for tolerance, slender in product(tolerances, SLENDER):
            for start, shift in product(STARTS, shifts):
                read = reader.read(start, shift, tolerance, slender)
                if read.is_better(best):
                    best = read
            if not best.messages:
                return best
        if best.has_no_pattern:
            return best
    return best


class LineKinds(NamedTuple):
    """Which courses or wales of a chart are alike: their kinds, and a line of each kind."""

    kinds: Int[np.ndarray, " line"]
    examples: Bool[np.ndarray, "kind stitch"]

    def moved(self, along: int, across: int) -> "LineKinds":
        """The same of a chart that begins some lines later, each of them some stitches later."""
        return LineKinds(np.roll(self.kinds, -along), np.roll(self.examples, -across, axis=1))

    def stripe_length(self, first: int, second: int) -> float:
        """Least length of a front stripe of one kind and a back one of another, if it has no other.

        Infinite if the lines differ everywhere, 0 if nowhere.
        """
        differ = self.examples[first] != self.examples[second]
        if not differ.any():
            return 0
        ends = np.flatnonzero(np.diff(differ, prepend=False, append=False))
        return np.inf if differ.all() else float((ends[1::2] - ends[::2]).min())


def line_kinds(lines: Bool[np.ndarray, "line stitch"], tolerance: int) -> LineKinds:
    """Kinds of lines that differ in no more stitches than the tolerance from their first one."""
    packed = np.packbits(lines, axis=1)
    _, firsts, exact = np.unique(packed, axis=0, return_index=True, return_inverse=True)
    if not tolerance or len(firsts) > MAX_KINDS:
        return LineKinds(exact.ravel(), lines[firsts])
    order = np.argsort(firsts)
    kind_of = np.zeros(len(firsts), int)
    chosen = list[int]()  # the first line of each kind
    for number in order:
        line = firsts[number]
        alike = np.flatnonzero((lines[chosen] != lines[line]).sum(axis=1) <= tolerance)
        kind_of[number] = alike[0] if len(alike) else len(chosen)
        if not len(alike):
            chosen.append(line)
    kinds = kind_of[exact.ravel()]
    usual = [lines[kinds == kind].mean(axis=0) >= 0.5 for kind in range(len(chosen))]
    return LineKinds(kinds, np.array(usual))


class _Reader:
    """Reads the patches of a chart, with what readings have in common."""

    def __init__(self, front: Bool[np.ndarray, "course wale"], title: str) -> None:
        self.front = front
        self.title = title
        self.kinds = dict[tuple[str, int], LineKinds]()

    def _kinds(self, lines: str, tolerance: int) -> LineKinds:
        if (lines, tolerance) not in self.kinds:
            front = {"wales": self.front.T, "valley": self.front, "mountain": self.front[::-1]}
            self.kinds[lines, tolerance] = line_kinds(front[lines], tolerance)
        return self.kinds[lines, tolerance]

    def read(
        self, start: GarterStart, shift: tuple[int, int], tolerance: int, slender: int
    ) -> ReadChart:
        """The chart moved by courses and wales, with garter patches that start in one way."""
        up, right = shift
        front = np.roll(self.front, (-up, -right), (0, 1))
        # Garter that starts with a back stripe begins with a front one at its other end.
        back_first = start == "mountain"
        courses = self._kinds(start, tolerance).moved(-up if back_first else up, right)
        rows = find_bands(courses, "course", slender)
        if back_first:
            last = len(front)
            rows = [b._replace(start=last - b.stop, stop=last - b.start) for b in rows[::-1]]
        columns = find_bands(self._kinds("wales", tolerance).moved(right, up), "wale", slender)
        if len(rows) * len(columns) > MAX_BANDS**2:
            # No pattern, and slow to describe patch by patch.
            rows = [Band("course", 0, len(front), None)]
            columns = [Band("wale", 0, front.shape[1], None)]
        garter = np.concatenate([band.stitches(back_first) for band in rows])[:, None]
        rib = np.concatenate([band.stitches(False) for band in columns])
        knits = {"P": np.array(True), "R": rib, "G": garter}
        starts = [[band.start for band in of] for of in (rows, columns)]
        counts = [
            np.add.reduceat(np.add.reduceat(front != knit, starts[1], 1, int), starts[0], 0)
            for knit in knits.values()
        ]
        best = np.argmin(counts, axis=0)
        sizes = [[band.size for band in of] for of in (rows, columns)]
        of_stitch = np.repeat(np.repeat(best, sizes[0], axis=0), sizes[1], axis=1)
        odd = front != np.choose(of_stitch, [*knits.values()])
        letters = np.array([*knits])[best]
        begins_at = up + 1, right + 1
        return ReadChart(self.title, front, (*rows,), (*columns,), letters, start, begins_at, odd)


def find_bands(lines: LineKinds, axis: Axis, slender: int) -> list[Band]:
    """Courses in rows of patches, or wales in columns, whose stripes begin on the front bed.

    A stripe is longer than it is wide by a factor ``slender``.
    """
    borders = np.flatnonzero(np.diff(lines.kinds)) + 1
    kinds = lines.kinds[[0, *borders]].tolist()
    sizes = np.diff([0, *borders, len(lines.kinds)]).tolist()
    # Runs of lines that are alike, by their kind and number of lines.
    runs = [*zip(kinds, sizes, strict=True)]
    of_runs = lines.examples[kinds]
    has_others = [*(of_runs[1:] & ~of_runs[:-1]).any(axis=1).tolist(), True]
    length = cache(lines.stripe_length)
    # 2 courses are a wale high.
    scale = GARTER_STITCHES_PER_RIB_STITCH ** (1 if axis == "course" else -1)
    bands = list[Band]()
    k = 0
    start = 0
    while k < len(runs):
        (kind, first) = runs[k]
        (other, size) = (*runs[k + 1 : k + 2], (kind, 0))[0]
        if size > first or has_others[k] or slender * size > scale * length(kind, other):
            size = 0
        k += 1
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
