"""Records of a testing machine on a pure fabric: repeats, cycles and noise become curves."""

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from knitlab.io.errors import Mistake, invalid, raise_if_any
from knitlab.io.table_file import (
    Table,
    column_numbers,
    name_and_unit,
    places,
    read_tables,
    several,
    unit_factor,
)
from knitlab.io.table_readings import Choice, Decimal
from knitlab.lab.readings import curves_without_bad_readings
from knitlab.lab.record_start import Zero, loading_start, start_correction
from knitlab.lab.records import Record, cycles, resampled

EXAMPLE = "write it as in 'strain [1],force [N]' or 'repeat [1],extension [mm],force [N]'"
NAMES = {
    "strain": (
        *("strain", "axial strain", "tensile strain", "nominal strain", "elongation"),
        *("dehnung", "zugdehnung", "nominelle dehnung", "technische dehnung"),
    ),
    "extension": (
        *("extension", "tensile extension", "elongation", "displacement", "axial displacement"),
        *("crosshead", "crosshead travel", "crosshead displacement", "travel", "position"),
        *("standard travel", "travel standard", "standardweg", "weg", "traversenweg"),
        *("weg traverse", "verlängerung", "längenänderung"),
    ),
    "force": (
        *("force", "load", "axial force", "tensile force", "standard force", "force standard"),
        *("kraft", "standardkraft", "zugkraft", "prüfkraft", "last"),
    ),
    "stress": (
        *("stress", "tensile stress", "nominal stress"),
        *("spannung", "zugspannung", "standardspannung"),
    ),
    "repeat": (
        *("repeat", "specimen", "sample", "test", "specimen number"),
        *("wiederholung", "probe", "prüfling", "versuch", "probennummer"),
    ),
}
"""Names of columns, in lower case; others, such as time and cycle, are not read."""
ALONG = ("strain", "extension")
LOADS = ("force", "stress")
OF_ONE_SWATCH = ("repeat", "wiederholung")  # several repeats of one swatch, not several swatches
TARGETS = {
    "strain": ("1", "such as [1] or [%], or name it extension if it is one"),
    "extension": ("mm", "of length, such as [mm], or name it strain if it is one"),
    "force": ("N", "of force, such as [N]"),
    "stress": ("N/mm^2", "of force over area, such as [MPa]"),
    "stress over width": (
        "N/mm",
        "of force over width, such as [N/mm], or give the thickness in mm for [MPa]",
    ),
}
"""Units to which columns are converted, and the hint for others."""
MIN_POINTS = 4  # one more than the parameters of a stripe, so that errors can be estimated
MIN_TURN = 0.1  # smallest reversal that ends a loading branch, over the range of strain
CURVE_POINTS = 40  # of the curve of several repeats, or of a record that is noisy or turns
SLACK = 0.02  # strain below zero that a record may start with, where its camera begins

Points = Float[np.ndarray, " point"]


@dataclass(frozen=True)
class TensionRecord:
    """Loading of a pure fabric: one curve for each repeat, at common strains.

    Attributes:
        strain: of the relaxed length, ascending [1].
        force: of each repeat, on one row of the network [N] or over the width [N/mm].
        per_width: whether forces are over the width.
        summary: what was read, and what was left out.
        source: what messages call it.
    """

    strain: Points
    force: Float[np.ndarray, "repeat point"]
    per_width: bool = False
    summary: tuple[str, ...] = ()
    source: str = "curve"

    @property
    def mean_force(self) -> Points:
        """The mean of all repeats."""
        return self.force.mean(axis=0)


@dataclass(frozen=True)
class Passage:
    """Records of one loading or unloading, in order; strains are of the relaxed fabric [1]."""

    strain: Points
    force: Points
    loading: bool


@dataclass(frozen=True)
class LoadingCycles:
    """Passages of one swatch in their order, the first of the relaxed fabric."""

    passages: tuple[Passage, ...]
    per_width: bool = False  # whether forces are over the width [N/mm], not on one row [N]
    summary: tuple[str, ...] = ()  # what was subtracted, and how strains were moved


