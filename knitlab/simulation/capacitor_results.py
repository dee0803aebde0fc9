"""A finished test as a sensor: the capacitance of its electrodes, and what its curve is worth."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from jaxtyping import Float

from knitlab.capacitance.capacitor import (
    Capacitances,
    Capacitor,
    capacitances,
    electrode_length,
    mean_fold,
)
from knitlab.capacitance.sensor import hysteresis, sensing_range, sensor_of, strain_unfolded
from knitlab.capacitance.wedge import side_by_side, wedge_capacitance
from knitlab.model.configuration import Configuration
from knitlab.model.pattern import CELLS_PER_PERIOD
from knitlab.simulation.case import Case
from knitlab.solvers.state import State

SAME = 1e-5
"""Part of a grid cell by which two states may differ and yet be one."""


def capacitor_values(
    case: Case, reached: Sequence[State], unloaded: Sequence[State]
) -> dict[str, Any]:
    """Capacitance along the test of a case, under the registry's names.

    Args:
        case: the case.
        reached: its converged states, the relaxed one first.
        unloaded: those on the way back, from the last strain but one.
    """
    capacitor = _capacitor(case)
    configurations = Configuration.stacked([state.configuration for state in reached])
    strain = np.array(case.applied_strain[: len(reached)])
    length = electrode_length(case.electrodes, case.mesh_shape, configurations[0])
    # Of periodic fabric one period is modelled, in place of electrodes of the stated length.
    factor = capacitor.electrode_length / length if case.mesh_shape.periodic else 1.0
    found = _measured(case, configurations)
    capacitance = factor * found.capacitance
    fold = mean_fold(case.electrodes, *case.assemble(), configurations)
    unfolded = strain_unfolded(strain, fold, capacitor.unfolded)
    values: dict[str, Any] = {
        "capacitance": capacitance,
        "mutual_capacitance": found.mutual,
        "capacitance_error": found.error,
        "capacitor_status": found.status.astype(float),
        "electrode_gap": found.gap,
        "electrode_length": length * factor,
        "fold_between": fold,
        "applied_strain_unfolded": unfolded,
    }
    if side_by_side(case.electrodes):
        wedge = wedge_capacitance(case.electrodes, case.mesh_shape, configurations)
        values["capacitance_wedge"] = factor * capacitor.permittivity * np.asarray(wedge)
    if case.unloading:
        back = np.full(len(reached), np.nan)
        back[-1:] = capacitance[-1:]
        if unloaded:
            unloading = Configuration.stacked([state.configuration for state in unloaded])
            same = slice(-2, -2 - len(unloaded), -1)
            back[same] = factor * _capacitance_unloading(
                case, unloading, configurations[same], found.capacitance[same]
            )
        values["capacitance_unloading"] = back
        values["hysteresis"] = hysteresis(capacitance, back)
    kept = sensing_range(strain, capacitance, unfolded)
    if kept.any():
        first = capacitance[kept][0]
        values["capacitance_ratio"] = capacitance / first
        values["applied_strain_opened"] = strain[kept][0]
        values["sensing_end"] = strain[kept][-1]
    sensor = sensor_of(strain[kept], capacitance[kept], capacitor.linearity)
    if sensor is not None:
        values |= asdict(sensor)
    return values


def _capacitance_unloading(
    case: Case,
    unloading: Configuration,
    loading: Configuration,
    capacitance: Float[np.ndarray, " any"],
) -> Float[np.ndarray, " state"]:
    """Capacitance on the way back, of one period if periodic [pF].

    Where the fabric comes back to what it was at the same strain, its capacitance is what it was.
    """
    values = capacitance.copy()
    moved = np.abs(unloading.flattened() - loading.flattened()).max(axis=1)
    apart = moved > SAME * case.assemble()[1].cell_sides.min()
    if apart.any():
        values[apart] = _measured(case, unloading[apart]).capacitance
    return values


def _measured(case: Case, configurations: Configuration) -> Capacitances:
    refinement = case.options.cells_per_period // CELLS_PER_PERIOD
    return capacitances(
        case.electrodes, *case.assemble(), configurations, _capacitor(case), refinement
    )


def _capacitor(case: Case) -> Capacitor:
    if case.capacitor is None:
        raise TypeError(f"case {case.case_id} has no capacitor")
    return case.capacitor
