"""The capacitance of a knitted capacitor along a test, and its figures of merit as a sensor."""

from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from knitlab.io.progress import part
from knitlab.observables.capacitance import sensor
from knitlab.observables.observable import Group, curve, number, observable

if TYPE_CHECKING:
    from knitlab.model.fabric import Configuration
    from knitlab.observables.capacitance.capacitor import Capacitances
    from knitlab.observables.finished_test import FinishedTest

Curve = Float[np.ndarray, " reached"]
CAPACITORS = Group("capacitor", "Capacitors", lambda case: case.capacitor is not None)
CAPACITORS_UNLOADING = Group(
    "unloading",
    "Capacitors while unloading",
    lambda case: case.capacitor is not None and case.unloading,
)
SAME_STATE = 1e-5  # largest difference of two states that count as equal, relative to a grid cell
SENSING = (
    "over the strains from applied_strain_opened to sensing_end: measured without a gap, "
    "and unfolding not yet complete"
)


@observable(
    CAPACITORS,
    capacitor_status=curve(
        "whether the capacitance can be measured",
        description="the capacitance is missing unless this is measured",
        integer=True,
    ),
    capacitance=curve(
        "capacitance",
        "pF",
        description="between the electrodes; on periodic fabric, of electrode_length",
    ),
    mutual_capacitance=curve(
        "mutual capacitance",
        "pF",
        description=(
            "minus C12 of Maxwell's matrix, as a guarded meter measures it, without leads; "
            "missing on periodic fabric without a grounded plane, where it is the "
            "capacitance"
        ),
    ),
    capacitance_error=curve(
        "estimated error of the capacitance over itself",
        description="from two panel sizes; standard error of a measured one",
    ),
    electrode_gap=curve(
        "shortest distance between the electrodes",
        "mm",
        description="0 where they pass through each other; searched up to the size of a grid cell",
    ),
)
def capacitance(test: "FinishedTest") -> dict[str, Any]:
    """Capacitances in the states that were reached, with the capacitance of the leads."""
    found = test.capacitances
    return {
        "capacitance": with_leads(test, found.capacitance),
        "mutual_capacitance": length_factor(test) * found.mutual,
        "capacitance_error": found.error,
        "capacitor_status": found.status.astype(float),
        "electrode_gap": found.gap,
    }


def with_leads(test: "FinishedTest", modelled: Curve) -> Curve:
    """Capacitance of the stated length and of the leads, from that of the modelled length [pF]."""
    return length_factor(test) * modelled + test.case.given_capacitor.lead_capacitance


def length_factor(test: "FinishedTest") -> float:
    """Stated over modelled length of the electrodes, which differ on periodic fabric [1]."""
    if not test.case.mesh_shape.periodic:
        return 1.0
    return test.case.given_capacitor.electrode_length / modelled_length(test)


def modelled_length(test: "FinishedTest") -> float:
    """Relaxed length of the modelled electrodes: one period on periodic fabric [mm]."""
    from knitlab.observables.capacitance.capacitor import electrode_length

    return electrode_length(test.electrodes, test.case.mesh_shape, test.configurations[0])


@observable(
    CAPACITORS,
    electrode_length=number(
        "relaxed length of the electrodes", "mm", description="to which the capacitance applies"
    ),
    fold_between=curve(
        "mean fold angle at and between the electrodes",
        "rad",
        description="of the folds parallel to them",
    ),
    applied_strain_unfolded=number(
        "applied strain at which unfolding is complete",
        description=(
            "fold_between has fallen to the fraction of its relaxed value given in "
            "electrodes.toml, or to its minimum; missing if neither happens within the test"
        ),
    ),
)
def folds_at_electrodes(test: "FinishedTest") -> dict[str, Any]:
    """Length of the electrodes, the folds at them, and when these are unfolded."""
    from knitlab.observables.capacitance.capacitor import mean_fold

    fold = mean_fold(test.electrodes, *test.assembled, test.configurations)
    left = test.case.given_capacitor.unfolded
    return {
        "electrode_length": modelled_length(test) * length_factor(test),
        "fold_between": fold,
        "applied_strain_unfolded": sensor.strain_unfolded(test.applied_strain, fold, left),
    }


