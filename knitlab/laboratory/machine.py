"""Machine curves of each cycle, on one clock, interpolated to the applied strains."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from knitlab.io.errors import fault
from knitlab.laboratory.description import (
    CapacitanceTable,
    Description,
    TensileTable,
)
from knitlab.laboratory.quantities import number
from knitlab.laboratory.records import (
    CapacitanceLog,
    TensileLog,
    read_capacitance_log,
    read_tensile_log,
)
from knitlab.measure.capacitance.sensor import CapacitorStatus, hysteresis, sensor_of
from knitlab.measure.records import Cycle, cycles, resampled

Times = Float[np.ndarray, " record"]
Values = dict[str, Any]


@dataclass(frozen=True)
class Pulls:
    """A tensile test as recorded by the machine.

    Attributes:
        log: log of the machine.
        length: relaxed length between the clamps [mm].
        cycles: cycles of the test.
    """

    log: TensileLog
    length: float
    cycles: list[Cycle]

    def strain(self, time: Times) -> Times:
        """Applied strain at times of the machine's clock; NaN before and after its log."""
        extension = np.interp(time, self.log.time, self.log.extension, left=np.nan, right=np.nan)
        return extension / self.length


def read_pulls(folder: Path, description: Description, table: TensileTable) -> Pulls:
    """Read a tensile test and check that its first cycle spans the applied strains.

    Raises:
        BadInput: if the file is at fault, or the cycle does not span them.
    """
    path, length = folder / table.file, number(description.sample.length, "mm")
    log = read_tensile_log(path, table)
    protocol = description.protocol
    found = cycles(log.time, log.extension, protocol.least_turn)[protocol.skip_cycles :]
    place = f"{path}: column {table.extension.column}"
    if not found:
        after = f" after {protocol.skip_cycles} cycles" if protocol.skip_cycles else ""
        raise fault(place, f"never rises{after}; give a test in which the sample is pulled")
    pulled = found[0].loaded(log.time)
    strain = log.extension[pulled] / length
    requested = protocol.applied_strain
    if strain.max() < requested[1]:
        raise fault(
            place,
            f"reaches an applied strain of only {strain.max():.3g} in its first cycle; check its"
            " unit and sign and the sample's length, or skip_cycles",
        )
    if strain.min() > requested[1] / 2:
        raise fault(
            place,
            f"begins at an applied strain of {strain.min():.3g}; give the extension from the"
            " relaxed length, which is 0 there",
        )
    if strain.max() < requested[-1] * (1 - 1e-9):
        raise fault(
            place,
            f"ends at an applied strain of {strain.max():.3g} in its first cycle, but strain_max is"
            f" {requested[-1]:g}; reduce strain_max, or give skip_cycles",
        )
    if np.ptp(log.force[pulled]) > 0 and np.corrcoef(strain, log.force[pulled])[0, 1] < 0:
        raise fault(
            f"{path}: column {table.force.column}",
            "falls as the sample is pulled; give tension as positive",
        )
    return Pulls(log, length, found)


def force_values(pulls: Pulls, cycle: Cycle, description: Description) -> Values:
    """Reaction force in one cycle, by variable name."""
    strains = np.array(description.protocol.applied_strain)
    pulled = cycle.loaded(pulls.log.time)
    force, error, _ = resampled(
        strains, pulls.log.extension[pulled] / pulls.length, pulls.log.force[pulled]
    )
    return {
        "reaction_force": force,
        "reaction_force_error": error,
        "force_per_width": force / number(description.sample.width, "mm"),
    }


def read_capacitance(
    folder: Path, table: CapacitanceTable, pulls: Pulls
) -> tuple[CapacitanceLog, Times]:
    """Read the log of an LCR meter, and the machine's time of each of its records.

    Raises:
        BadInput: if the file is at fault, or does not overlap with the machine's log.
    """
    path = folder / table.file
    log = read_capacitance_log(path, table)
    if table.starts is not None:
        time = log.time + number(table.starts, "s")
    elif log.triggered is not None and pulls.log.triggered is not None:
        time = log.time + (pulls.log.triggered - log.triggered)
    else:
        raise TypeError("a description without starts has triggers")
    first, last = pulls.log.time[[0, -1]]
    if not ((time >= first) & (time <= last)).any():
        raise fault(
            f"{path}: column {table.time.column}",
            f"runs from {time[0]:g} s to {time[-1]:g} s by the machine's clock, which ran from"
            f" {first:g} s to {last:g} s; correct starts or the trigger",
        )
    return log, time


def capacitance_values(
    log: CapacitanceLog,
    time: Times,
    pulls: Pulls,
    cycle: Cycle,
    strains: Float[np.ndarray, " strain"],
    least_linearity: float,
) -> Values:
    """Capacitance of one cycle from the log of an LCR meter, by variable name.

    Args:
        log: of the meter.
        time: of its records, by the machine's clock [s].
        pulls: the test.
        cycle: the cycle.
        strains: applied strains that are requested for [1].
        least_linearity: R² that the working range must have.
    """
    strain = pulls.strain(time)
    seen = np.isfinite(strain)
    loading, unloading = (seen & phase(time) for phase in (cycle.loaded, cycle.unloaded))
    capacitance, error, _ = resampled(strains, strain[loading], log.capacitance[loading])
    finite = np.isfinite(capacitance)
    values: Values = {
        "capacitance": capacitance,
        "capacitance_error": error / capacitance,
        "capacitor_status": np.where(finite, CapacitorStatus.measured, np.nan),
    }
    if cycle.end > cycle.turn:
        back = resampled(strains, strain[unloading], log.capacitance[unloading]).values
        values["capacitance_unloading"] = back
        values["hysteresis"] = hysteresis(capacitance, back)
    if finite.any():
        values |= {
            "capacitance_ratio": capacitance / capacitance[finite][0],
            "applied_strain_opened": strains[finite][0],
            "sensing_end": strains[finite][-1],
        }
    sensor = sensor_of(strains[finite], capacitance[finite], least_linearity)
    if sensor is not None:
        values |= asdict(sensor)
    return values
