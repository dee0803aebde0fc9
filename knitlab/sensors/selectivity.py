"""What the reading of a knitted capacitor says of strain and bending along and across the cloth.

Nodes move with a mean deformation, and as the unit cell relaxes. Capacitances on either side of a
state give the derivative of their logarithm.
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

from knitlab.cubes.case_file import cloth_per_network
from knitlab.cubes.case_states import Described, dataset_of_states, stored_states
from knitlab.io.errors import invalid
from knitlab.model.electrodes import Capacitor
from knitlab.model.fabric import Configuration
from knitlab.observables.capacitance.maxwell import LEVELS, Surroundings, extrapolated
from knitlab.observables.capacitance.panels import panels_on
from knitlab.observables.capacitance.sensor import CapacitorStatus
from knitlab.observables.schema import STRAIN
from knitlab.sensors.electrode_set import ElectrodeSet, sensor_case
from knitlab.sensors.readings import electrode_matrices, readings
from knitlab.solvers.case import Case
from knitlab.solvers.plate_condensation import PlateSolver, deformed

CHANGES = ("strain_x", "strain_y", "curvature_x", "curvature_y")
COMPONENTS = (0, 1, 3, 4)  # those of a plate that the changes are
DIRECTIONS = ("weft", "warp")  # x, along the courses, and y, along the wales
SIDES = ("held", "free")
STEP = 1e-3  # of strain
COPIES = (2, 3)  # unit cells along bent electrodes, in rows of two lengths
VARIABLES: dict[str, Described] = {
    "capacitance": ((), "pF", "capacitance in the state"),
    "strain_gauge": (("sides", "direction"), "1", "change of ln C per strain"),
    "bending_gauge": (("sides", "direction"), "mm", "change of ln C per curvature"),
    "selectivity": (("sides",), "1", "strain gauge factor along the sensor over that across"),
    "lever": (("sides", "direction"), "mm", "strain along the sensor that reads as a curvature"),
}
"""Dimensions beside those of states, unit and meaning of the variables."""
STATUS = "sensing_status"
KNOWN = "ok"
UNSTABLE = "unstable"
Moves = Float[np.ndarray, "6 node_y node_x 3"]


def case_selectivity(
    case_file: xr.Dataset, selections: Mapping[str, Any], along: str
) -> xr.Dataset:
    """The selectivity of a periodic case, relaxed or at strains; NaN where layers touch."""
    case, capacitor = sensor_case(case_file)
    if case.options.boundary != "periodic":
        raise invalid(case.label, "is a clamped sample; simulate it with boundary = periodic")
    if capacitor.ground != "none":
        raise invalid(case.label, "has a plane, which cannot bend; simulate it with ground = none")
    solver = _Solver(case, capacitor)
    measured = case_file["capacitance"].values
    indices = list[int]()
    gauges = list[np.ndarray]()
    status = list[str]()
    for state in stored_states(case_file, selections, default=[0]):
        index = state.index
        shape = state.shape
        gauge = None
        state_status = state.status.name
        if shape is not None:
            capacitor_status = CapacitorStatus(int(case_file["capacitor_status"][index]))
            state_status = capacitor_status.name
            if capacitor_status is CapacitorStatus.measured:
                gauge = solver.gauges(shape)
                state_status = UNSTABLE if gauge is None else KNOWN
        if gauge is None:
            gauge = np.full((2, 4), np.nan)
        # Leads and their capacitance do not change.
        part = (measured[index] - capacitor.lead_capacitance) / measured[index]
        indices.append(index)
        gauges.append(part * gauge)
        status.append(state_status)
    strain_gauge, bending_gauge = np.split(np.array(gauges), 2, axis=-1)
    bending_gauge *= cloth_per_network(case_file)
    number = DIRECTIONS.index(along)
    sensed = strain_gauge[..., number]
    other = strain_gauge[..., 1 - number]
    with np.errstate(divide="ignore"):
        ratio = np.abs(sensed / other)
    values = {
        "capacitance": measured[indices],
        "strain_gauge": strain_gauge,
        "bending_gauge": bending_gauge,
        "selectivity": ratio,
        "lever": bending_gauge / sensed[..., None],
    }
    axes = {"sides": list(SIDES), "direction": list(DIRECTIONS)}
    found = dataset_of_states(case_file, indices, VARIABLES, values, axes)
    found[STATUS] = STRAIN, status, {"units": "1", "long_name": "whether it is known, or why not"}
    found.attrs |= {"title": f"selectivity of sensors along the {along}", "along": along}
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
        pair = case.electrodes
        self._electrodes = ElectrodeSet(("A", "B"), pair.strips, pair.axis, case.mesh_shape)
        self._insulation = capacitor.dielectric_thickness
        self._plates = PlateSolver(case.mesh_shape)

    def gauges(self, state: Configuration) -> Float[np.ndarray, "2 4"] | None:
        """Changes of ln C by :data:`CHANGES`, with sides held and free; None of an unstable state.

        ``free`` cloth gets longer or shorter across, and along both directions if it is bent.
        """
        plate, moves = self._plates.response(self._fabric, state)
        if np.isnan(moves).any():
            return None
        thickness = max(float(np.ptp(np.asarray(state.positions)[..., 2])), STEP)
        step = STEP / np.array([1, 1, thickness, thickness])
        held = self._held(_State(state, moves, plate.height, step))
        a = plate.stiffness[:2, :2]
        b = plate.stiffness[:2, 3:5]
        free = held.copy()
        free[:2] -= held[1::-1] * np.array([a[1, 0] / a[1, 1], a[0, 1] / a[0, 0]])
        free[2:] -= held[:2] @ np.linalg.solve(a, b)
        return np.stack([held, free])

    def _held(self, state: "_State") -> Float[np.ndarray, "4"]:
        """Central differences of ln C by each change alone."""
        bent = CHANGES.index("curvature_x") + self._electrodes.along
        periodic = [change for change in range(len(CHANGES)) if change != bent]
        changed = np.zeros(len(CHANGES))
        changed[periodic] = extrapolated(
            lambda level: np.log(self.either_side(state, periodic, level)) @ [0.5, -0.5]
        )
        # Bent electrodes are no longer periodic; a longer row less a shorter one has no ends.
        few, more = (self.either_side(state, [bent], LEVELS[0], copies) for copies in COPIES)
        changed[bent] = (np.log(more - few) @ [0.5, -0.5])[0]
        return changed / state.step

    def either_side(
        self, state: "_State", changes: Sequence[int], level: int, copies: int = 0
    ) -> Float[np.ndarray, "change 2"]:
        """Capacitance a step to either side, of endless electrodes or of so many unit cells."""
        along = self._electrodes.along
        lengths = np.asarray(state.shape.lengths)
        chart = self._electrodes.chart(level)
        shape = self._electrodes.shape
        middle = [*lengths[:2] / 2, state.height]
        corners = np.asarray(panels_on(chart, shape, state.shape)) - middle
        shifts = (np.arange(copies) - (copies - 1) / 2) * lengths[along] if copies else [0.0]
        row = np.concatenate([corners + shift * np.eye(3)[along] for shift in shifts])
        panels = []
        periods = []
        for change, sign in product(changes, (1, -1)):
            component = COMPONENTS[change]
            size = sign * state.step[change]
            still = Configuration(state.moves[component], np.zeros_like(lengths))
            moved = size * np.tile(panels_on(chart, shape, still), (len(shifts), 1, 1))
            # Corners after a mean deformation, and after moves that turn with the sheet.
            lanes = (jnp.asarray(each.transpose(1, 2, 0)) for each in (row, moved))
            panels.append(deformed(jnp.asarray(size * np.eye(6)[component]), *lanes))
            stretched = size if component == along else 0.0
            periods.append(lengths[along] * np.sqrt(1 + 2 * stretched))
        around = Surroundings(insulation=self._insulation)
        if not copies:
            around = replace(around, axis=along, period=np.array(periods))
        electrode = np.tile(chart.electrode, len(shifts))
        found = electrode_matrices(np.stack(panels).transpose(0, 3, 1, 2), electrode, 2, around)
        return readings(found, [(0, 1)], "floating").reshape(-1, 2)


@dataclass(frozen=True, eq=False)
class _State:
    """One state, how its nodes move by each component of a plate, and the steps of changes."""

    shape: Configuration
    moves: Moves
    height: float
    step: Float[np.ndarray, "4"]
