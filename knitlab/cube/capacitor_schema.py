"""Variables of a fabric with electrodes."""

from knitlab.cube.variable import Variable

_STATE = ("applied_strain",)
_ONCE: tuple[str, ...] = ()
_RANGE = (
    "over the strains from applied_strain_opened to sensing_end: measured without a gap, and"
    " unfolding not yet complete"
)


def _of_capacitor(
    units: str, long_name: str, description: str = "", dims: tuple[str, ...] = _STATE
) -> Variable:
    return Variable(dims, units, long_name, description, of="capacitor")


CAPACITOR_VARIABLES = {
    "capacitor_status": _of_capacitor(
        "1",
        "whether the capacitance can be measured",
        "the capacitance is missing unless this is measured",
    ),
    "capacitance": _of_capacitor(
        "pF", "capacitance", "between the electrodes; on periodic fabric, of electrode_length"
    ),
    "capacitance_ratio": _of_capacitor(
        "1", "capacitance over that at applied_strain_opened", "C over C0"
    ),
    "mutual_capacitance": _of_capacitor(
        "pF",
        "mutual capacitance",
        "minus C12 of Maxwell's matrix, as a guarded meter measures it, without leads; missing on"
        " periodic fabric without a grounded plane, where it is the capacitance",
    ),
    "capacitance_error": _of_capacitor(
        "1",
        "estimated error of the capacitance over itself",
        "from two panel sizes; standard error of a measured one",
    ),
    "capacitance_wedge": _of_capacitor(
        "pF", "capacitance by the wedge integral", "a fast estimate, also for closed folds"
    ),
    "electrode_gap": _of_capacitor(
        "mm",
        "shortest distance between the electrodes",
        "0 where they pass through each other; searched up to the size of a grid cell",
    ),
    "electrode_length": _of_capacitor(
        "mm", "relaxed length of the electrodes", "to which the capacitance applies", _ONCE
    ),
    "fold_between": _of_capacitor(
        "rad", "mean fold angle at and between the electrodes", "of the folds parallel to them"
    ),
    "applied_strain_opened": _of_capacitor(
        "1",
        "applied strain at which sensing begins",
        "the first strain of the longest interval in which the capacitance is measured",
        _ONCE,
    ),
    "applied_strain_unfolded": _of_capacitor(
        "1",
        "applied strain at which unfolding is complete",
        "fold_between has fallen to the fraction of its relaxed value given in electrodes.toml, or"
        " to its minimum; missing if neither happens within the test",
        _ONCE,
    ),
    "sensing_end": _of_capacitor("1", "applied strain at which sensing ends", _RANGE, _ONCE),
    "sensitivity": _of_capacitor(
        "pF", "sensitivity", f"mean |dC/de| over the central 20 % of the strain range, {_RANGE}", ()
    ),
    "gauge_factor": _of_capacitor(
        "1", "gauge factor", f"change of capacitance over itself and over strain, {_RANGE}", _ONCE
    ),
    "humidity_strain": _of_capacitor(
        "1",
        "strain that reads like a change of the permittivity by 5 %",
        f"at the mean slope of the capacitance, {_RANGE}",
        _ONCE,
    ),
    "linearity": _of_capacitor("1", "R² of a straight line", _RANGE, _ONCE),
    "working_range": _of_capacitor(
        "1",
        "working range",
        f"width of the widest strain window in which a line has the required R², {_RANGE}",
        _ONCE,
    ),
    "working_start": _of_capacitor("1", "applied strain at which the working range begins", "", ()),
    "working_slope": _of_capacitor("pF", "slope of the line over the working range", "", _ONCE),
    "capacitance_unloading": Variable(_STATE, "pF", "capacitance during unloading", of="unloading"),
    "hysteresis": Variable(
        (),
        "1",
        "hysteresis of the capacitance",
        "largest difference between loading and unloading, over the range of the capacitance",
        of="unloading",
    ),
}
