"""Records: the fields of a case as JSON stores them, and those that identify it.

Files keep two names of the first version, so that identifiers of existing cases stay valid: a
record says ``reading`` for the model options, and ``endless`` for a start from periodic fabric.
"""

from typing import Any

from knitlab.fabric.pattern import CELLS_PER_PERIOD
from knitlab.fabric.stripe import SPRING_LAWS

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
IN_EVERY_IDENTIFIER = frozenset(
    (
        *("sensitivities", "unloading", "capacitor", "stiffening_strain", "spring_curve"),
        *(*UNUSED_LEFT_OUT, *FINER_GRID, *OF_CONTACT, *OF_STEPS, *OF_TIME, *OF_CAPACITOR),
        *("cell_size", "fold_phase", "hinges", "hinge_stiffness", "garter_start", "fold_angle"),
        *("length_scale", "contact", "boundary"),
        *("tolerance", "max_iterations", "step_limit", "smallest_shift", "start", "ramp_steps"),
        *("soft_wall", "waypoint_force", "path_step", "smallest_step", "branch_limit", "drag"),
        *("integrator", "ending", "damping_ratio", "surface_density", "rest_force"),
        *("longest_time", "step_safety", "relative_tolerance", "absolute_tolerance", "snapshots"),
        *("along", "ridges", "face", "within", "width", "span", "mask"),
        *("ground", "ground_distance", "sense", "end"),
    )
)
"""Fields with a default in code that enter identifiers all the same, as far as a record has them.

Identifiers are older than the rule of :func:`identifying`; these are all fields that had a default
then. None is added, and no new field has one of these names.
"""


def stored_record(fields: dict[str, Any]) -> dict[str, Any]:
    """The record of a case.

    Fields and options that it does not use are left out.

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


def identifying(fields: dict[str, Any], differing: dict[str, Any]) -> dict[str, Any]:
    """The fields of a case by which it is identified: without what is new and has its default.

    A field that is added later thus changes the identifier of no case that has its default in code,
    which is the value of every earlier case. That default is fixed for ever: another one would give
    two results one identifier. What users get is the value in ``params/``, which may change.

    Args:
        fields: of the case, as :func:`dataclasses.asdict` gives them.
        differing: those of them that differ from their default in code.
    """
    return {
        name: _identifying(value, differing[name]) if name in differing else value
        for name, value in fields.items()
        if name in differing or name in IN_EVERY_IDENTIFIER
    }


def _identifying(value: Any, differing: Any) -> Any:
    if isinstance(value, dict):
        return identifying(value, differing)
    if isinstance(value, list | tuple):
        return [_identifying(each, its) for each, its in zip(value, differing, strict=True)]
    return value


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