def read_tension_record(
    path: str | Path,
    *,
    gauge_length: float | None = None,
    width: float | None = None,
    thickness: float | None = None,
    cycle: int = 1,
    zero: Zero | None = None,
    preload: float | None = None,
    decimal: Decimal | None = None,
    table: int | None = None,
) -> TensionRecord:
    """Read what a testing machine writes: strain or extension, and force or stress, in any unit.

    A column ``repeat`` separates several specimens; tables of the same columns below each other are
    read as repeats. Of each, the loading branch of one cycle is taken, and negative strains are
    left out. Records that are repeated, or not ascending, are
    resampled at evenly spaced strains that all repeats reach.

    Args:
        path: the record, a table whose header has the units.
        gauge_length: relaxed length between the clamps, for a column of extension [mm].
        width: of the swatch [mm]; without it, force is that on one row of the network.
        thickness: of the fabric, for stress over the cross-section [mm]. In a file with force and
            stress, width or thickness says which is read.
        cycle: the cycle whose loading is taken.
        zero: what is subtracted from the force: ``"none"``, nothing; ``"start"``, the force of each
            repeat at zero strain, less the preload; or a number [N].
        preload: tension at which the record began [N]; strains are then counted from the relaxed
            length, which follows from the curve.
        decimal: the decimal mark of the file, ``"."`` or ``","``, if its numbers do not show it.
        table: which table is read, from 1, of a file with several.

    Returns:
        The curve of each repeat; its summary says what was subtracted and how strains were moved.

    Raises:
        InputError: with every mistake of the file; and if the force at zero strain is above the
            noise but neither ``zero`` nor ``preload`` is given, or contradicts the preload.

    Example:
        >>> record = kl.read_tension_record("docs/examples/swatches/records/rib.csv", width=95.5)
        >>> record.force.shape
        (5, 40)
    """
    lengths = {"extension": gauge_length, "force": width, "stress": thickness}
    records = _read(Path(path), lengths, zero, preload, Choice(decimal, table))
    branches, left_out, n_cycles = [], 0, 0
    for repeat, (strain, force) in records.repeats.items():
        column = f"{path}: column strain" + (f", repeat {repeat}" if repeat != "1" else "")
        loading, n_cycles = _loading(strain, cycle, column)
        below = loading & (strain < 0)
        taken = loading & ~below
        if strain[loading].min() < -max(SLACK, SLACK * strain[loading].max()):
            least = strain[loading].min()
            raise invalid(column, f"goes down to {least:g}; give tension alone, from 0 up")
        if (points := len(np.unique(strain[taken]))) < MIN_POINTS:
            message = f"has {points} points; three parameters need at least {MIN_POINTS}"
            raise invalid(column, message)
        branches.append((strain[taken], force[taken]))
        left_out += int(below.sum())
    count = sum(len(strain) for strain, _ in records.repeats.values())
    turned = sum(len(strain) for strain, _ in branches) < count - left_out
    of_cycles = f" of {n_cycles}" if n_cycles > 1 else ""
    lines = [f"{count} records of {len(branches)} repeats, loading of cycle {cycle}{of_cycles}"]
    if left_out:
        lines.append(f"{left_out} records at negative strain are left out")
    lines += records.summary
    if len(branches) == 1 and not turned and not np.any(np.diff(branches[0][0]) < 0):
        ((at, force),) = branches
        return TensionRecord(at, force[None], records.per_width, tuple(lines), str(path))
    start = max(float(strain.min()) for strain, _ in branches)
    end = min(float(strain.max()) for strain, _ in branches)
    at = _middles(start, end, CURVE_POINTS)
    curves = np.array([resampled(at, *branch).values for branch in branches])
    for curve in curves:  # where a repeat has no readings, between those that it has
        read = np.isfinite(curve)
        curve[:] = np.interp(at, at[read], curve[read], left=np.nan, right=np.nan)
    known = np.isfinite(curves).all(axis=0)
    lines.append(f"{known.sum()} points, up to strain {at[known].max():.3g}, of every repeat")
    return TensionRecord(at[known], curves[:, known], records.per_width, tuple(lines), str(path))


