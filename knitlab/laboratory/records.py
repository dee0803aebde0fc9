"""Records of machines: the logs of a tensile tester and of an LCR meter."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Float

from knitlab.io.errors import BadInput, Fault, fault
from knitlab.io.table_file import numbers_of, read_table
from knitlab.laboratory.description import CapacitanceTable, TensileTable
from knitlab.laboratory.quantities import Column, PlainColumn, conversion

EXAMPLE = "write a header and below it rows of numbers, all as long as the header"
FEWEST_POINTS = 3

Record = Float[np.ndarray, " record"]


@dataclass(frozen=True)
class TensileLog:
    """Log of a tensile tester.

    Attributes:
        time: time by its own clock, ascending [s].
        extension: extension of the sample from its relaxed length [mm].
        force: force over the whole width [N].
        triggered: time at which its trigger rose, if it has one [s].
    """

    time: Record
    extension: Record
    force: Record
    triggered: float | None


@dataclass(frozen=True)
class CapacitanceLog:
    """Log of an LCR meter.

    Attributes:
        time: time by its own clock, ascending [s].
        capacitance: capacitance [pF].
        triggered: time at which its trigger rose, if it has one [s].
    """

    time: Record
    capacitance: Record
    triggered: float | None


def read_tensile_log(path: Path, table: TensileTable) -> TensileLog:
    """Read the log of a tensile tester.

    Raises:
        BadInput: with every fault of the file.
    """
    columns = {"time": table.time, "extension": table.extension, "force": table.force}
    values, triggered = _read_log(path, columns, table.trigger)
    return TensileLog(values["time"], values["extension"], values["force"], triggered)


def read_capacitance_log(path: Path, table: CapacitanceTable) -> CapacitanceLog:
    """Read the log of an LCR meter.

    Raises:
        BadInput: with every fault of the file.
    """
    columns = {"time": table.time, "capacitance": table.capacitance}
    values, triggered = _read_log(path, columns, table.trigger)
    lowest = values["capacitance"].min()
    if not lowest > 0:
        raise fault(
            f"{path}: column {table.capacitance.column}",
            f"goes down to {lowest:g} pF, but a capacitance is above 0; correct its zero",
        )
    return CapacitanceLog(values["time"], values["capacitance"], triggered)


TARGETS = {"time": "s", "extension": "mm", "force": "N", "capacitance": "pF"}


def _read_log(
    path: Path, columns: dict[str, Column], trigger: PlainColumn | None
) -> tuple[dict[str, Record], float | None]:
    headers, rows = read_table(path, EXAMPLE)
    headers = [header.strip() for header in headers]
    requested: dict[str, Column | PlainColumn] = dict(columns)
    if trigger is not None:
        requested["trigger"] = trigger
    values, faults = {}, list[Fault]()
    for name, column in requested.items():
        found, wrong = _column(path, headers, rows, column.column)
        faults += wrong
        if found is not None:
            unit = column.unit if isinstance(column, Column) else None
            values[name] = found * (conversion(unit, TARGETS[name]) if unit else 1.0)
    if not faults and len(rows) < FEWEST_POINTS:
        faults.append(Fault(str(path), f"has {len(rows)} rows; give at least {FEWEST_POINTS}"))
    if not faults:
        faults += _time_faults(path, columns["time"].column, values["time"])
    triggered = None
    if trigger is not None and not faults:
        levels = values["trigger"]
        risen = levels > (levels.min() + levels.max()) / 2
        if risen.any() and not risen[0]:
            triggered = float(values["time"][risen.argmax()])
        else:
            problem = "does not begin low and rise; give starts instead"
            faults.append(Fault(f"{path}: column {trigger.column}", problem))
    if faults:
        raise BadInput(faults)
    return values, triggered


def _column(
    path: Path, headers: list[str], rows: pd.DataFrame, name: str
) -> tuple[Record | None, list[Fault]]:
    """A column by its header, and its faults."""
    places = [place for place, header in enumerate(headers) if header == name]
    place = f"{path}: column {name}"
    if not places:
        return None, [Fault(place, f"is missing; the file has {', '.join(headers)}")]
    if len(places) > 1:
        return None, [Fault(place, "occurs twice; keep one")]
    return numbers_of(path, name, rows[places[0]])


def _time_faults(path: Path, name: str, time: Record) -> list[Fault]:
    falls = np.flatnonzero(np.diff(time) <= 0)
    if not len(falls):
        return []
    at = falls[0]
    problem = (
        f"does not rise from point {at + 1} to point {at + 2} ({time[at]:g} s to"
        f" {time[at + 1]:g} s); sort the rows, and keep one of each time"
    )
    return [Fault(f"{path}: column {name}", problem)]
