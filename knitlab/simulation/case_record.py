"""Records: the fields of a case as JSON stores them, and as its identifier is computed from them.

Files keep two names of the first version, so that identifiers of existing cases stay valid: a
record says ``reading`` for the model options, and ``endless`` for a start from periodic fabric.
"""

from typing import Any

from knitlab.model.pattern import CELLS_PER_PERIOD
from knitlab.model.stripe import SPRING_LAWS

UNUSED_LEFT_OUT = ("robustness", "grading", "folds", "cell_patches", "plain", "solver", "dynamics")
"""Fields that a record leaves out where they are empty."""
FINER_GRID = ("cells_per_period", "ridge_fraction")
"""Model options that a record leaves out on the paper's grid."""
OF_CONTACT = ("thickness", "contact_pressure")
"""Numbers of the sheet that a record leaves out without contact."""
OF_STEPS = ("relax_steps", "step_strain")
"""Settings of the dynamics that a record leaves out unless its motion ends after steps."""
OF_TIME = ("relax_time", "strain_rate")
"""Settings of the dynamics that a record leaves out if its motion does so."""
OF_CAPACITOR = ("dielectric_thickness", "lead_capacitance")
"""Numbers of a capacitor that a record leaves out where they are 0."""
STORED_STARTS = {"periodic": "endless"}


def stored_record(fields: dict[str, Any]) -> dict[str, Any]:
    """The record of a case.

    Fields and options that it does not use are left out, so that its identifier is that of a
    version without them.

    Args:
        fields: of the case, as :func:`dataclasses.asdict` gives them; they are changed.
    """
    record = {"reading" if name == "options" else name: value for name, value in fields.items()}
    grading = record["grading"] or {"row_stripes": (), "column_stripes": ()}
    graded = (*grading["row_stripes"], *grading["column_stripes"])
    for stripe in (record["weft"], record["warp"], *graded):
        for name in SPRING_LAWS:
            if stripe[name] is None:
                del stripe[name]
    for name in UNUSED_LEFT_OUT:
        if not record[name]:
            del record[name]
    if record["reading"]["cells_per_period"] == CELLS_PER_PERIOD:
        for name in FINER_GRID:
            del record["reading"][name]
    if record["reading"]["contact"] == "none":
        del record["reading"]["contact"]
        for name in OF_CONTACT:
            del record["sheet"][name]
    if capacitor := record["capacitor"]:
        for name in OF_CAPACITOR:
            if not capacitor[name]:
                del capacitor[name]
        if capacitor["ground"] == "none":
            del capacitor["ground"], capacitor["ground_distance"]
    if "dynamics" in record:
        for name in OF_TIME if record["dynamics"]["ending"] == "steps" else OF_STEPS:
            del record["dynamics"][name]
    if "solver" in record:
        _rename_start(record["solver"], STORED_STARTS)
    return record


def fields_of_record(record: dict[str, Any]) -> dict[str, Any]:
    """The fields that a record gives, under the names of :class:`Case`."""
    fields = {"options" if name == "reading" else name: value for name, value in record.items()}
    # Cases of earlier versions that are in equilibrium say that they have no mass.
    if fields.get("mass_and_drag", 1) is None:
        del fields["mass_and_drag"]
    fields["solver"] = dict(fields["solver"]) if "solver" in fields else None
    if fields["solver"] is not None:
        _rename_start(fields["solver"], {stored: name for name, stored in STORED_STARTS.items()})
    return fields


def _rename_start(solver: dict[str, Any], names: dict[str, str]) -> None:
    if "start" in solver:
        solver["start"] = names.get(solver["start"], solver["start"])
