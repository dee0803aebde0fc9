"""Measured curves: a CSV file whose header names each column with its unit."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from knitlab.io.errors import BadInput, Fault
from knitlab.io.table_file import factor_of, numbers_of, read_table

COLUMN = re.compile(r"\s*(?P<name>[^\[\]]+?)\s*\[(?P<unit>[^\[\]]*)\]\s*")
EXAMPLE = "write it as in 'strain [1],force [N]'"
LEAST_POINTS = 4
"""One more than the fitted parameters of a stripe, so that their errors can be estimated."""


@dataclass(frozen=True)
class TensionCurve:
    """Tension of one row of the network against strain.

    Attributes:
        strain: of the period, ascending from 0 or more [1].
        force: on one row [N].
    """

    strain: Float[np.ndarray, " point"]
    force: Float[np.ndarray, " point"]


def read_tension_curve(
    path: Path, width: float | None = None, thickness: float | None = None
) -> TensionCurve:
    """Read a tension curve: a column of strain, and one of force or of stress.

    Force is for one row of the network. Stress is force over width [N/mm] or, with a thickness,
    over cross-section [MPa]; any unit of these dimensions is accepted. Other columns are ignored.

    Args:
        path: the CSV file; lines that start with # are ignored.
        width: of one row, for stress [mm].
        thickness: of the fabric, for stress over cross-section [mm].

    Raises:
        BadInput: with every fault of the file.
    """
    headers, table = read_table(path, EXAMPLE)
    columns: dict[str, int] = {}
    units: dict[str, str] = {}
    faults = []
    for place, header in enumerate(headers):
        match = COLUMN.fullmatch(header)
        name = (match["name"] if match else header).strip().lower()
        if name not in ("strain", "force", "stress"):
            continue
        unit = match["unit"].strip() if match else ""
        if not unit:
            faults.append(Fault(f"{path}: column {name}", f"has no unit; {EXAMPLE}"))
        if name in columns:
            faults.append(Fault(f"{path}: column {name}", "occurs twice; keep one"))
        columns[name], units[name] = place, unit
    loads = [name for name in ("force", "stress") if name in columns]
    if "strain" not in columns:
        faults.append(Fault(f"{path}: column strain", f"is missing; {EXAMPLE}"))
    if len(loads) != 1:
        problem = "has both; keep one" if loads else f"has neither; {EXAMPLE}"
        faults.append(Fault(f"{path}: columns force and stress", problem))
    if faults:
        raise BadInput(faults)

    (load,) = loads
    numbers = {}
    for name in ("strain", load):
        numbers[name], found = numbers_of(path, name, table[columns[name]])
        faults += found
    per_row, found = _newton_per_row(path, load, units[load], width, thickness)
    faults += found
    of_one, found = factor_of(f"{path}: column strain", units["strain"], "1", "such as [1] or [%]")
    faults += found
    if not faults:
        faults += _strain_faults(path, numbers["strain"])
    if faults:
        raise BadInput(faults)
    return TensionCurve(numbers["strain"] * of_one, numbers[load] * per_row)


def _strain_faults(path: Path, strain: Float[np.ndarray, " point"]) -> list[Fault]:
    place = f"{path}: column strain"
    points = len(np.unique(strain))
    if points < LEAST_POINTS:
        problem = f"has {points} points; three parameters need at least {LEAST_POINTS}"
        return [Fault(place, problem)]
    if strain.min() < 0:
        return [Fault(place, f"goes down to {strain.min():g}; give tension alone, from 0 up")]
    falls = np.flatnonzero(np.diff(strain) < 0)
    if len(falls):
        at = falls[0]
        problem = (
            f"decreases from {strain[at]:g} to {strain[at + 1]:g} at point {at + 2};"
            " give the loading curve alone"
        )
        return [Fault(place, problem)]
    return []


def _newton_per_row(
    path: Path, load: str, unit: str, width: float | None, thickness: float | None
) -> tuple[float, list[Fault]]:
    place = f"{path}: column {load}"
    if load == "force":
        faults = [
            Fault(f"{option} {value:g}", "is for stress, but the curve holds force; leave it out")
            for option, value in (("width", width), ("thickness", thickness))
            if value is not None
        ]
        factor, found = factor_of(place, unit, "N", "of force, such as [N]")
        return factor, faults + found
    if width is None:
        problem = "needs the width of one row of the network; give its width in mm"
        return np.nan, [Fault(place, problem)]
    if thickness is None:
        remedy = "of force over width, such as [N/mm], or give the thickness in mm for [MPa]"
        factor, faults = factor_of(place, unit, "N/mm", remedy)
        return factor * width, faults
    factor, faults = factor_of(place, unit, "N/mm^2", "of force over area, such as [MPa]")
    return factor * width * thickness, faults
