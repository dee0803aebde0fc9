"""Tables of numbers: CSV files of a laboratory, the units of their columns, and tension curves."""

from collections.abc import Callable, Collection, Sequence
from io import StringIO
from pathlib import Path

import numpy as np
import pandas as pd
import pint
from jaxtyping import Float

from knitlab.io.errors import BadInput, Fault, fault


def read_table(path: Path, example: str) -> tuple[list[str], pd.DataFrame]:
    """Headers, perhaps repeated, and the rows below as text, without # lines; else BadInput."""
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
    """Numbers of columns; empty entries of those ``with_gaps`` are NaN; else BadInput."""
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


def factor_of(where: str, unit: str, target: str, remedy: str) -> tuple[float, list[Fault]]:
    """Factor from one unit to another, and faults of the first; ``remedy`` names accepted units."""
    try:
        once, twice = (_in_unit(value, unit, target) for value in (1.0, 2.0))
        if not np.isclose(twice, 2 * once):  # a logarithmic unit
            raise pint.DimensionalityError(unit, target)
        return once, []
    except pint.DimensionalityError:
        return np.nan, [Fault(where, f"is in {unit}; give it in a unit {remedy}")]
    except Exception:  # pint raises many types for a text that is not a unit
        return np.nan, [Fault(where, f"has the unknown unit {unit!r}; give one {remedy}")]


def _in_unit(value: float, unit: str, target: str) -> float:
    registry = pint.get_application_registry()
    quantity = registry.Quantity(value, "dimensionless" if unit == "1" else unit)
    if target == "1" and not quantity.to_root_units().unitless:  # an angle
        raise pint.DimensionalityError(unit, target)
    return float(quantity.to("dimensionless" if target == "1" else target).magnitude)
