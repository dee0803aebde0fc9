"""Records of a testing machine on a pure fabric: repeats, cycles and noise become one curve."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Float

from knitlab.io.errors import BadInput, Fault, fault
from knitlab.io.table_file import factor_of, numbers_of, read_table
from knitlab.measure.records import Record, cycles, resampled

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
LEAST_POINTS = 4  # one more than the parameters of a stripe, so that errors can be estimated
LEAST_TURN = 0.1  # smallest reversal that ends a loading branch, over the range of strain
CURVE_POINTS = 40  # of the curve of several repeats, or of a record that is noisy or turns
SLACK = 0.02  # strain below zero that a record may start with, where its camera begins

Branch = tuple[Float[np.ndarray, " point"], Float[np.ndarray, " point"]]  # strain and force


@dataclass(frozen=True)
class TensionRecord:
    """Loading of a pure fabric: one curve for each repeat, at common strains."""

    strain: Float[np.ndarray, " point"]  # ascending
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
) -> TensionRecord:
    """Read what a testing machine writes: strain or extension, and force or stress, in any unit.

    A column ``repeat`` separates several specimens. Of each, the loading branch of one cycle is
    taken, and negative strains are left out. Records that are repeated, or not ascending, are
    resampled at evenly spaced strains that all repeats reach. Extension needs the ``gauge_length``
    and stress over the cross-section the ``thickness`` [mm]; without the ``width`` of the swatch,
    force is that on one row of the network. BadInput has every fault of the file.
    """
    path = Path(path)
    columns = _columns(path)
    along = "strain" if "strain" in columns else "extension"
    load = "force" if "force" in columns else "stress"
    strain, faults = numbers_of(path, along, columns[along][0])
    force, wrong = numbers_of(path, load, columns[load][0])
    to_strain, of_strain = _to_strain(path, along, columns[along][1], gauge_length)
    to_load, of_load = _to_load(path, load, columns[load][1], width, thickness)
    if faults := [*faults, *wrong, *of_strain, *of_load]:
        raise BadInput(faults)
    strain, force = to_strain * strain, to_load * force
    per_width = load == "stress" or width is not None
    labels = columns["repeat"][0] if "repeat" in columns else np.full(len(strain), "1")
    repeats = list(dict.fromkeys(labels)) or ["1"]
    branches, left_out = [], 0
    for repeat in repeats:
        own = np.asarray(labels == repeat)
        column = f"{path}: column strain" + (f", repeat {repeat}" if repeat != "1" else "")
        branch, below = _loading(column, strain[own], force[own], cycle)
        branches.append(branch)
        left_out += below
    turned = sum(len(branch[0]) for branch in branches) < len(strain) - left_out
    lines = [f"{len(strain)} records of {len(repeats)} repeats, loading of cycle {cycle}"]
    if left_out:
        lines.append(f"{left_out} records at negative strain are left out")
    if len(repeats) == 1 and not turned and not np.any(np.diff(branches[0][0]) < 0):
        strain, force = branches[0]
        return TensionRecord(strain, force[None], per_width, tuple(lines))
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
        kind = next((kind for kind, names in NAMES.items() if name.strip().lower() in names), None)
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
    """Factor to strain, and faults."""
    column = f"{path}: column {name}"
    if name == "strain":
        return factor_of(column, unit, "1", "such as [1] or [%]")
    if gauge_length is None:
        return np.nan, [Fault(column, "needs the gauge_length, the relaxed length, in mm")]
    factor, faults = factor_of(column, unit, "mm", "of length, such as [mm]")
    return factor / gauge_length, faults


def _to_load(
    path: Path, name: str, unit: str, width: float | None, thickness: float | None
) -> tuple[float, list[Fault]]:
    """Factor to N on one row, or to N/mm, and faults."""
    column, unused = f"{path}: column {name}", list[Fault]()
    for other, size, value in (("stress", "thickness", thickness), ("force", "width", width)):
        if other != name and value is not None:
            problem = f"is for {other}, but the record holds {name}; leave it out"
            unused.append(Fault(f"{size} {value:g}", problem))
    if name == "force":
        target, remedy = "N", "of force, such as [N]"
    elif thickness is None:
        target = "N/mm"
        remedy = "of force over width, such as [N/mm], or give the thickness in mm for [MPa]"
    else:
        target, remedy = "N/mm^2", "of force over area, such as [MPa]"
    factor, faults = factor_of(column, unit, target, remedy)
    return factor * (thickness or 1.0) / (width or 1.0), faults + unused


def _loading(column: str, strain: Record, force: Record, cycle: int) -> tuple[Branch, int]:
    """One loading branch, from zero, and the number of its records below zero strain."""
    number = np.arange(len(strain), dtype=float)
    pulls = cycles(number, strain, LEAST_TURN) if len(strain) else []
    if cycle > max(1, len(pulls)):
        raise fault(column, f"has {len(pulls)} cycles; choose one of them, not cycle {cycle}")
    if pulls:
        loading = pulls[cycle - 1].loaded(number)
        # Records at rest before the first loading belong to it.
        loading |= (cycle == 1) & (number < pulls[0].start) & (strain >= 0)
        strain, force = strain[loading], force[loading]
    below = strain < 0
    if len(strain) and strain.min() < -max(SLACK, SLACK * strain.max()):
        raise fault(column, f"goes down to {strain.min():g}; give tension alone, from 0 up")
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
    """Relaxed period of an n × n fabric [mm], as given, or from its 2 n stitches; or BadInput."""
    if period is not None and gauge_stitches is not None:
        raise fault("period", "is given twice; give period or gauge_stitches")
    if period is not None:
        return period
    if gauge_stitches is None:
        raise fault("period", "is missing; give it in mm, or gauge_length and gauge_stitches")
    if gauge_length is None:
        raise fault("gauge_stitches", "give a period only with the gauge_length; give it in mm")
    return gauge_length * 2 * n / gauge_stitches
