"""Records of a testing machine on a pure fabric: repeats, cycles and noise become curves."""

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from knitlab.io.errors import ErrorCollector, InputError, Mistake, invalid, raise_if_any
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
from knitlab.lab.readings import without_bad_readings
from knitlab.lab.record_start import Start, Zero, loading_start, start_correction
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
        if (least := strain[loading].min()) < -max(SLACK, SLACK * strain[loading].max()):
            raise invalid(column, f"goes down to {least:g}; give tension alone, from 0 up")
        taken = loading & (strain >= 0)
        if (points := len(np.unique(strain[taken]))) < MIN_POINTS:
            message = f"has {points} points; three parameters need at least {MIN_POINTS}"
            raise invalid(column, message)
        branches.append((strain[taken], force[taken]))
        left_out += int((loading & (strain < 0)).sum())
    count = sum(len(strain) for strain, _ in records.repeats.values())
    turned = sum(len(strain) for strain, _ in branches) < count - left_out
    of_cycles = f" of {n_cycles}" if n_cycles > 1 else ""
    lines = [f"{count} records of {len(branches)} repeats, loading of cycle {cycle}{of_cycles}"]
    if left_out:
        lines.append(f"{left_out} records at negative strain are left out")
    lines += records.summary
    ((at, force), *others) = branches
    curves = force[None]
    if others or turned or np.any(np.diff(at) < 0):
        start = max(float(strain.min()) for strain, _ in branches)
        end = min(float(strain.max()) for strain, _ in branches)
        at = _middles(start, end, CURVE_POINTS)
        curves = np.array([_curve(at, *branch) for branch in branches])
        known = np.isfinite(curves).all(axis=0) & (start < end)
        if not known.any():
            message = f"has a repeat from strain {start:.3g} on, and another up to {end:.3g}"
            raise invalid(str(path), f"{message}; give repeats of the same strains, or table")
        at, curves = at[known], curves[:, known]
        lines.append(f"{len(at)} points, up to strain {at.max():.3g}, of every repeat")
    return TensionRecord(at, curves, records.per_width, tuple(lines), str(path))


def _curve(at: Points, strain: Record, force: Record) -> Points:
    """A repeat at some strains, interpolated between those at which it has readings."""
    values = resampled(at, strain, force).values
    read = np.isfinite(values)
    if read.any():
        return np.interp(at, at[read], values[read], left=np.nan, right=np.nan)
    order = np.argsort(strain, kind="stable")
    return np.interp(at, strain[order], force[order])


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
    repeats: dict[str, tuple[Record, Record]]  # strain, and load or force over width
    load: str  # force or stress
    per_width: bool
    repeat_name: str  # of the column of repeats, in lower case
    summary: tuple[str, ...]  # what is read and what is not, and the corrections


def _read(
    path: Path,
    lengths: dict[str, float | None],
    zero: Zero | None,
    preload: float | None,
    choice: Choice,
    *,
    one_swatch: bool = False,
) -> _Records:
    """Strain and force of repeats, corrected; of several tables of the same columns, too."""
    tables, unread = read_tables(path, EXAMPLE, _has_curve, choice)
    forms = {(each.sheet, *each.headers) for each in tables}
    if len(forms) > 1 or (one_swatch and len(tables) > 1):
        raise several(path, tables, choice)
    records = [_columns(path, table, lengths) for table in tables]
    (first, *others), summary = records, [*records[0].summary, *unread]
    repeats = first.repeats
    if others:
        repeats = {
            f"{number}.{repeat}" if len(each.repeats) > 1 else f"{number}": curve
            for number, each in enumerate(records, 1)
            for repeat, curve in each.repeats.items()
        }
        same = f"{len(tables)} tables of the same columns are read as repeats: {places(tables)}"
        summary.insert(0, same)
    if one_swatch and len(repeats) > 1 and first.repeat_name not in OF_ONE_SWATCH:
        message = "has several swatches, and cycles are of one; give one, in a column repeat"
        raise invalid(f"{path}: column {first.repeat_name}", message)
    width, unit = lengths["force"] or 1.0, "N/mm" if first.load == "stress" else "N"
    curves, starts = {}, dict[str, Start | None]()
    for repeat, (strain, force) in repeats.items():
        of_repeat = f" of repeat {repeat}" if len(repeats) > 1 else ""
        known_strain, bad_strain = without_bad_readings(f"strain{of_repeat}", strain)
        known_force, bad_force = without_bad_readings(f"force{of_repeat}", force, strain)
        summary += bad_strain + bad_force
        known = np.isfinite(known_strain + known_force)
        at, pulled = strain[known], force[known]
        curves[repeat] = at, pulled
        if not (one_swatch and starts):
            rising = _loading(at)[0] & (at >= 0)
            starts[repeat] = loading_start(at[rising], width * pulled[rising])
    correction = start_correction(f"{path}: column {first.load}", starts, zero, preload, unit)
    (common, *_) = correction.offsets.values()
    corrected = {
        repeat: (
            (1 + strain) * (1 + correction.stretched) - 1,
            force - correction.offsets.get(repeat, common) / width,
        )
        for repeat, (strain, force) in curves.items()
    }
    return first._replace(repeats=corrected, summary=(*summary, *correction.summary))