@observable(
    CAPACITORS,
    capacitance_wedge=curve(
        "capacitance by the wedge integral",
        "pF",
        description="a fast estimate, also for closed folds",
    ),
)
def wedge(test: "FinishedTest") -> dict[str, Any]:
    """The paper's estimate for two strips side by side; none for other electrodes."""
    from knitlab.observables.capacitance.wedge import side_by_side, wedge_capacitance

    case, capacitor = test.case, test.case.given_capacitor
    if not side_by_side(test.electrodes):
        return {}
    values = np.asarray(wedge_capacitance(test.electrodes, case.mesh_shape, test.configurations))
    scaled = length_factor(test) * capacitor.permittivity * values
    return {"capacitance_wedge": scaled + capacitor.lead_capacitance}


@observable(
    CAPACITORS,
    capacitance_ratio=curve(
        "capacitance over that at applied_strain_opened", description="C over C0"
    ),
    applied_strain_opened=number(
        "applied strain at which sensing begins",
        description="the first strain of the longest interval in which the capacitance is measured",
    ),
    sensing_end=number("applied strain at which sensing ends", description=SENSING),
    sensitivity=number(
        "sensitivity",
        "pF",
        description=f"mean |dC/de| over the central 20 % of the strain range, {SENSING}",
    ),
    gauge_factor=number(
        "gauge factor", description=f"change of capacitance over itself and over strain, {SENSING}"
    ),
    humidity_strain=number(
        "strain that reads like a change of the permittivity by 5 %",
        description=f"at the mean slope of the capacitance, {SENSING}",
    ),
    linearity=number("R² of a straight line", description=SENSING),
    working_range=number(
        "working range",
        description=f"width of the widest window in which a line has the required R², {SENSING}",
    ),
    working_start=number("applied strain at which the working range begins"),
    working_slope=number("slope of the line over the working range", "pF"),
)
def merits(test: "FinishedTest") -> dict[str, Any]:
    """Figures of merit over the strains at which the capacitor senses."""
    strain, values = test.applied_strain, capacitance(test)["capacitance"]
    capacitor = test.case.given_capacitor
    unfolded = folds_at_electrodes(test)["applied_strain_unfolded"]
    senses = sensor.sensing_range(strain, values, unfolded)
    merits: dict[str, Any] = dict(
        sensor.sensor_values(
            strain[senses], values[senses], capacitor.linearity, capacitor.lead_capacitance
        )
    )
    if senses.any():
        merits["capacitance_ratio"] = values / values[senses][0]
        merits["applied_strain_opened"] = strain[senses][0]
        merits["sensing_end"] = strain[senses][-1]
    return merits


@observable(
    CAPACITORS_UNLOADING,
    capacitance_unloading=curve("capacitance during unloading", "pF"),
    hysteresis=number(
        "hysteresis of the capacitance",
        description=(
            "largest difference between loading and unloading, over the range of the capacitance"
        ),
    ),
)
def unloading(test: "FinishedTest") -> dict[str, Any]:
    """Capacitance on the way back, from the last strain but one, and its hysteresis."""
    from knitlab.model.fabric import Configuration

    loading, unloaded = capacitance(test)["capacitance"], test.test.unloaded
    back = np.full(len(test.reached), np.nan)
    back[-1:] = loading[-1:]
    if unloaded:
        states = Configuration.stacked([state.configuration for state in unloaded])
        same = slice(-2, -2 - len(unloaded), -1)
        moved = np.abs(states.flattened() - test.configurations[same].flattened()).max(axis=1)
        # Where the fabric returns to its state at the same strain, so does the capacitance.
        different = moved > SAME_STATE * test.assembled[1].cell_sides.min()
        values = test.capacitances.capacitance[same].copy()
        if different.any():
            with part(0.5, 1.0):
                values[different] = capacitances(test, states[different]).capacitance
        back[same] = with_leads(test, values)
    return {"capacitance_unloading": back, "hysteresis": sensor.hysteresis(loading, back)}


def capacitances(test: "FinishedTest", states: "Configuration") -> "Capacitances":
    """The capacitor of a case in some states, without leads, of the modelled length."""
    from knitlab.model.pattern import CELLS_PER_PERIOD
    from knitlab.observables.capacitance.capacitor import capacitances as computed

    case = test.case
    return computed(
        test.electrodes,
        *test.assembled,
        states,
        capacitor=case.given_capacitor,
        refinement=case.options.cells_per_period // CELLS_PER_PERIOD,
    )
