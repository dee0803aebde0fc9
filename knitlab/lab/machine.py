"""Logs of a tensile tester and an LCR meter, on one clock, resampled to the applied strains."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from knitlab.io.errors import invalid
from knitlab.io.table_file import read_columns
from knitlab.lab.description import CapacitanceTable, Description, TensileTable
from knitlab.lab.records import Cycle, Record, cycles, resampled
from knitlab.observables.capacitance.sensor import CapacitorStatus, hysteresis, sensor_values
from knitlab.runs.parameters import defaults

EXAMPLE = "write a header and below it rows of numbers, all as long as the header"
MIN_POINTS = 3  # rows of a log
LAST_STEP = 0.1  # of the applied strain, that the record may end before the last strain
OVERLOAD = 9e36  # meters write 9.9E37 and 9.91E37 in place of what they cannot measure
STATUS = "status"  # column that is read if there is one
LEFT_OUT = "readings that report an overload or a status are left out"
COLUMN_UNITS = {"time": "s", "extension": "mm", "force": "N", "capacitance": "pF"}  # of a log

Values = dict[str, Any]  # values by variable name
Imports = tuple[list[Values], list[str]]  # values of every cycle, and a summary in lines of text


@dataclass(frozen=True)
class Pulls:
    """A tensile test by the machine's clock [s]."""

    time: Record
    extension: Record  # [mm]
    force: Record  # [N]
    triggered: float  # time at which the trigger rose, NaN without one
    length: float  # relaxed, between the clamps [mm]
    cycles: list[Cycle]
    dropped: int = 0  # records that are no measurement
    unread: tuple[str, ...] = ()  # sentences on what else its file has

    def strain(self, time: Record) -> Record:
        """Applied strain at times of the machine's clock; NaN before and after its log."""
        return np.interp(time, self.time, self.extension, left=np.nan, right=np.nan) / self.length

    @property
    def summary(self) -> str:
        """How many cycles there are, and how many records are left out."""
        count = f"{len(self.cycles)} cycle{'s' * (len(self.cycles) > 1)} of the machine"
        return count + (f"; {self.dropped} {LEFT_OUT}" if self.dropped else "")


def read_tensile(folder: Path, description: Description) -> Imports:
    """Reaction force in every cycle."""
    pulls, width = read_pulls(folder, description), description.sample.width.to("mm")
    strains, values = np.array(description.protocol.applied_strain), []
    for pulled in (cycle.loaded(pulls.time) for cycle in pulls.cycles):
        strain = pulls.extension[pulled] / pulls.length
        force, error, _ = resampled(strains, strain, pulls.force[pulled])
        in_cycle = {"reaction_force": force, "reaction_force_error": error}
        values.append(in_cycle | {"force_per_width": force / width})
    return values, [pulls.summary, *pulls.unread]


def read_pulls(folder: Path, description: Description) -> Pulls:
    """Read a tensile test and check that its first cycle spans the applied strains."""
    table, protocol = description.tensile, description.protocol
    assert table is not None  # as read_description checks
    path, length = folder / table.file, description.sample.length.to("mm")
    log, triggered, dropped, unread = _read_log(path, table)
    pulls = cycles(log["time"], log["extension"], protocol.least_turn)[protocol.skip_cycles :]
    column = f"{path}: column {table.extension.column}"
    if not pulls:
        after = f" after {protocol.skip_cycles} cycles" if protocol.skip_cycles else ""
        raise invalid(column, f"never rises{after}; give a test in which the sample is pulled")
    pulled = pulls[0].loaded(log["time"])
    strain, force = log["extension"][pulled] / length, log["force"][pulled]
    requested = protocol.applied_strain
    if strain.max() < requested[1]:
        message = f"reaches an applied strain of only {strain.max():.3g} in its first cycle"
        hint = "check its unit and sign and the sample's length, or skip_cycles"
        raise invalid(column, f"{message}; {hint}")
    if strain.min() > requested[1] / 2:
        message = f"begins at an applied strain of {strain.min():.3g}"
        hint = "give the extension from the relaxed length, which is 0 there"
        raise invalid(column, f"{message}; {hint}")
    # A hold begins where the noise of the extension does not show whether it is reached.
    if strain.max() < requested[-1] - LAST_STEP * (requested[-1] - requested[-2]):
        message = f"ends at an applied strain of {strain.max():.3g} in its first cycle, but"
        hint = "reduce strain_max, or give skip_cycles"
        raise invalid(column, f"{message} strain_max is {requested[-1]:g}; {hint}")
    if np.ptp(force) > 0 and np.corrcoef(strain, force)[0, 1] < 0:
        message = "falls as the sample is pulled; give tension as positive"
        raise invalid(f"{path}: column {table.force.column}", message)
    return Pulls(
        time=log["time"],
        extension=log["extension"],
        force=log["force"],
        triggered=triggered,
        length=length,
        cycles=pulls,
        dropped=dropped,
        unread=unread,
    )