def _has_curve(headers: list[str]) -> bool:
    kinds = {_kind(*name_and_unit(header)) for header in headers}
    return bool(kinds & set(ALONG)) and bool(kinds & set(LOADS))


def _columns(path: Path, read: Table, lengths: dict[str, float | None]) -> _Records:
    """Strain and load of a table, as recorded."""
    columns: dict[str, tuple[int, str, str]] = {}
    mistakes = ErrorCollector()
    for number, header in enumerate(read.headers):
        name, unit = name_and_unit(header)
        kind = _kind(name, unit)
        if kind is None:
            continue
        if not unit and kind != "repeat":
            mistakes.all.append(Mistake(f"{path}: column {name}", f"has no unit; {EXAMPLE}"))
        if kind in columns:
            first = columns[kind][2]
            message = "occurs twice" if name == first else f"is {kind}, and so is {first}"
            message += "; export one of them, and each specimen as a table of its own"
            mistakes.all.append(Mistake(f"{path}: column {name}", message))
        columns[kind] = number, unit, name
    along, *other_along = [kind for kind in ALONG if kind in columns] or [""]
    if other_along and lengths["extension"] is not None:
        along, other_along = "extension", ["strain"]
    loads = [kind for kind in LOADS if kind in columns]
    if len(loads) > 1:  # that whose length is given
        loads = [kind for kind in LOADS if lengths[kind] is not None]
    if not along:
        message = f"is missing; the file has {', '.join(read.headers)}; {EXAMPLE}"
        mistakes.all.append(Mistake(f"{path}: column strain", message))
    if len(loads) != 1:
        message = f"has neither; it has {', '.join(read.headers)}; {EXAMPLE}"
        if columns.keys() & set(LOADS):
            message = f"has both; give width = WIDTH alone to read {columns['force'][2]}, or"
            message += f" give thickness = THICKNESS alone to read {columns['stress'][2]}"
        mistakes.all.append(Mistake(f"{path}: columns force and stress", message))
    raise_if_any(mistakes.all)
    (load,), values = loads, []
    for kind in (along, load):
        (number, unit, name), size = columns[kind], lengths.get(kind)
        over_width = " over width" if kind == "stress" and size is None else ""
        column = f"{path}: column {name}"
        with mistakes:
            if kind == "extension" and size is None:
                raise invalid(column, "needs the gauge_length, the relaxed length, in mm")
            factor, scale = unit_factor(column, unit, *TARGETS[kind + over_width]), size or 1.0
            numbers = column_numbers(path, name, read.rows[number])
            values.append(numbers * factor * (scale if kind == "stress" else 1 / scale))
    for other, name in (("stress", "thickness"), ("force", "width")):
        if other not in columns and (size := lengths[other]) is not None:
            message = f"is for {other}, but the record holds {load}; leave it out"
            mistakes.all.append(Mistake(f"{name} {size:g}", message))
    raise_if_any(mistakes.all)
    strain, force = values
    beside = [(along, other) for other in other_along]
    beside += [(load, other) for other in LOADS if other != load and other in columns]
    repeats, repeat_name = np.full(len(strain), "1"), ""
    if "repeat" in columns:
        number, _, repeat_name = columns["repeat"]
        repeats = read.rows[number].to_numpy(str)
    return _Records(
        {
            repeat: (strain[repeats == repeat], force[repeats == repeat])
            for repeat in dict.fromkeys(repeats.tolist())
        },
        load,
        load == "stress" or lengths["force"] is not None,
        repeat_name.lower(),
        tuple(f"{columns[one][2]} is read, and not {columns[other][2]}" for one, other in beside),
    )


def _kind(name: str, unit: str) -> str | None:
    """What a column holds, by its name and, if that has two meanings, by its unit."""
    plain = " ".join(name.lower().replace("_", " ").split())
    kinds = [kind for kind, names in NAMES.items() if plain in names]
    for kind in kinds[:-1]:
        with suppress(InputError):
            unit_factor(name, unit or "1", *TARGETS[kind])
            return kind
    return kinds[-1] if kinds else None


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
