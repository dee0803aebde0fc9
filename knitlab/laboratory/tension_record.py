"""Records of a testing machine on a pure fabric: repeats, cycles and noise become one curve."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Float

from knitlab.io.errors import BadInput, Fault, fault
from knitlab.io.table_file import factor_of, numbers_of, read_table
from knitlab.measure.records import cycles, resampled

EXAMPLE = "write it as in 'strain [1],force [N]' or 'repeat [1],extension [mm],force [N]'"
HEADER = re.compile(r"\s*(?P<name>[^\[\]()]+?)\s*[\[(](?P<unit>[^\[\]()]*)[\])]\s*")
NAMES = {
    "strain": ("strain", "axial strain", "tensile strain"),
    "extension": ("extension", "displacement", "elongation", "crosshead", "position"),
    "force": ("force", "load"),
    "stress": ("stress", "tensile stress"),
    "repeat": ("repeat", "specimen", "sample", "test"),
}
"""Names of columns, in lower case; others are not read."""
LEAST_POINTS = 4
"""One more than the fitted parameters of a stripe, so that their errors can be estimated."""
LEAST_TURN = 0.1
"""Smallest reversal that ends a loading branch, as a fraction of the range of strain."""
CURVE_POINTS = 40
"""Points of the curve of several repeats, or of a record that is noisy or turns."""
SLACK = 0.02
"""Strain below zero that a record may start with: a repeat begins where its camera does."""


@dataclass(frozen=True)
class TensionRecord:
    """Loading of a pure fabric: one curve for each repeat, at common strains.

    Attributes:
        strain: relative to the relaxed length, ascending [1].
        force: of each repeat, on one row of the network [N] or over the width [N/mm].
        per_width: whether the force is over the width of the fabric.
        summary: what was read, and what was left out, in lines of text.
    """

    strain: Float[np.ndarray, " point"]
    force: Float[np.ndarray, "repeat point"]
    per_width: bool
    summary: tuple[str, ...]


def read_tension_record(
    path: str | Path,
    *,
    gauge_length: float | None = None,
    width: float | None = None,
    thickness: float | None = None,
    cycle: int = 1,
) -> TensionRecord:
    """Read what a testing machine writes: strain or extension, and force or stress, in any unit.

    A column ``repeat`` separates several specimens. Of each, the loading branch of one cycle is
    taken, and negative strains are left out. Records that are repeated, or not ascending, are
    resampled at evenly spaced strains that all repeats reach.

    Args:
        path: CSV file whose header has the units, such as ``extension [mm],force [N]``.
        gauge_length: relaxed length between the clamps, for a column of extension [mm].
        width: width of the swatch, for a column of force; without it, the force is that on one
            row of the network [mm].
        thickness: of the fabric, for stress over its cross-section [mm].
        cycle: number of the cycle whose loading is taken, from 1.

    Returns:
        The curves.

    Raises:
        BadInput: with every fault of the file.
    """
    path = Path(path)
    columns = _columns(path)
    strain_name = "strain" if "strain" in columns else "extension"
    load = "force" if "force" in columns else "stress"
    numbers: dict[str, Float[np.ndarray, " point"]] = {}
    faults: list[Fault] = []
    for name in (strain_name, load):
        numbers[name], wrong = numbers_of(path, name, columns[name][0])
        faults += wrong
    to_strain, wrong = _to_strain(path, strain_name, columns[strain_name][1], gauge_length)
    faults += wrong
    to_load, per_width, wrong = _to_load(path, load, columns[load][1], width, thickness)
    faults += wrong
    if faults:
        raise BadInput(faults)
    strain, force = to_strain * numbers[strain_name], to_load * numbers[load]
    labels = columns["repeat"][0] if "repeat" in columns else np.full(len(strain), "1")
    repeats = list(dict.fromkeys(labels)) or ["1"]
    branches, left_out = [], 0
    for repeat in repeats:
        own = np.asarray(labels == repeat)
        branch, below = _loading(path, repeat, strain[own], force[own], cycle)
        branches.append(branch)
        left_out += below
    turned = sum(len(branch[0]) for branch in branches) < len(strain) - left_out
    lines = [f"{len(strain)} records of {len(repeats)} repeats, loading of cycle {cycle}"]
    if left_out:
        lines.append(f"{left_out} records at negative strain are left out")
    if len(repeats) == 1 and not turned and not np.any(np.diff(branches[0][0]) < 0):
        (only, forces) = branches[0]
        return TensionRecord(only, forces[None], per_width, tuple(lines))
    start = max(float(branch[0].min()) for branch in branches)
    end = min(float(branch[0].max()) for branch in branches)
    edges = np.linspace(start, end, CURVE_POINTS + 1)
    at = (edges[1:] + edges[:-1]) / 2
    curves = np.array([resampled(at, *branch).values for branch in branches])
    known = np.isfinite(curves).all(axis=0)
    lines.append(f"{known.sum()} points, up to strain {at[known].max():.3g}, of every repeat")
    return TensionRecord(at[known], curves[:, known], per_width, tuple(lines))


def _columns(path: Path) -> dict[str, tuple[pd.Series, str]]:
    """The columns that are read, by what they hold, each with its unit."""
    headers, table, _ = read_table(path, EXAMPLE)
    columns: dict[str, tuple[pd.Series, str]] = {}
    faults = []
    for number, header in enumerate(headers):
        match = HEADER.fullmatch(header)
        name, unit = (match["name"], match["unit"].strip()) if match else (header, "")
        kind = next((kind for kind, its in NAMES.items() if name.strip().lower() in its), None)
        if kind is None:
            continue
        if not unit and kind != "repeat":
            faults.append(Fault(f"{path}: column {name.strip()}", f"has no unit; {EXAMPLE}"))
        if kind in columns:
            faults.append(Fault(f"{path}: column {name.strip()}", "occurs twice; keep one"))
        columns[kind] = table[number], unit
    present = ", ".join(headers)
    if "strain" not in columns and "extension" not in columns:
        problem = f"is missing; the file has {present}; {EXAMPLE}"
        faults.append(Fault(f"{path}: column strain", problem))
    loads = [name for name in ("force", "stress") if name in columns]
    if len(loads) != 1:
        problem = "has both; keep one" if loads else f"has neither; it has {present}; {EXAMPLE}"
        faults.append(Fault(f"{path}: columns force and stress", problem))
    if faults:
        raise BadInput(faults)
    return columns


def _to_strain(
    path: Path, name: str, unit: str, gauge_length: float | None
) -> tuple[float, list[Fault]]:
    column = f"{path}: column {name}"
    if name == "strain":
        return factor_of(column, unit, "1", "such as [1] or [%]")
    if gauge_length is None:
        return np.nan, [Fault(column, "needs the gauge_length, the relaxed length, in mm")]
    factor, faults = factor_of(column, unit, "mm", "of length, such as [mm]")
    return factor / gauge_length, faults


def _to_load(
    path: Path, name: str, unit: str, width: float | None, thickness: float | None
) -> tuple[float, bool, list[Fault]]:
    """Factor to N on one row, or to N/mm; whether it is the latter; and faults."""
    column = f"{path}: column {name}"
    if name == "force":
        factor, faults = factor_of(column, unit, "N", "of force, such as [N]")
        if thickness is not None:
            problem = "is for stress, but the record holds force; leave it out"
            faults.append(Fault(f"thickness {thickness:g}", problem))
        return (factor, False, faults) if width is None else (factor / width, True, faults)
    if width is not None:
        problem = "is for force, but the record holds stress; leave it out"
        return np.nan, True, [Fault(f"width {width:g}", problem)]
    if thickness is None:
        remedy = "of force over width, such as [N/mm], or give the thickness in mm for [MPa]"
        factor, faults = factor_of(column, unit, "N/mm", remedy)
        return factor, True, faults
    factor, faults = factor_of(column, unit, "N/mm^2", "of force over area, such as [MPa]")
    return factor * thickness, True, faults


def _loading(
    path: Path,
    repeat: str,
    strain: Float[np.ndarray, " record"],
    force: Float[np.ndarray, " record"],
    cycle: int,
) -> tuple[tuple[Float[np.ndarray, " point"], Float[np.ndarray, " point"]], int]:
    """Strain and force of one loading branch, from zero, and the records below zero strain."""
    column = f"{path}: column strain" + (f", repeat {repeat}" if repeat != "1" else "")
    number = np.arange(len(strain), dtype=float)
    found = cycles(number, strain, LEAST_TURN) if len(strain) else []
    if cycle > max(1, len(found)):
        problem = f"has {len(found)} cycles; choose one of them, not cycle {cycle}"
        raise fault(column, problem)
    if found:
        loading = found[cycle - 1].loaded(number)
        # Records at rest before the first loading belong to it.
        loading |= (cycle == 1) & (number < found[0].start) & (strain >= 0)
        strain, force = strain[loading], force[loading]
    below = strain < 0
    if len(strain) and strain.min() < -max(SLACK, SLACK * strain.max()):
        problem = f"goes down to {strain.min():g}; give tension alone, from 0 up"
        raise fault(column, problem)
    strain, force = strain[~below], force[~below]
    if (points := len(np.unique(strain))) < LEAST_POINTS:
        problem = f"has {points} points; three parameters need at least {LEAST_POINTS}"
        raise fault(column, problem)
    return (strain, force), int(below.sum())


def period_of(
    n: int,
    period: float | None = None,
    gauge_length: float | None = None,
    gauge_stitches: float | None = None,
) -> float:
    """Relaxed period of an n × n fabric, as given, or from its 2 n stitches [mm].

    Raises:
        BadInput: if it is given twice, or does not follow.
    """
    if (period is None) == (gauge_stitches is None):
        problem = "is given twice; give period or gauge_stitches"
        if period is None:
            problem = "is missing; give it in mm, or gauge_length and gauge_stitches"
        raise fault("period", problem)
    if period is not None:
        return period
    if gauge_length is None or gauge_stitches is None:
        raise fault("gauge_stitches", "give a period only with the gauge_length; give it in mm")
    return gauge_length * 2 * n / gauge_stitches
