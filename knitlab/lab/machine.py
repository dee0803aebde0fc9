"""Logs of a tensile tester and an LCR meter, on one clock, resampled to the applied strains."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from knitlab.io.errors import invalid
from knitlab.io.table_file import read_columns
from knitlab.lab.description import CapacitanceTable, Description, TensileTable
from knitlab.lab.readings import rounding_step, without_bad_readings
from knitlab.lab.records import Cycle, Record, cycles, resampled
from knitlab.observables.capacitance.sensor import CapacitorStatus, hysteresis, sensor_values
from knitlab.runs.parameters import defaults

EXAMPLE = "write a header and below it rows of numbers, all as long as the header"
MIN_POINTS = 3  # rows of a log
LAST_STEP = 0.1  # of the applied strain, that the record may end before the last strain
OVERLOAD = 9e36  # meters write 9.9E37 and 9.91E37 in place of what they cannot measure
STATUS = "status"  # column that is read if there is one
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
    remarks: tuple[str, ...] = ()  # how many cycles there are, and what is left out

    def strain(self, time: Record) -> Record:
        """Applied strain at times of the machine's clock; NaN before and after its log."""
        return np.interp(time, self.time, self.extension, left=np.nan, right=np.nan) / self.length


def read_tensile(folder: Path, description: Description) -> Imports:
    """Reaction force in every cycle."""
    pulls, width = read_pulls(folder, description), description.sample.width.to("mm")
    strains, values = np.array(description.protocol.applied_strain), []
    rounding = rounding_error(pulls.force)
    for cycle in pulls.cycles:
        pulled = cycle.loaded(pulls.time)
        strain = pulls.extension[pulled] / pulls.length
        force, error, _ = resampled(strains, strain, pulls.force[pulled])
        in_cycle = {"reaction_force": force, "reaction_force_error": np.hypot(error, rounding)}
        values.append(in_cycle | {"force_per_width": force / width})
    return values, [*pulls.remarks]


def read_pulls(folder: Path, description: Description) -> Pulls:
    """Read a tensile test and check that its first cycle spans the applied strains."""
    table, protocol = description.tensile, description.protocol
    assert table is not None  # as read_description checks
    path, length = folder / table.file, description.sample.length.to("mm")
    log, triggered, remarks = _read_log(path, table)
    extension, departing = without_bad_readings("extension", log["extension"])
    log = {name: each[np.isfinite(extension)] for name, each in log.items()}
    log["force"], bad = without_bad_readings("force", log["force"], log["extension"])
    remarks += departing + bad
    pulls = cycles(log["time"], log["extension"], protocol.least_turn)[protocol.skip_cycles :]
    column = f"{path}: column {table.extension.column}"
    if not pulls:
        after = f" after {protocol.skip_cycles} cycles" if protocol.skip_cycles else ""
        raise invalid(column, f"never rises{after}; give a test in which the sample is pulled")
    pulled = pulls[0].loaded(log["time"])
    strain, force = log["extension"][pulled] / length, log["force"][pulled]
    requested, reached = protocol.applied_strain, strain.max()
    message = ""
    if reached < requested[1]:
        message = f"reaches an applied strain of only {reached:.3g} in its first cycle; check its"
        message += " unit and sign and the sample's length, or skip_cycles"
    elif strain.min() > requested[1] / 2:
        message = f"begins at an applied strain of {strain.min():.3g}; give the extension from the"
        message += " relaxed length, which is 0 there"
    # A hold begins where the noise of the extension does not show whether it is reached.
    elif reached < requested[-1] - LAST_STEP * (requested[-1] - requested[-2]):
        message = f"ends at an applied strain of {reached:.3g} in its first cycle, but strain_max"
        message += f" is {requested[-1]:g}; reduce strain_max, or give skip_cycles"
    if message:
        raise invalid(column, message)
    strain, force = strain[np.isfinite(force)], force[np.isfinite(force)]
    if force.size and np.ptp(force) > 0 and np.corrcoef(strain, force)[0, 1] < 0:
        message = "falls as the sample is pulled; give tension as positive"
        raise invalid(f"{path}: column {table.force.column}", message)
    lines = (f"{len(pulls)} cycle{'s' * (len(pulls) > 1)} of the machine", *remarks)
    return Pulls(**log, triggered=triggered, length=length, cycles=pulls, remarks=lines)


