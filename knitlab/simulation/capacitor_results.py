"""Results of a capacitor in a finished test: capacitance in every state, and figures of merit."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from jaxtyping import Float

from knitlab.equilibrium.state import State
from knitlab.fabric.configuration import Configuration
from knitlab.fabric.pattern import CELLS_PER_PERIOD
from knitlab.measure.capacitance.capacitor import (
    Capacitances,
    Capacitor,
    capacitances,
    electrode_length,
    mean_fold,
)
from knitlab.measure.capacitance.sensor import hysteresis, sensing_range, sensor_of, strain_unfolded
from knitlab.measure.capacitance.wedge import side_by_side, wedge_capacitance
from knitlab.simulation.case import Case

SAME = 1e-5
"""Largest difference of two states that count as equal, relative to a grid cell."""


def capacitor_values(
    case: Case, reached: Sequence[State], unloaded: Sequence[State]
) -> dict[str, Any]:
    """Capacitance along the test of a case, by the names of the schema.

    Args:
        case: the case.
        reached: its converged states, the relaxed one first.
        unloaded: states of unloading, from the last strain but one.
    """
    capacitor = _capacitor(case)
    configurations = Configuration.stacked([state.configuration for state in reached])
    strain = np.array(case.applied_strain[: len(reached)])
    length = electrode_length(case.electrodes, case.mesh_shape, configurations[0])
    # For periodic fabric only one period of the electrodes is modelled, not their stated length.
    factor = capacitor.electrode_length / length if case.mesh_shape.periodic else 1.0
    found = _measured(case, configurations)
    leads = capacitor.lead_capacitance
    capacitance = factor * found.capacitance + leads
    fold = mean_fold(case.electrodes, *case.assemble(), configurations)
    unfolded = strain_unfolded(strain, fold, capacitor.unfolded)
    values: dict[str, Any] = {
        "capacitance": capacitance,
        "mutual_capacitance": factor * found.mutual,
        "capacitance_error": found.error,
        "capacitor_status": found.status.astype(float),
        "electrode_gap": found.gap,
        "electrode_length": length * factor,
        "fold_between": fold,
        "applied_strain_unfolded": unfolded,
    }
    if side_by_side(case.electrodes):
        wedge = wedge_capacitance(case.electrodes, case.mesh_shape, configurations)
        strips = factor * capacitor.permittivity * np.asarray(wedge)
        values["capacitance_wedge"] = strips + leads
    if case.unloading:
        back = np.full(len(reached), np.nan)
        back[-1:] = capacitance[-1:]
        if unloaded:
            unloading = Configuration.stacked([state.configuration for state in unloaded])
            same = slice(-2, -2 - len(unloaded), -1)
            of_fabric = _capacitance_unloading(
                case, unloading, configurations[same], found.capacitance[same]
            )
            back[same] = factor * of_fabric + leads
        values["capacitance_unloading"] = back
        values["hysteresis"] = hysteresis(capacitance, back)
    kept = sensing_range(strain, capacitance, unfolded)
    if kept.any():
        first = capacitance[kept][0]
        values["capacitance_ratio"] = capacitance / first
        values["applied_strain_opened"] = strain[kept][0]
        values["sensing_end"] = strain[kept][-1]
    sensor = sensor_of(strain[kept], capacitance[kept], capacitor.linearity, leads)
    if sensor is not None:
        values |= asdict(sensor)
    return values


def _capacitance_unloading(
    case: Case,
    unloading: Configuration,
    loading: Configuration,
    capacitance: Float[np.ndarray, " any"],
) -> Float[np.ndarray, " state"]:
    """Capacitance during unloading, of one period if periodic [pF].

    Where the fabric returns to its state at the same strain, the capacitance is not computed again.
    """
    values = capacitance.copy()
    moved = np.abs(unloading.flattened() - loading.flattened()).max(axis=1)
    different = moved > SAME * case.assemble()[1].cell_sides.min()
    if different.any():
        values[different] = _measured(case, unloading[different]).capacitance
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
