"""Results of a capacitor in a finished test: capacitance in every state, and figures of merit."""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from knitlab.equilibrium.state import State
from knitlab.fabric.fabric import Configuration
from knitlab.fabric.pattern import CELLS_PER_PERIOD
from knitlab.measure.capacitance import capacitor as model
from knitlab.measure.capacitance import sensor
from knitlab.measure.capacitance.wedge import side_by_side, wedge_capacitance
from knitlab.simulation.case import Case

SAME = 1e-5
"""Largest difference of two states that count as equal, relative to a grid cell."""


def capacitor_values(
    case: Case, reached: Sequence[State], unloaded: Sequence[State]
) -> dict[str, Any]:
    """Capacitance along the test of a case, by the names of the schema.

    Converged states are those of loading, the relaxed one first, and of unloading from the last
    strain but one.
    """
    capacitor, electrodes = case.capacitor_given, case.electrodes
    configurations = Configuration.stacked([state.configuration for state in reached])
    capacitances = partial(
        model.capacitances,
        electrodes,
        *case.assemble(),
        capacitor=capacitor,
        refinement=case.options.cells_per_period // CELLS_PER_PERIOD,
    )
    strain = np.array(case.applied_strain[: len(reached)])
    length = model.electrode_length(electrodes, case.mesh_shape, configurations[0])
    # For periodic fabric only one period of the electrodes is modelled, not their stated length.
    factor = capacitor.electrode_length / length if case.mesh_shape.periodic else 1.0
    of_fabric = capacitances(configurations)
    leads = capacitor.lead_capacitance
    capacitance = factor * of_fabric.capacitance + leads
    fold = model.mean_fold(electrodes, *case.assemble(), configurations)
    unfolded = sensor.strain_unfolded(strain, fold, capacitor.unfolded)
    values: dict[str, Any] = {
        "capacitance": capacitance,
        "mutual_capacitance": factor * of_fabric.mutual,
        "capacitance_error": of_fabric.error,
        "capacitor_status": of_fabric.status.astype(float),
        "electrode_gap": of_fabric.gap,
        "electrode_length": length * factor,
        "fold_between": fold,
        "applied_strain_unfolded": unfolded,
    }
    if side_by_side(electrodes):
        wedge = np.asarray(wedge_capacitance(electrodes, case.mesh_shape, configurations))
        values["capacitance_wedge"] = factor * capacitor.permittivity * wedge + leads
    if case.unloading:
        back = np.full(len(reached), np.nan)
        back[-1:] = capacitance[-1:]
        if unloaded:
            unloading = Configuration.stacked([state.configuration for state in unloaded])
            same = slice(-2, -2 - len(unloaded), -1)
            moved = np.abs(unloading.flattened() - configurations[same].flattened()).max(axis=1)
            # Where the fabric returns to its state at the same strain, so does the capacitance.
            different = moved > SAME * case.assemble()[1].cell_sides.min()
            values_unloading = of_fabric.capacitance[same].copy()
            if different.any():
                values_unloading[different] = capacitances(unloading[different]).capacitance
            back[same] = factor * values_unloading + leads
        values["capacitance_unloading"] = back
        values["hysteresis"] = sensor.hysteresis(capacitance, back)
    kept = sensor.sensing_range(strain, capacitance, unfolded)
    if kept.any():
        values["capacitance_ratio"] = capacitance / capacitance[kept][0]
        values["applied_strain_opened"] = strain[kept][0]
        values["sensing_end"] = strain[kept][-1]
    merits = sensor.sensor_values(strain[kept], capacitance[kept], capacitor.linearity, leads)
    return values | merits