def read_cycles(
    path: str | Path,
    *,
    gauge_length: float | None = None,
    width: float | None = None,
    thickness: float | None = None,
    zero: Zero | None = None,
    preload: float | None = None,
    decimal: Decimal | None = None,
    table: int | None = None,
) -> LoadingCycles:
    """Read every loading and unloading of one swatch, its repeats one after another.

    The arguments are those of :func:`read_tension_record`. Each passage is resampled at evenly
    spaced strains; records at negative strain are left out. Offset and preload are those of the
    first loading. InputError has every mistake of the file. A column of several swatches, such as
    ``specimen``, is refused.
    """
    lengths = {"extension": gauge_length, "force": width, "stress": thickness}
    choice = Choice(decimal, table)
    records = _read(Path(path), lengths, zero, preload, choice, one_swatch=True)
    passages = list[Passage]()
    for strain, force in records.repeats.values():
        at, pulled = strain[strain >= 0], force[strain >= 0]
        number = np.arange(len(at), dtype=float)
        for cycle in cycles(number, at, MIN_TURN):
            for loading, taken in ((True, cycle.loaded(number)), (False, cycle.unloaded(number))):
                if len(np.unique(at[taken])) < MIN_POINTS:
                    continue
                even = _middles(at[taken].min(), at[taken].max(), CURVE_POINTS // 2)
                curve = resampled(even, at[taken], pulled[taken]).values
                steps = np.flatnonzero(np.isfinite(curve))[:: 1 if loading else -1]
                passages.append(Passage(even[steps], curve[steps], loading))
    if not passages:
        raise invalid(str(path), "has no loading; give strain that rises")
    return LoadingCycles(tuple(passages), records.per_width, records.summary)


class _Records(NamedTuple):
    repeats: dict[str, tuple[Record, Record]]  # strain, and force or force over width
    per_width: bool
    summary: tuple[str, ...]  # of the corrections


def _read(
    path: Path,
    lengths: dict[str, float | None],
    zero: Zero | None,
    preload: float | None,
    choice: Choice,
    *,
    one_swatch: bool = False,
) -> _Records:
    columns = _columns(path, lengths, choice, one_swatch=one_swatch)
    if one_swatch and len(columns.repeats) > 1 and columns.repeat_name not in OF_ONE_SWATCH:
        message = "has several swatches, and cycles are of one; give one, in a column repeat"
        raise invalid(f"{path}: column {columns.repeat_name}", message)
    curves, left_out = curves_without_bad_readings(columns.repeats)
    width, unit = lengths["force"] or 1.0, "N/mm" if columns.load == "stress" else "N"
    starts = {}
    for repeat, (strain, force) in curves.items():
        first = _loading(strain)[0] & (strain >= 0)
        starts[repeat] = loading_start(strain[first], width * force[first])
        if one_swatch:
            break
    correction = start_correction(f"{path}: column {columns.load}", starts, zero, preload, unit)
    (common, *_) = correction.offsets.values()
    corrected = {
        repeat: (
            (1 + strain) * (1 + correction.stretched) - 1,
            force - correction.offsets.get(repeat, common) / width,
        )
        for repeat, (strain, force) in curves.items()
    }
    per_width = columns.load == "stress" or lengths["force"] is not None
    return _Records(corrected, per_width, (*columns.summary, *left_out, *correction.summary))


class _Columns(NamedTuple):
    repeats: dict[str, tuple[Record, Record]]  # strain and load of each, as recorded
    repeat_name: str  # of the column of repeats, in lower case
    load: str  # force or stress
    summary: tuple[str, ...]  # which columns and tables are read, where there are others


def _columns(
    path: Path, lengths: dict[str, float | None], choice: Choice, *, one_swatch: bool
) -> _Columns:
    """Strain and load of a table, or of several of the same columns in one sheet, as repeats."""
    tables, unread = read_tables(path, EXAMPLE, _has_curve, choice)
    forms = {(table.sheet, *table.headers) for table in tables}
    if len(tables) > 1 and (one_swatch or len(forms) > 1):
        raise several(path, tables, choice)
    read = [_columns_of_table(path, table, lengths) for table in tables]
    first, summary = read[0], (*read[0].summary, *unread)
    if len(read) == 1:
        return first._replace(summary=summary)
    repeats = {
        f"{number}.{repeat}" if len(columns.repeats) > 1 else f"{number}": curve
        for number, columns in enumerate(read, 1)
        for repeat, curve in columns.repeats.items()
    }
    message = f"{len(tables)} tables of the same columns are read as repeats: {places(tables)}"
    return first._replace(repeats=repeats, summary=(message, *summary))


def _has_curve(headers: list[str]) -> bool:
    kinds = {_kind(*name_and_unit(header)) for header in headers}
    return bool(kinds & set(ALONG)) and bool(kinds & set(LOADS))


def _columns_of_table(path: Path, read: Table, lengths: dict[str, float | None]) -> _Columns:
    headers, table = read.headers, read.rows
    columns: dict[str, tuple[int, str, str]] = {}
    mistakes = []
    for number, header in enumerate(headers):
        name, unit = name_and_unit(header)
        kind = _kind(name, unit)
        if kind is None:
            continue
        if not unit and kind != "repeat":
            mistakes.append(Mistake(f"{path}: column {name}", f"has no unit; {EXAMPLE}"))
        if kind in columns:
            first = columns[kind][2]
            message = "occurs twice" if name == first else f"is {kind}, and so is {first}"
            message += "; export one of them, and specimens below each other, as repeats"
            mistakes.append(Mistake(f"{path}: column {name}", message))
        columns[kind] = number, unit, name
    along, load = _chosen(columns, lengths)
    if along is None:
        message = f"is missing; the file has {', '.join(headers)}; {EXAMPLE}"
        mistakes.append(Mistake(f"{path}: column strain", message))
    if load is None:
        message = f"has neither; it has {', '.join(headers)}; {EXAMPLE}"
        if columns.keys() & set(LOADS):
            message = f"has both; give width = WIDTH alone to read {columns['force'][2]}, or"
            message += f" give thickness = THICKNESS alone to read {columns['stress'][2]}"
        mistakes.append(Mistake(f"{path}: columns force and stress", message))
    raise_if_any(mistakes)
    assert along is not None
    assert load is not None
    values = []
    for kind in (along, load):
        (number, unit, name), size = columns[kind], lengths.get(kind)
        over_width = " over width" if kind == "stress" and size is None else ""
        column, (target, hint) = f"{path}: column {name}", TARGETS[kind + over_width]
        numbers, wrong = column_numbers(path, name, table[number])
        factor, unit_mistakes = unit_factor(column, unit, target, hint)
        if kind == "extension" and size is None:
            unit_mistakes = [Mistake(column, "needs the gauge_length, the relaxed length, in mm")]
        mistakes += wrong + unit_mistakes
        scale = size or 1.0
        values.append(numbers * factor * (scale if kind == "stress" else 1 / scale))
    for other, name in (("stress", "thickness"), ("force", "width")):
        if other not in columns and (size := lengths[other]) is not None:
            message = f"is for {other}, but the record holds {load}; leave it out"
            mistakes.append(Mistake(f"{name} {size:g}", message))
    raise_if_any(mistakes)
    beside = [
        f"{columns[kind][2]} is read, and not {columns[other][2]}"
        for kind, kinds in ((along, ALONG), (load, LOADS))
        for other in kinds
        if other != kind and other in columns
    ]
    strain, force = values
    if "repeat" not in columns:
        return _Columns({"1": (strain, force)}, "", load, tuple(beside))
    number, _, name = columns["repeat"]
    repeats = table[number].to_numpy(str)
    owned = {repeat: repeats == repeat for repeat in dict.fromkeys(repeats.tolist())}
    by_repeat = {repeat: (strain[own], force[own]) for repeat, own in owned.items()}
    return _Columns(by_repeat, name.lower(), load, tuple(beside))


def _chosen(
    columns: Collection[str], lengths: dict[str, float | None]
) -> tuple[str | None, str | None]:
    """Which columns are the strain and the load; of two, that whose length is given."""
    along, loads = ([kind for kind in kinds if kind in columns] for kinds in (ALONG, LOADS))
    given = [kind for kind in loads if lengths[kind] is not None]
    if len(along) > 1 and lengths["extension"] is not None:
        along = ["extension"]
    loads = given if len(loads) > 1 else loads
    return next(iter(along), None), loads[0] if len(loads) == 1 else None


def _kind(name: str, unit: str) -> str | None:
    """What a column holds, by its name and, if that has two meanings, by its unit."""
    plain = " ".join(name.lower().replace("_", " ").split())
    kinds = [kind for kind, names in NAMES.items() if plain in names]
    if len(kinds) > 1:
        kinds.sort(key=lambda kind: len(unit_factor(name, unit or "1", *TARGETS[kind])[1]))
    return kinds[0] if kinds else None


def _loading(
    strain: Record, cycle: int = 1, column: str = ""
) -> tuple[Bool[np.ndarray, " record"], int]:
    """Which records are of the loading of a cycle, or at rest before the first; how many cycles."""
    number = np.arange(len(strain), dtype=float)
    found = cycles(number, strain, MIN_TURN)
    if cycle > max(1, len(found)):
        raise invalid(column, f"has {len(found)} cycles; choose one of them, not cycle {cycle}")
    if not found:
        return np.full(len(strain), True), 0
    loading = found[cycle - 1].loaded(number)
    if cycle == 1:
        loading |= (number < found[0].start) & (strain >= 0)
    return loading, len(found)


def _middles(start: float, end: float, count: int) -> Points:
    edges = np.linspace(start, end, count + 1)
    return (edges[1:] + edges[:-1]) / 2


def relaxed_period(
    n: int,
    period: float | None = None,
    gauge_length: float | None = None,
    gauge_stitches: float | None = None,
) -> float:
    """Relaxed period of an n × n fabric [mm], as given, or from its 2 n stitches; or InputError."""
    if period is not None and gauge_stitches is not None:
        raise invalid("period", "is given twice; give period or gauge_stitches")
    if period is not None:
        return float(period)
    if gauge_stitches is None:
        raise invalid("period", "is missing; give it in mm, or gauge_length and gauge_stitches")
    if gauge_length is None:
        raise invalid("gauge_stitches", "give a period only with the gauge_length; give it in mm")
    return gauge_length * 2 * n / gauge_stitches