def read_capacitance(folder: Path, description: Description) -> Imports:
    """Capacitance and its measures as a strain sensor, in every cycle."""
    table, pulls = description.capacitance, read_pulls(folder, description)
    assert table is not None  # as read_description checks
    path = folder / table.file
    log, triggered, dropped, unread = _read_log(path, table)
    lowest = log["capacitance"].min()
    if not lowest > 0:
        message = f"goes down to {lowest:g} pF, but a capacitance is above 0; correct its zero"
        raise invalid(f"{path}: column {table.capacitance.column}", message)
    # Without starts, both logs have a trigger.
    starts = table.starts.to("s") if table.starts else pulls.triggered - triggered
    time = log["time"] + starts
    first, last = pulls.time[[0, -1]]
    if not ((time >= first) & (time <= last)).any():
        message = f"runs from {time[0]:g} s to {time[-1]:g} s by the machine's clock, which ran"
        message += f" from {first:g} s to {last:g} s; correct starts or the trigger"
        raise invalid(f"{path}: column {table.time.column}", message)
    strains, strain = np.array(description.protocol.applied_strain), pulls.strain(time)
    seen, least = np.isfinite(strain), defaults().capacitor.linearity

    def cycle_values(cycle: Cycle) -> Values:
        loading, unloading = (seen & phase(time) for phase in (cycle.loaded, cycle.unloaded))
        capacitance, error, _ = resampled(strains, strain[loading], log["capacitance"][loading])
        finite = np.isfinite(capacitance)
        values: Values = {
            "capacitance": capacitance,
            "capacitance_error": error / capacitance,
            "capacitor_status": np.where(finite, CapacitorStatus.measured, np.nan),
        }
        if cycle.end > cycle.turn:
            back = resampled(strains, strain[unloading], log["capacitance"][unloading]).values
            values |= {"capacitance_unloading": back, "hysteresis": hysteresis(capacitance, back)}
        if finite.any():
            values |= {
                "capacitance_ratio": capacitance / capacitance[finite][0],
                "applied_strain_opened": strains[finite][0],
                "sensing_end": strains[finite][-1],
            }
        return values | sensor_values(strains[finite], capacitance[finite], least)

    shift = f"the meter's clock is {starts:+.3g} s from the machine's"
    remarks = [f"{dropped} {LEFT_OUT}"] if dropped else []
    summary = [pulls.summary, *pulls.unread, shift, *remarks, *unread]
    return [cycle_values(cycle) for cycle in pulls.cycles], summary


def _read_log(
    path: Path, table: TensileTable | CapacitanceTable
) -> tuple[dict[str, Record], float, int, tuple[str, ...]]:
    """Columns in :data:`COLUMN_UNITS`, when a trigger rose, how many rows are bad, and the rest."""
    names, is_meter = (*COLUMN_UNITS, "trigger", STATUS), isinstance(table, CapacitanceTable)
    columns = {name: column for name in names if (column := getattr(table, name, None))}
    units = {column.column: getattr(column, "unit", None) for column in columns.values()}
    optional = (STATUS,) if is_meter else ()
    numbers, unread = read_columns(path, units, EXAMPLE, optional, table.choice)
    good = np.all([np.abs(numbers[name]) < OVERLOAD for name in units], axis=0)
    if is_meter:
        status = columns[STATUS].column if STATUS in columns else STATUS
        good &= numbers.get(status, np.zeros(len(good))) == 0
    numbers = {name: column[good] for name, column in numbers.items()}
    values = {
        name: numbers[columns[name].column] * columns[name].factor(unit)
        for name, unit in COLUMN_UNITS.items()
        if name in columns
    }
    time = values["time"]
    if len(time) < MIN_POINTS:
        message = f"has {len(time)} rows of measurements; give at least {MIN_POINTS}"
        raise invalid(str(path), message)
    if (falls := np.flatnonzero(np.diff(time) <= 0)).size:
        (one, other), at = time[falls[0] :][:2], falls[0] + 1
        points = f"point {at} to point {at + 1} ({one:g} s to {other:g} s)"
        message = f"does not rise from {points}; sort the rows, and keep one of each time"
        raise invalid(f"{path}: column {table.time.column}", message)
    triggered = np.nan
    if table.trigger is not None:
        levels = numbers[table.trigger.column]
        risen = levels > (levels.min() + levels.max()) / 2
        if risen[0] or not risen.any():
            message = "does not begin low and rise; give starts instead"
            raise invalid(f"{path}: column {table.trigger.column}", message)
        triggered = float(time[risen.argmax()])
    return values, triggered, int((~good).sum()), unread