def read_capacitance(folder: Path, description: Description) -> Imports:
    """Capacitance and its measures as a strain sensor, in every cycle."""
    table, pulls = description.capacitance, read_pulls(folder, description)
    assert table is not None  # as read_description checks
    path = folder / table.file
    log, triggered, remarks = _read_log(path, table)
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
    measured, bad = _capacitance(path, table, log["capacitance"], strain)
    rounding = rounding_error(measured)

    def cycle_values(cycle: Cycle) -> Values:
        loading, unloading = (seen & phase(time) for phase in (cycle.loaded, cycle.unloaded))
        capacitance, error, _ = resampled(strains, strain[loading], measured[loading])
        finite = np.isfinite(capacitance)
        values: Values = {
            "capacitance": capacitance,
            "capacitance_error": np.hypot(error, rounding) / capacitance,
            "capacitor_status": np.where(finite, CapacitorStatus.measured, np.nan),
        }
        if cycle.end > cycle.turn:
            back = resampled(strains, strain[unloading], measured[unloading]).values
            values |= {"capacitance_unloading": back, "hysteresis": hysteresis(capacitance, back)}
        if finite.any():
            values |= {
                "capacitance_ratio": capacitance / capacitance[finite][0],
                "applied_strain_opened": strains[finite][0],
                "sensing_end": strains[finite][-1],
            }
        return values | sensor_values(strains[finite], capacitance[finite], least)

    shift = f"the meter's clock is {starts:+.3g} s from the machine's"
    lines = [*pulls.remarks, shift, *remarks, *bad]
    return [cycle_values(cycle) for cycle in pulls.cycles], lines


def rounding_error(values: Record) -> float:
    """Standard deviation of what rounding adds to readings, NaN where they are left out."""
    return rounding_step(values[np.isfinite(values)]) / math.sqrt(12)


def _capacitance(
    path: Path, table: CapacitanceTable, values: Record, strain: Record
) -> tuple[Record, list[str]]:
    """Capacitances, NaN where they are none, and lines that count what is left out."""
    read = values != 0  # a meter that has no reading writes 0
    if not read.any():
        raise invalid(f"{path}: column {table.capacitance.column}", "has no reading but 0")
    kept, lines = np.full(len(values), np.nan), list[str]()
    if not read.all():
        lines.append(f"{(~read).sum()} readings of capacitance are 0: left out")
    kept[read], bad = without_bad_readings("capacitance", values[read], strain[read], bottom=True)
    if np.nanmin(kept) < 0:
        message = f"goes down to {np.nanmin(kept):g} pF, but a capacitance is above 0"
        hint = "repeat the open correction of the meter, and measure again"
        raise invalid(f"{path}: column {table.capacitance.column}", f"{message}; {hint}")
    return kept, lines + bad


def _read_log(
    path: Path, table: TensileTable | CapacitanceTable
) -> tuple[dict[str, Record], float, list[str]]:
    """Columns in :data:`COLUMN_UNITS`, when a trigger rose, and lines on what is not read."""
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
    remarks = list(unread)
    if not good.all():
        bad = (~good).sum()
        remarks.append(f"{bad} readings that report an overload or a status are left out")
    if (np.diff(values["time"]) < 0).any():
        ascending, departing = without_bad_readings("time", values["time"])
        known = np.isfinite(ascending)
        numbers = {name: each[known] for name, each in numbers.items()}
        values = {name: each[known] for name, each in values.items()}
        remarks += departing
    time = values["time"]
    if (rows := len(time)) < MIN_POINTS:
        raise invalid(str(path), f"has {rows} rows of measurements; give at least {MIN_POINTS}")
    steps = np.diff(time)
    if (steps < 0).any():
        one, other = time[(steps < 0).argmax() :][:2]
        message = f"goes back from {one:g} s to {other:g} s; export one recording, from its start"
        raise invalid(f"{path}: column {table.time.column}", message)
    if not steps.all():
        remarks.append(f"{(steps == 0).sum()} readings have the time of the one before")
    triggered = np.nan
    if table.trigger is not None:
        levels = numbers[table.trigger.column]
        risen = levels > (levels.min() + levels.max()) / 2
        if risen[0] or not risen.any():
            message = "does not begin low and rise; give starts instead"
            raise invalid(f"{path}: column {table.trigger.column}", message)
        triggered = float(time[risen.argmax()])
    return values, triggered, remarks
