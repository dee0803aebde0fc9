"""Named patterns: their schema, and the stripes and sizes of a design that follow from them."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import Field, RootModel, model_validator

from knitlab.io.errors import invalid, naming
from knitlab.io.image_file import read_image
from knitlab.io.limits import MAX_TEXT
from knitlab.io.names import Name
from knitlab.io.text_file import read_text
from knitlab.io.toml import StrictModel
from knitlab.model.pattern import KNIT_OF_LETTER, BadPattern, Grading, SingleFold, map_letters
from knitlab.model.stripe import GARTER_STITCHES_PER_RIB_STITCH, Knit, Stripe
from knitlab.runs.declared_fields import Count, with_defaults, with_fields

StripeOf = Callable[[Knit, int], Stripe]
Counts = Annotated[tuple[Count, ...], Field(strict=False, min_length=1)]
Letter = Literal["R", "G", "P"]
SIZES_OF_LINES = (("column_stitches", "column_periods"), ("row_courses", "row_periods"))
"""Keys that give each column or row its own size, in stitches or in periods."""


@with_fields(with_defaults(SingleFold))
class FoldEntry(StrictModel):
    """A :class:`~knitlab.model.pattern.SingleFold`."""


class PatternTable(StrictModel):
    """A pattern in a file; see :class:`Pattern`."""

    source: str = Field(default="own pattern", min_length=1)
    rows: Annotated[tuple[str, ...], Field(strict=False, min_length=1)] | None = None
    map: str | None = None
    image: str | None = None
    colours: dict[str, Letter] = Field(default_factory=dict)
    column_stitches: Counts | None = None
    row_courses: Counts | None = None
    column_periods: Counts | None = None
    row_periods: Counts | None = None
    column_n_stripe: Counts | None = None
    row_n_stripe: Counts | None = None
    cell: Annotated[tuple[Count, Count] | None, Field(strict=False)] = None
    folds: Annotated[tuple[FoldEntry, ...], Field(strict=False)] = ()

    @model_validator(mode="after")
    def _says_each_once(self) -> "PatternTable":
        given = [name for name in ("rows", "map", "image") if getattr(self, name) is not None]
        if len(given) != 1:
            patches = f"has {' and '.join(given)}" if given else "has no patches"
            raise ValueError(f"{patches}; give one of rows, map and image")
        if (self.image is None) != (not self.colours):
            raise ValueError("an image needs colours, and colours an image; give both or none")
        for one, other in SIZES_OF_LINES:
            if getattr(self, one) is not None and getattr(self, other) is not None:
                raise ValueError(f"has both {one} and {other}; give one of them")
        if self.rows is not None:
            map_letters(self.rows)
        return self

    def files(self, folder: Path) -> list[Path]:
        """Files that the pattern reads, relative to a folder."""
        return [folder / name for name in (self.map, self.image) if name is not None]

    def patches(self, folder: Path) -> tuple[str, ...]:
        """The rows of letters, top course first; InputError if its file cannot be used."""
        if self.rows is not None:
            return tuple(row.upper() for row in self.rows)
        path = self.files(folder)[0]
        try:
            if self.map is not None:
                lines = read_text(path, MAX_TEXT).splitlines()
                rows = tuple(line.strip().upper() for line in lines if line.strip())
            else:
                rows = _letters_of_image(path, self.colours)
            map_letters(rows)
        except BadPattern as error:
            raise invalid(str(path), str(error)) from error
        return rows

    def grading(
        self, rows: Sequence[str], n_stripe: int, n_subunit: int, stripe: StripeOf
    ) -> Grading | None:
        """Sizes and stripes of rows and columns, None if all are alike; BadPattern has mistakes."""
        names = ("column_n_stripe", "row_n_stripe", *SIZES_OF_LINES[0], *SIZES_OF_LINES[1])
        if all(getattr(self, name) is None for name in names):
            return None
        messages: list[str] = []
        made = []
        for lines, number_of_lines in ((COLUMNS, len(rows[0])), (ROWS, len(rows))):
            sizes = self._sizes(lines, number_of_lines, n_stripe, n_subunit, messages)
            periods, stripes = [], []
            for number, (n, size) in enumerate(sizes, 1):
                line, period = f"{lines.title} {number}", 2 * lines.stitches * n
                count, rest = divmod(size, period)
                if rest or not count:
                    near = sorted({max(1, count) * period, (count + 1) * period})
                    are = f"{size} {lines.unit} are {2 * size / period:g} stripes of n_stripe {n}"
                    hint = f"take {' or '.join(map(str, near))}"
                    messages.append(f"{line}: {are}, not an even number; {hint}")
                periods.append(max(1, count))
                try:
                    stripes.append(stripe(lines.knit, lines.stitches * n))
                except KeyError:
                    missing = f"no {lines.knit} stripe of {lines.stitches * n} {lines.unit}"
                    hint = "choose another n_stripe, or give a material that has it"
                    messages.append(f"{line}: there is {missing}; {hint}")
            made.append((tuple(periods), tuple(stripes)))
        if messages:
            raise BadPattern(messages)
        (column_periods, rib), (row_periods, garter) = made
        return Grading(row_periods, column_periods, garter, rib)

    def _sizes(
        self, lines: "_Lines", count: int, n_stripe: int, n_subunit: int, messages: list[str]
    ) -> list[tuple[int, int]]:
        """The n_stripe of every line, and its size in stitches or courses."""

        def given(key: str, default: int) -> Sequence[int]:
            values: Sequence[int] | None = getattr(self, f"{lines.name}_{key}")
            if values is not None and len(values) != count:
                message = f"{lines.name}_{key} gives {len(values)} values, but the pattern has"
                messages.append(f"{message} {count} {lines.name}s; give one for each")
                values = None
            return values or (default,) * count

        n = given("n_stripe", n_stripe)
        if getattr(self, f"{lines.name}_periods") is None:
            return list(zip(n, given(lines.unit, lines.stitches * n_subunit), strict=True))
        periods = given("periods", 1)
        return [(one, 2 * lines.stitches * one * p) for one, p in zip(n, periods, strict=True)]

    def stitches(self, rows: Sequence[str], n_stripe: int, n_subunit: int) -> tuple[int, int]:
        """Courses and wales of the whole pattern, of given rows of letters and one design."""
        courses, wales = (
            sum(size for _, size in self._sizes(lines, count, n_stripe, n_subunit, []))
            for lines, count in ((ROWS, len(rows)), (COLUMNS, len(rows[0])))
        )
        return courses, wales


class Pattern(PatternTable):
    """Repeated patches, with sizes and stripes that do not follow from n_stripe and n_subunit.

    Patches are given as ``rows`` of letters, top course first, as a text file ``map`` of such rows,
    or as an ``image`` with a pixel for each patch and the letter of each of its ``colours``. Lists
    of rows begin at the top, lists of columns at the left. Unless the pattern gives
    other values, a patch is n_subunit stitches wide and 2 n_subunit courses high, with ribs of
    n_stripe stitches and garter stripes of 2 n_stripe courses.

    Attributes:
        source: what it is and where it comes from.
        rows: letters of the patches: R for rib, G for garter, P for plain knit.
        map: path of a text file of such rows, relative to the pattern's file.
        image: path of an image, relative to the pattern's file.
        colours: letter of each colour of the image, by its name such as ``#ff0000``.
        column_stitches: width of each column of patches [stitches].
        row_courses: height of each row of patches [courses].
        column_periods: the same width in periods of the column's rib.
        row_periods: the same height in periods of the row's garter stripe.
        column_n_stripe: n_stripe of the rib of each column.
        row_n_stripe: n_stripe of the garter stripe of each row, which has 2 n_stripe courses.
        cell: patches of a unit cell along (y, x), between whose corners strains are measured; the
            whole pattern by default.
        folds: single folds, each a table with the keys of
            :class:`~knitlab.model.pattern.SingleFold`.

    Raises:
        InputError: with every field that is wrong.

    Example:
        >>> import knitlab as kl
        >>> border = kl.Pattern(rows=("PPP", "PRP", "PPP"), column_stitches=(8, 16, 8))
        >>> border.stitches(border.rows, n_stripe=4, n_subunit=16)
        (96, 32)
    """

    if not TYPE_CHECKING:  # which knows the arguments from the fields

        def __init__(self, **values: Any) -> None:
            with naming("Pattern"):
                super().__init__(**values)


class _Lines(NamedTuple):
    """The rows or the columns of a pattern; a rib stitch counts as ``stitches`` of theirs."""

    name: str
    title: str
    unit: str
    knit: Knit
    stitches: int


COLUMNS = _Lines("column", "column", "stitches", "rib", 1)
ROWS = _Lines("row", "row, from the top,", "courses", "garter", GARTER_STITCHES_PER_RIB_STITCH)


def _letters_of_image(path: Path, colours: Mapping[str, str]) -> tuple[str, ...]:
    from matplotlib.colors import to_hex  # slow to import, and only used for images

    pixels = read_image(path)
    try:
        letters = {to_hex(colour): letter for colour, letter in colours.items()}
    except ValueError as error:
        raise invalid(str(path), f"{error}; name colours such as #ff0000") from error
    # Each pixel as one number, as images have few colours.
    numbers = np.ascontiguousarray(pixels).view(np.uint32)[..., 0]
    drawn = np.full(numbers.shape, "", dtype="<U1")
    for number in np.unique(numbers):
        is_colour = numbers == number
        y, x = np.unravel_index(is_colour.argmax(), numbers.shape)
        red, green, blue, opacity = pixels[y, x] / 255
        name = "transparent" if opacity < 1 else to_hex((red, green, blue))
        if name not in letters:
            message = f"pixel {x + 1} of line {y + 1} is {name}, which colours gives no letter"
            raise invalid(str(path), f"{message}; it has {', '.join(letters)}")
        drawn[is_colour] = letters[name]
    return tuple(map("".join, drawn.tolist()))


def is_pattern_name(text: str) -> bool:
    """Whether text names a pattern, and is not a row of patches."""
    return bool(set(text.upper()) - set(KNIT_OF_LETTER))


class PatternFile(RootModel[dict[Name, PatternTable]]):
    """``patterns.toml``: patterns by name."""

    @model_validator(mode="after")
    def _names_are_no_rows(self) -> "PatternFile":
        for name in self.root:
            if not is_pattern_name(name):
                raise ValueError(f"{name!r} reads as a row of patches; choose another name")
        return self
