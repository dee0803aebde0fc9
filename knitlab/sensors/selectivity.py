"""What the reading of a knitted capacitor says of strain and bending along and across the cloth.

A small strain or curvature of periodic fabric moves its nodes as ``plate.condensation`` has it:
with the mean deformation, and besides as the unit cell relaxes. Capacitances of the shapes on
either side of a state give the derivative of the logarithm of the capacitance.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import jax.numpy as jnp
import numpy as np
import pandas as pd
import xarray as xr
from jaxtyping import Float

from knitlab.cubes.case_file import LENGTH_FACTOR, length_unit, network_configurations
from knitlab.cubes.chosen_case import has_shape, plies_touch
from knitlab.cubes.selection import chosen_indices
from knitlab.io.errors import invalid
from knitlab.model.electrodes import Capacitor
from knitlab.model.fabric import Configuration
from knitlab.observables.capacitance.panels import panels_on
from knitlab.observables.capacitance.sensor import CapacitorStatus
from knitlab.observables.schema import STRAIN
from knitlab.sensors.electrode_set import ElectrodeSet, sensor_case
from knitlab.sensors.maxwell import GAIN, LEVELS, Around, matrices_of, readings
from knitlab.solvers.case import Case
from knitlab.solvers.plate_condensation import PlateSolver, PlateStatus, deformed

CHANGES = ("strain_x", "strain_y", "curvature_x", "curvature_y")
COMPONENTS = (0, 1, 3, 4)  # those of a plate that the changes are
DIRECTIONS = ("weft", "warp")  # x, along the courses, and y, along the wales
SIDES = ("held", "free")
STEP = 1e-3  # of strain
COPIES = (2, 3)  # unit cells along bent electrodes, in rows of two lengths
VARIABLES: dict[str, tuple[tuple[str, ...], str, str]] = {
    "capacitance": ((), "pF", "capacitance in the state"),
    "strain_gauge": (("sides", "direction"), "1", "change of ln C per strain"),
    "bending_gauge": (("sides", "direction"), "mm", "change of ln C per curvature"),
    "selectivity": (("sides",), "1", "strain gauge factor along the sensor over that across"),
    "lever": (("sides", "direction"), "mm", "strain along the sensor that reads as a curvature"),
}
"""Dimensions beside those of states, unit and meaning of the variables."""
STATUS = "sensing_status"
KNOWN, UNSTABLE = "ok", "unstable"
Moves = Float[np.ndarray, "6 node_y node_x 3"]


def selectivity_of_case(
    case_file: xr.Dataset, selections: Mapping[str, Any], along: str
) -> xr.Dataset:
    """The selectivity of a periodic case with electrodes, relaxed or at selected strains.

    Lengths are those of the case. Where its plies touch nothing is known, as bending leaves contact
    out. InputError if it is clamped, has no electrodes, or a grounded plane.
    """
    case, capacitor = sensor_case(case_file)
    for wrong, message, hint in (
        (case.options.boundary != "periodic", "is a clamped sample", "boundary = periodic"),
        (capacitor.ground != "none", "has a plane that does not bend with it", "ground = none"),
    ):
        if wrong:
            raise invalid(case.label, f"{message}; simulate it with {hint}")
    chosen = chosen_indices({STRAIN: case_file[STRAIN].values}, selections).get(STRAIN, [0])
    solver, factor = _Solver(case, capacitor), float(case_file.attrs.get(LENGTH_FACTOR, 1.0))
    gauges, status = [], list[str]()
    reached, touching = has_shape(case_file), plies_touch(case_file)
    measured = case_file["capacitance"].values[chosen]
    for index, whole in zip(chosen, measured, strict=True):
        gauges.append(np.full((2, 4), np.nan))
        if not reached[index]:
            status.append("not_converged")
            continue
        if touching[index]:
            status.append(PlateStatus.plies_touch.name)
            continue
        status.append(CapacitorStatus(int(case_file["capacitor_status"][index])).name)
        if status[-1] == CapacitorStatus.measured.name:
            state = network_configurations(case_file.isel({STRAIN: [index]}))[0]
            # Leads and their capacitance do not change.
            part = (whole - capacitor.lead_capacitance) / whole
            known = solver.gauges(state)
            status[-1] = UNSTABLE if known is None else KNOWN
            gauges[-1] = gauges[-1] if known is None else part * known
    by_strain, by_curvature = np.split(np.array(gauges), 2, axis=-1)
    by_curvature *= factor
    number = DIRECTIONS.index(along)
    sensed, other = by_strain[..., number], by_strain[..., 1 - number]
    with np.errstate(divide="ignore"):
        ratio = np.abs(sensed / other)
    values = measured, by_strain, by_curvature, ratio, by_curvature / sensed[..., None]
    about = {"units": "1", "long_name": "whether it is known, or why not"}
    found = xr.Dataset(
        {STATUS: (STRAIN, status, about)},
        {
            STRAIN: case_file[STRAIN].variable[chosen],
            "sides": list(SIDES),
            "direction": list(DIRECTIONS),
        },
        {
            "title": f"selectivity of sensors along the {along}",
            "along": along,
            "length_unit": length_unit(case_file),
        },
    )
    for (name, (dims, units, meaning)), value in zip(VARIABLES.items(), values, strict=True):
        found[name] = (STRAIN, *dims), value, {"units": units, "long_name": meaning}
    return found


def selectivity_table(selectivity: xr.Dataset, sides: str) -> pd.DataFrame:
    """One row for each state: gauge factors along the sensor, across it, and of bending."""
    along = selectivity.attrs["along"]
    across = DIRECTIONS[1 - DIRECTIONS.index(along)]
    held = selectivity.sel(sides=sides, drop=True)
    columns = {"capacitance": held["capacitance"]}
    for direction, word in ((along, "along"), (across, "across")):
        columns[word] = held["strain_gauge"].sel(direction=direction, drop=True)
    columns["selectivity"] = held["selectivity"]
    for direction, word in ((along, "along"), (across, "across")):
        columns[f"bent_{word}"] = held["bending_gauge"].sel(direction=direction, drop=True)
    columns["status"] = held[STATUS]
    table = xr.Dataset(columns).to_dataframe(dim_order=list(held[STATUS].dims)).reset_index()
    return table[table["status"] != ""].reset_index(drop=True)


class _Solver:
    """Gauge factors of states of one periodic case, with lengths of the network."""

    def __init__(self, case: Case, capacitor: Capacitor) -> None:
        _, self._fabric = case.assemble()
        electrodes = case.electrodes
        self._set = ElectrodeSet(("A", "B"), electrodes.strips, electrodes.axis, case.mesh_shape)
        self._apart = capacitor.dielectric_thickness
        self._plates = PlateSolver(case.mesh_shape)

    def gauges(self, state: Configuration) -> Float[np.ndarray, "2 4"] | None:
        """Changes of ln C by :data:`CHANGES`, held and free; None of an unstable state.

        ``held`` has all other strains and curvatures zero. ``free`` cloth, flat or of the stated
        curvature, gets longer or shorter along the other direction, and along both if it is bent.
        """
        plate, moves = self._plates.response(self._fabric, state)
        if np.isnan(moves).any():
            return None
        held = self._held(state, moves, plate.height)
        a, b = plate.stiffness[:2, :2], plate.stiffness[:2, 3:5]
        free = held.copy()
        free[:2] -= held[1::-1] * np.array([a[1, 0] / a[1, 1], a[0, 1] / a[0, 0]])
        free[2:] -= held[:2] @ np.linalg.solve(a, b)
        return np.stack([held, free])

    def _held(self, state: Configuration, moves: Moves, height: float) -> Float[np.ndarray, "4"]:
        """Central differences of ln C by each change alone."""
        thickness = max(float(np.ptp(np.asarray(state.positions)[..., 2])), STEP)
        step = STEP / np.array([1, 1, thickness, thickness])
        bent = CHANGES.index("curvature_x") + self._set.along
        periodic = [change for change in range(len(CHANGES)) if change != bent]
        shape = _State(state, moves, height, step)
        coarse, fine = (
            np.log(self._sides(shape, periodic, level)) @ [0.5, -0.5] for level in LEVELS
        )
        # Bent electrodes are no longer periodic; a longer row less a shorter one has no ends.
        few, more = (self._sides(shape, [bent], LEVELS[0], copies) for copies in COPIES)
        changed = np.zeros(len(CHANGES))
        changed[periodic] = fine + GAIN * (fine - coarse)
        changed[bent] = (np.log(more - few) @ [0.5, -0.5])[0]
        return changed / step

    def _sides(
        self, of: "_State", changes: Sequence[int], level: int, copies: int = 0
    ) -> Float[np.ndarray, "change 2"]:
        """Capacitance a step to either side, of endless electrodes or of so many unit cells."""
        along, lengths = self._set.along, np.asarray(of.state.lengths)
        chart, shape = self._set.charts(level), self._set.shape
        corners = np.asarray(panels_on(chart, shape, of.state)) - [*lengths[:2] / 2, of.height]
        shifts = (np.arange(copies) - (copies - 1) / 2) * lengths[along] if copies else [0.0]
        row = np.concatenate([corners + shift * np.eye(3)[along] for shift in shifts])
        panels, periods = [], []
        for change, sign in product(changes, (1, -1)):
            component, size = COMPONENTS[change], sign * of.step[change]
            still = Configuration(of.moves[component], np.zeros_like(lengths))
            moved = size * np.tile(panels_on(chart, shape, still), (len(shifts), 1, 1))
            # Corners after a mean deformation, and after moves that turn with the sheet.
            lanes = (jnp.asarray(each.transpose(1, 2, 0)) for each in (row, moved))
            panels.append(deformed(jnp.asarray(size * np.eye(6)[component]), *lanes))
            stretched = size if component == along else 0.0
            periods.append(lengths[along] * np.sqrt(1 + 2 * stretched))
        around = Around(apart=self._apart)
        if not copies:
            around = replace(around, axis=along, period=np.array(periods))
        number = np.tile(chart.electrode, len(shifts))
        found = matrices_of(np.stack(panels).transpose(0, 3, 1, 2), number, 2, around)
        return readings(found, [(0, 1)], "floating").reshape(-1, 2)


@dataclass(frozen=True, eq=False)
class _State:
    """One state, how its nodes move by each component of a plate, and the steps of changes."""

    state: Configuration
    moves: Moves
    height: float
    step: Float[np.ndarray, "4"]
