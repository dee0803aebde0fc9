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
OF_TIME = ("relax_time", "strain_rate")
"""Settings of the dynamics of which a record has those by which its motion ends."""
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
    """The record of a case, without the fields and options that it does not use.

    The fields are as :func:`dataclasses.asdict` gives them; they are changed.
    """
    record = {"reading" if name == "options" else name: value for name, value in fields.items()}
    reading, sheet = record["reading"], record["sheet"]
    grading = record["grading"] or {"row_stripes": (), "column_stripes": ()}
    graded = (*grading["row_stripes"], *grading["column_stripes"])
    for stripe in (record["weft"], record["warp"], *graded):
        _drop(stripe, *(name for name in SPRING_LAWS if stripe[name] is None))
    _drop(record, *(name for name in UNUSED_LEFT_OUT if not record[name]))
    if reading["cells_per_period"] == CELLS_PER_PERIOD:
        _drop(reading, *FINER_GRID)
    if reading["contact"] == "none":
        _drop(reading, "contact")
        _drop(sheet, *OF_CONTACT)
    if capacitor := record["capacitor"]:
        _drop(capacitor, *(name for name in OF_CAPACITOR if not capacitor[name]))
        if capacitor["ground"] == "none":
            _drop(capacitor, "ground", "ground_distance")
    if dynamics := record.get("dynamics"):
        _drop(dynamics, *(OF_TIME if dynamics["ending"] == "steps" else OF_STEPS))
    if "solver" in record:
        _rename_start(record["solver"], STORED_STARTS)
    return record


def _drop(table: dict[str, Any], *names: str) -> None:
    for name in names:
        del table[name]


def identifying(fields: dict[str, Any], differing: dict[str, Any]) -> dict[str, Any]:
    """The fields of a case by which it is identified: without what is new and has its default.

    A field that is added later thus changes the identifier of no case that has its default in code,
    which is the value of every earlier case. That default is fixed for ever: another one would give
    two results one identifier. What users get is the value in ``params/``, which may change. The
    fields ``differing`` are those that differ from their default in code.
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
