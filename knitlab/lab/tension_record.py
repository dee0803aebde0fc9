"""Records of a testing machine on a pure fabric: repeats, cycles and noise become one curve."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from knitlab.io.errors import Mistake, invalid, raise_if_any
from knitlab.io.table_file import column_numbers, name_and_unit, read_table, unit_factor
from knitlab.lab.friction_fit import LoadingCycles, Passage
from knitlab.lab.record_start import Correction, Tested, Zero, correction_of, start_of
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
"""Units to which columns are converted, and a remedy for others."""
LEAST_POINTS = 4  # one more than the parameters of a stripe, so that errors can be estimated
LEAST_TURN = 0.1  # smallest reversal that ends a loading branch, over the range of strain
CURVE_POINTS = 40  # of the curve of several repeats, or of a record that is noisy or turns
SLACK = 0.02  # strain below zero that a record may start with, where its camera begins

Points = Float[np.ndarray, " point"]


@dataclass(frozen=True)
class TensionRecord:
    """Loading of a pure fabric: one curve for each repeat, at common strains."""

    strain: Points  # ascending
    force: Float[np.ndarray, "repeat point"]  # on one row of the network [N] or per width [N/mm]
    per_width: bool
    summary: tuple[str, ...]  # what was read, and what was left out


def read_tension_record(
    path: str | Path,
    *,
    gauge_length: float | None = None,
    width: float | None = None,
    thickness: float | None = None,
    cycle: int = 1,
    zero: Zero | None = None,
    preload: float | None = None,
) -> TensionRecord:
    """Read what a testing machine writes: strain or extension, and force or stress, in any unit.

    A column ``repeat`` separates several specimens. Of each, the loading branch of one cycle is
    taken, and negative strains are left out. Records that are repeated, or not ascending, are
    resampled at evenly spaced strains that all repeats reach.

    Args:
        path: the record, a table whose header has the units.
        gauge_length: relaxed length between the clamps, for a column of extension [mm].
        width: of the swatch [mm]; without it, force is that on one row of the network.
        thickness: of the fabric, for stress over the cross-section [mm].
        cycle: the cycle whose loading is taken.
        zero: what is subtracted from the force: ``"none"``, nothing; ``"start"``, the force of each
            repeat at zero strain, less the preload; or a number [N].
        preload: tension at which the record began [N]; strains are then counted from the relaxed
            length, which follows from the curve.

    Returns:
        The curve of each repeat; its summary says what was subtracted and how strains were moved.

    Raises:
        InputError: with every fault of the file; and if the force at zero strain is above the noise
            but neither ``zero`` nor ``preload`` is given, or contradicts the preload.
    """
    path, tested = Path(path), Tested(zero, preload)
    sizes = {"extension": gauge_length, "force": width, "stress": thickness}
    columns, repeats, _ = _columns(path, sizes)
    (strain, force), per_width = columns.values(), "stress" in columns or width is not None
    owned = {name: np.array(repeats) == name for name in dict.fromkeys(repeats)}
    first = {name: _first_loading(strain[own], force[own]) for name, own in owned.items()}
    correction = _correction(path, first, tested, columns, width)
    branches, left_out = [], 0
    for repeat, own in owned.items():
        column = f"{path}: column strain" + (f", repeat {repeat}" if repeat != "1" else "")
        taken, pulled, below = _loading(column, strain[own], force[own], cycle)
        taken = (1 + taken) * (1 + correction.stretched) - 1
        branches.append((taken, pulled - correction.offsets[repeat]))
        left_out += below
    turned = sum(len(branch[0]) for branch in branches) < len(strain) - left_out
    lines = [f"{len(strain)} records of {len(branches)} repeats, loading of cycle {cycle}"]
    if left_out:
        lines.append(f"{left_out} records at negative strain are left out")
    lines += correction.summary
    if len(branches) == 1 and not turned and not np.any(np.diff(branches[0][0]) < 0):
        strain, force = branches[0]
        return TensionRecord(strain, force[None], per_width, tuple(lines))
    start = max(float(branch[0].min()) for branch in branches)
    end = min(float(branch[0].max()) for branch in branches)
    edges = np.linspace(start, end, CURVE_POINTS + 1)
    at = (edges[1:] + edges[:-1]) / 2
    curves = np.array([_filled(at, resampled(at, *branch).values) for branch in branches])
    known = np.isfinite(curves).all(axis=0)
    lines.append(f"{known.sum()} points, up to strain {at[known].max():.3g}, of every repeat")
    return TensionRecord(at[known], curves[:, known], per_width, tuple(lines))


def _filled(
    at: Float[np.ndarray, " point"], force: Float[np.ndarray, " point"]
) -> Float[np.ndarray, " point"]:
    """Forces, interpolated between known ones where a repeat has no readings."""
    known = np.isfinite(force)
    return np.interp(at, at[known], force[known], left=np.nan, right=np.nan)


def read_cycles(
    path: str | Path,
    *,
    gauge_length: float | None = None,
    width: float | None = None,
    thickness: float | None = None,
    zero: Zero | None = None,
    preload: float | None = None,
) -> LoadingCycles:
    """Read every loading and unloading of one swatch, its repeats one after another.

    The arguments are those of :func:`read_tension_record`. Each passage is resampled at evenly
    spaced strains; records at negative strain are left out. Offset and preload are those of the
    first loading. InputError has every fault of the file. A column of several swatches, such as
    ``specimen``, is refused.
    """
    path, tested = Path(path), Tested(zero, preload)
    sizes = {"extension": gauge_length, "force": width, "stress": thickness}
    columns, repeats, named = _columns(path, sizes)
    if len(set(repeats)) > 1 and named not in OF_ONE_SWATCH:
        message = "has several swatches, and cycles are of one; give one, in a column repeat"
        raise invalid(f"{path}: column {named}", message)
    strain, force = columns.values()
    own = np.array(repeats) == repeats[0]
    first = {repeats[0]: _first_loading(strain[own], force[own])}
    correction = _correction(path, first, tested, columns, width)
    strain = (1 + strain) * (1 + correction.stretched) - 1
    force = force - correction.offsets[repeats[0]]
    passages = list[Passage]()
    for repeat in dict.fromkeys(repeats):
        own = (np.array(repeats) == repeat) & (strain >= 0)
        number = np.arange(own.sum(), dtype=float)
        for cycle in cycles(number, strain[own], LEAST_TURN):
            for loading in (True, False):
                taken = cycle.loaded(number) if loading else cycle.unloaded(number)
                at, pulled = strain[own][taken], force[own][taken]
                if len(np.unique(at)) < LEAST_POINTS:
                    continue
                even = np.linspace(at.min(), at.max(), CURVE_POINTS // 2 + 1)
                curve = resampled((even[1:] + even[:-1]) / 2, at, pulled)
                known = np.isfinite(curve.values)
                steps = slice(None) if loading else slice(None, None, -1)
                middles = ((even[1:] + even[:-1]) / 2)[known]
                passages.append(Passage(middles[steps], curve.values[known][steps], loading))
    if not passages:
        raise invalid(str(path), "has no loading; give strain that rises")
    per_width = "stress" in columns or width is not None
    return LoadingCycles(tuple(passages), per_width, correction.summary)


def _columns(
    path: Path, sizes: dict[str, float | None]
) -> tuple[dict[str, Record], list[str], str]:
    """Strain and load, by the names of their columns, the repeat of every record, and its name.

    ``sizes`` are the lengths [mm] by which columns are divided or, stress, multiplied.
    """
    headers, table, _ = read_table(path, EXAMPLE)
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
            message += "; keep one; write specimens below each other, with a column repeat"
            mistakes.append(Mistake(f"{path}: column {name}", message))
        columns[kind] = number, unit, name
    along = "strain" if "strain" in columns else "extension"
    loads = [name for name in ("force", "stress") if name in columns]
    if along not in columns:
        message = f"is missing; the file has {', '.join(headers)}; {EXAMPLE}"
        mistakes.append(Mistake(f"{path}: column strain", message))
    if len(loads) != 1:
        absent = f"has neither; it has {', '.join(headers)}; {EXAMPLE}"
        message = "has both; keep one" if loads else absent
        mistakes.append(Mistake(f"{path}: columns force and stress", message))
    raise_if_any(mistakes)
    (load,) = loads
    values = {}
    for kind in (along, load):
        (number, unit, name), size = columns[kind], sizes.get(kind)
        over_width = " over width" if kind == "stress" and size is None else ""
        column, (target, hint) = f"{path}: column {name}", TARGETS[kind + over_width]
        numbers, wrong = column_numbers(path, name, table[number])
        factor, of_unit = unit_factor(column, unit, target, hint)
        if kind == "extension" and size is None:
            of_unit = [Mistake(column, "needs the gauge_length, the relaxed length, in mm")]
        mistakes += wrong + of_unit
        scale = size or 1.0
        values[kind] = numbers * factor * (scale if kind == "stress" else 1 / scale)
    for other, name in (("stress", "thickness"), ("force", "width")):
        if other != load and (size := sizes[other]) is not None:
            message = f"is for {other}, but the record holds {load}; leave it out"
            mistakes.append(Mistake(f"{name} {size:g}", message))
    raise_if_any(mistakes)
    if "repeat" not in columns:
        return values, ["1"] * len(table), ""
    number, _, name = columns["repeat"]
    return values, table[number].tolist(), name.lower()


def _kind(name: str, unit: str) -> str | None:
    """What a column holds, by its name and, if that has two meanings, by its unit."""
    plain = " ".join(name.lower().replace("_", " ").split())
    kinds = [kind for kind, names in NAMES.items() if plain in names]
    if len(kinds) > 1:
        kinds.sort(key=lambda kind: len(unit_factor(name, unit or "1", *TARGETS[kind])[1]))
    return kinds[0] if kinds else None


def _loading(column: str, strain: Record, force: Record, cycle: int) -> tuple[Points, Points, int]:
    """Strain and force of one loading branch, from zero, and how many records are below zero."""
    number = np.arange(len(strain), dtype=float)
    pulls = cycles(number, strain, LEAST_TURN)
    if cycle > max(1, len(pulls)):
        raise invalid(column, f"has {len(pulls)} cycles; choose one of them, not cycle {cycle}")
    if pulls:
        loading = pulls[cycle - 1].loaded(number)
        # Records at rest before the first loading belong to it.
        loading |= (cycle == 1) & (number < pulls[0].start) & (strain >= 0)
        strain, force = strain[loading], force[loading]
    below = strain < 0
    if strain.min() < -max(SLACK, SLACK * strain.max()):
        raise invalid(column, f"goes down to {strain.min():g}; give tension alone, from 0 up")
    strain, force = strain[~below], force[~below]
    if (points := len(np.unique(strain))) < LEAST_POINTS:
        message = f"has {points} points; three parameters need at least {LEAST_POINTS}"
        raise invalid(column, message)
    return strain, force, int(below.sum())


def _first_loading(strain: Record, force: Record) -> tuple[Points, Points]:
    """Strain and force of the first loading from zero, with what is recorded at rest before it."""
    number = np.arange(len(strain), dtype=float)
    loading = strain >= 0
    for first in cycles(number, strain, LEAST_TURN)[:1]:
        loading &= first.loaded(number) | (number < first.start)
    return strain[loading], force[loading]


def _correction(
    path: Path,
    first: dict[str, tuple[Points, Points]],
    tested: Tested,
    columns: dict[str, Record],
    width: float | None,
) -> Correction:
    """Corrections of the repeats, by their first loadings, with offsets in the record's unit."""
    if "stress" in columns and (name := tested.in_newtons):
        message = "is in N, but the record holds stress; give a record of the force, or zero start"
        raise invalid(f"{name} {getattr(tested, name):g}", message)
    scale, unit = width or 1.0, "N/mm" if "stress" in columns else "N"
    starts = {name: start_of(strain, scale * force) for name, (strain, force) in first.items()}
    where = f"{path}: column {'stress' if 'stress' in columns else 'force'}"
    correction = correction_of(where, starts, tested, unit)
    offsets = {name: offset / scale for name, offset in correction.offsets.items()}
    return replace(correction, offsets=offsets)


def period_of(
    n: int,
    period: float | None = None,
    gauge_length: float | None = None,
    gauge_stitches: float | None = None,
) -> float:
    """Relaxed period of an n × n fabric [mm], as given, or from its 2 n stitches; or InputError."""
    if period is not None and gauge_stitches is not None:
        raise invalid("period", "is given twice; give period or gauge_stitches")
    if period is not None:
        return period
    if gauge_stitches is None:
        raise invalid("period", "is missing; give it in mm, or gauge_length and gauge_stitches")
    if gauge_length is None:
        raise invalid("gauge_stitches", "give a period only with the gauge_length; give it in mm")
    return gauge_length * 2 * n / gauge_stitches
