"""Tables of numbers: CSV files of a laboratory, the units of their columns, and tension curves."""

import re
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

import numpy as np
import pandas as pd
import pint
from jaxtyping import Float

from knitlab.io.errors import BadInput, Fault, fault

COLUMN = re.compile(r"\s*(?P<name>[^\[\]]+?)\s*\[(?P<unit>[^\[\]]*)\]\s*")
EXAMPLE = "write it as in 'strain [1],force [N]'"
LEAST_POINTS = 4
"""One more than the fitted parameters of a stripe, so that their errors can be estimated."""


def read_table(path: Path, example: str) -> tuple[list[str], pd.DataFrame]:
    """Headers, which may contain duplicates, and the rows below them, as text, without # lines.

    Raises:
        BadInput: if it cannot be read, or is not a table; the message shows the example.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
        table = pd.read_csv(
            StringIO("\n".join(line for line in lines if not line.lstrip().startswith("#"))),
            dtype=str,
            header=None,
            skipinitialspace=True,
            keep_default_na=False,
        ).fillna("")
    except OSError as error:
        raise fault(str(path), f"cannot be read ({error.strerror}); check the path") from error
    except (pd.errors.ParserError, pd.errors.EmptyDataError, UnicodeDecodeError) as error:
        problem = " ".join(str(error).split())
        raise fault(str(path), f"is not a CSV table ({problem}); {example}") from error
    headers = table.iloc[0].tolist()
    if len(headers) == 1 and (mark := next((mark for mark in ";\t" if mark in headers[0]), None)):
        separators = "semicolons" if mark == ";" else "tabs"
        raise fault(str(path), f"is separated by {separators}; separate its columns by commas")
    return headers, table.iloc[1:]


def numbers_of(
    path: Path, name: str, column: pd.Series
) -> tuple[Float[np.ndarray, " point"], list[Fault]]:
    """The numbers of a column, and faults of the entries that are not numbers."""
    values = pd.to_numeric(column, errors="coerce").to_numpy(float)
    bad = np.flatnonzero(~np.isfinite(values))
    faults = []
    if len(bad):
        first = column.iloc[bad[0]]
        more = f", and {len(bad) - 1} more" if len(bad) > 1 else ""
        value = repr(first) if first else "empty"
        problem = f"point {bad[0] + 1} is {value}{more}, not a finite number; correct or remove it"
        faults.append(Fault(f"{path}: column {name}", problem))
    return values, faults


def read_columns(
    path: Path,
    names: Sequence[str],
    example: str,
    name_of: Callable[[str], str] = str.strip,
    with_gaps: Collection[str] = (),
) -> dict[str, Float[np.ndarray, " point"]]:
    """The numbers of columns with some names, which follow from their headers.

    Entries of those ``with_gaps`` may be empty, which is NaN. BadInput has every fault.
    """
    headers, rows = read_table(path, example)
    present = list(map(name_of, headers))
    columns, faults = {}, list[Fault]()
    for name in names:
        if present.count(name) != 1:
            problem = f"is missing; the file has {', '.join(present)}; {example}"
            problem = "occurs twice; keep one" if name in present else problem
            faults.append(Fault(f"{path}: column {name}", problem))
            continue
        text = rows[present.index(name)]
        gap = text.str.strip().str.lower().isin(["", "nan"]) & (name in with_gaps)
        columns[name] = np.full(len(text), np.nan)
        columns[name][~gap], wrong = numbers_of(path, name, text[~gap])
        faults += wrong
    if not faults and rows.empty:
        faults = [Fault(str(path), f"has no rows; {example}")]
    if faults:
        raise BadInput(faults)
    return columns


def factor_of(place: str, unit: str, target: str, remedy: str) -> tuple[float, list[Fault]]:
    """Factor from one unit to another, and faults of the first; ``remedy`` names accepted units."""
    try:
        once, twice = (_in_unit(value, unit, target) for value in (1.0, 2.0))
        if not np.isclose(twice, 2 * once):  # a logarithmic unit
            raise pint.DimensionalityError(unit, target)
        return once, []
    except pint.DimensionalityError:
        return np.nan, [Fault(place, f"is in {unit}; give it in a unit {remedy}")]
    except Exception:  # pint raises many types for a text that is not a unit
        return np.nan, [Fault(place, f"has the unknown unit {unit!r}; give one {remedy}")]


def _in_unit(value: float, unit: str, target: str) -> float:
    registry = pint.get_application_registry()
    quantity = registry.Quantity(value, "dimensionless" if unit == "1" else unit)
    if target == "1" and not quantity.to_root_units().unitless:  # an angle
        raise pint.DimensionalityError(unit, target)
    return float(quantity.to("dimensionless" if target == "1" else target).magnitude)


@dataclass(frozen=True)
class TensionCurve:
    """Tension of one row of the network [N] against strain, ascending from 0 or more [1]."""

    strain: Float[np.ndarray, " point"]
    force: Float[np.ndarray, " point"]


def read_tension_curve(
    path: Path, width: float | None = None, thickness: float | None = None
) -> TensionCurve:
    """Read a tension curve: a column of strain, and one of force or of stress, in any unit.

    Force is for one row of the network. Stress is force over the width [mm] of a row or, with the
    thickness [mm] of the fabric, over its cross-section.

    Raises:
        BadInput: with every fault of the file.
    """
    headers, table = read_table(path, EXAMPLE)
    columns: dict[str, tuple[pd.Series, str]] = {}
    faults = []
    for place, header in enumerate(headers):
        match = COLUMN.fullmatch(header)
        name, unit = (match["name"], match["unit"].strip()) if match else (header, "")
        name = name.strip().lower()
        if name not in ("strain", "force", "stress"):
            continue
        if not unit:
            faults.append(Fault(f"{path}: column {name}", f"has no unit; {EXAMPLE}"))
        if name in columns:
            faults.append(Fault(f"{path}: column {name}", "occurs twice; keep one"))
        columns[name] = table[place], unit
    loads = [name for name in ("force", "stress") if name in columns]
    if "strain" not in columns:
        faults.append(Fault(f"{path}: column strain", f"is missing; {EXAMPLE}"))
    if len(loads) != 1:
        problem = "has both; keep one" if loads else f"has neither; {EXAMPLE}"
        faults.append(Fault(f"{path}: columns force and stress", problem))
    if faults:
        raise BadInput(faults)

    (load,) = loads
    (strain_text, strain_unit), (load_text, load_unit) = columns["strain"], columns[load]
    strain, strain_faults = numbers_of(path, "strain", strain_text)
    forces, force_faults = numbers_of(path, load, load_text)
    per_row, row_faults = _newton_per_row(path, load, load_unit, width, thickness)
    place_of_strain = f"{path}: column strain"
    of_one, unit_faults = factor_of(place_of_strain, strain_unit, "1", "such as [1] or [%]")
    faults = [*strain_faults, *force_faults, *row_faults, *unit_faults]
    if not faults and (why := _strain_problem(strain)):
        faults = [Fault(place_of_strain, why)]
    if faults:
        raise BadInput(faults)
    return TensionCurve(strain * of_one, forces * per_row)


def _strain_problem(strain: Float[np.ndarray, " point"]) -> str | None:
    points, falls = len(np.unique(strain)), np.flatnonzero(np.diff(strain) < 0)
    if points < LEAST_POINTS:
        return f"has {points} points; three parameters need at least {LEAST_POINTS}"
    if strain.min() < 0:
        return f"goes down to {strain.min():g}; give tension alone, from 0 up"
    if len(falls):
        before, after = strain[falls[0] : falls[0] + 2]
        problem = f"decreases from {before:g} to {after:g} at point {falls[0] + 2}"
        return f"{problem}; give the loading curve alone"
    return None


def _newton_per_row(
    path: Path, load: str, unit: str, width: float | None, thickness: float | None
) -> tuple[float, list[Fault]]:
    place = f"{path}: column {load}"
    if load == "force":
        problem = "is for stress, but the curve holds force; leave it out"
        given = {"width": width, "thickness": thickness}.items()
        faults = [Fault(f"{name} {its:g}", problem) for name, its in given if its is not None]
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
