"""The schema: every variable of a case and of a cube, with its dimensions, unit and meaning."""

from enum import IntEnum
from typing import TYPE_CHECKING

from knitlab.cube.capacitor_schema import CAPACITOR_VARIABLES
from knitlab.cube.design_status import Status
from knitlab.cube.variable import Variable
from knitlab.measure.capacitance.sensor import CapacitorStatus

if TYPE_CHECKING:
    import xarray as xr


DESIGN_DIMS = ("n_stripe", "n_subunit")
"""Dimensions of a cube of checkerboards; one of pure stripes has :data:`STRIPE_DIMS`."""
STRIPE_DIMS = ("knit", "n", "boundary")
CYCLE = "cycle"
"""Dimension of an experiment with several cycles."""
SOURCE = "source"
"""Coordinate that states the source of a cube."""
SIMULATION = "simulation"
"""Source of a simulated cube; that of an experiment is its name."""

COORDINATES = {
    "n_stripe": Variable(("n_stripe",), "1", "stitches across a rib stripe"),
    "n_subunit": Variable(("n_subunit",), "1", "stitches along a garter stripe"),
    "knit": Variable(("knit",), "1", "knit of a pure stripe"),
    "n": Variable(("n",), "1", "stitches across a stripe"),
    "boundary": Variable(("boundary",), "1", "clamped sample, or periodic fabric"),
    "source": Variable((), "1", "simulation, or the name of an experiment"),
    "cycle": Variable(("cycle",), "1", "cycle of a tensile test"),
    "applied_strain": Variable(
        ("applied_strain",),
        "1",
        "applied strain",
        "displacement of the driven end over the relaxed length",
    ),
    "cell_y": Variable(("cell_y",), "1", "unit cell along the warp"),
    "cell_x": Variable(("cell_x",), "1", "unit cell along the weft"),
    "stripe_parameter": Variable(
        ("stripe_parameter",),
        "1",
        "parameter of the rib or of the garter stripe",
        "rib_period is the paper's w, garter_period its h; k_s of springs, k_t, theta_0 of folds",
    ),
    "boundary_point": Variable(
        ("boundary_point",), "1", "position along a boundary, over its length from end to end"
    ),
    "node_y": Variable(("node_y",), "1", "node row along the warp"),
    "node_x": Variable(("node_x",), "1", "node column along the weft"),
    "component": Variable(("component",), "1", "component of a position"),
    "candidate": Variable(("candidate",), "1", "candidate of a design"),
    "time": Variable(("time",), "ms", "time since the flat sheet was released"),
    "snapshot": Variable(("snapshot",), "ms", "time since the flat sheet was released"),
}

_STATE = ("applied_strain",)
_PARAMETERS = ("applied_strain", "stripe_parameter")
_LOGARITHMIC = (
    "for a parameter p, p times the derivative with respect to p at fixed applied strain: the"
    " change for a relative change of p, comparable between parameters; divide by p for the"
    " derivative."
    " Missing at zero strain, and where the state is not a stable equilibrium"
)
_CELLS = ("applied_strain", "cell_y", "cell_x")
_SAMPLE = "of the simulated sample, or of the period of periodic fabric"
_POINTS = ("boundary_point",)
_TRACED = "between unit cells, nearest the middle of the relaxed fabric"
_WAVE = f"{_TRACED}; missing where it crosses a single unit cell"
_ACROSS = "across its folds, relaxed, in the unit cell nearest the middle"


_BY_GAUGE = (
    "by the cube's gauge (gauge_stitch_width and gauge_stitch_height, in mm), which changes no"
    " other variable. The default gauge is that of the paper's finished samples, about"
    " 200 mm wide on 360 needles, used for stitches before the fabric folds: absolute sizes are"
    " approximate, while ratios between designs do not depend on the gauge"
)
_KNIT_CELL = (
    f"relaxed over flat cell, times stitches across it, times size of a stitch, {_BY_GAUGE}"
)
_KNIT_WAVE = (
    "wavelength of the boundary, times the knit cell over the relaxed cell; missing"
    f" where it crosses a single unit cell; {_BY_GAUGE}"
)
_KNIT_SAMPLE = f"knit cell times unit cells; missing for periodic fabric; {_BY_GAUGE}"


def _of_cloth(long_name: str, description: str) -> Variable:
    return Variable((), "mm", long_name, description, of="cloth")


def _of_stripes(units: str, long_name: str, description: str = "") -> Variable:
    return Variable((), units, long_name, description, of="stripes")


def _of_patches(long_name: str, description: str, dims: tuple[str, ...] = ()) -> Variable:
    return Variable(dims, "mm", long_name, description, of="patches")


def _of_laboratory(
    units: str, long_name: str, description: str = "", dims: tuple[str, ...] = _STATE
) -> Variable:
    return Variable(dims, units, long_name, description, of="laboratory")


def _of_siblings(units: str, long_name: str) -> Variable:
    return Variable(_STATE, units, long_name, _SIBLINGS, of="robustness")


_SIBLINGS = (
    "over the case and its siblings that reached the strain. Siblings are imperfect sheets with"
    " each stripe parameter changed by up to 2 %; every second clamped one begins from the other"
    " start"
)
_SCATTER = "of the curve that is fitted to the records near a strain"

VARIABLES = {
    "status": Variable((), "1", "status of the design"),
    "case_id": Variable((), "1", "identifier of the case", "names its file under cases/"),
    "code": Variable((), "1", "fingerprint of the code that computed the design"),
    "periods": Variable((), "1", "stripe periods along a patch"),
    "unit_cells_y": Variable((), "1", "unit cells along the warp", _SAMPLE, of="design"),
    "unit_cells_x": Variable((), "1", "unit cells along the weft", _SAMPLE, of="design"),
    "rib_period": _of_stripes("mm", "period of the rib stripe", "the paper's w"),
    "rib_k_s": _of_stripes("N/mm", "extensional stiffness of the rib stripe"),
    "rib_theta_0": _of_stripes("rad", "rest angle of the rib stripe"),
    "rib_k_t": _of_stripes("N", "torsional stiffness of the rib stripe"),
    "garter_period": _of_stripes("mm", "period of the garter stripe", "the paper's h"),
    "garter_k_s": _of_stripes("N/mm", "extensional stiffness of the garter stripe"),
    "garter_theta_0": _of_stripes("rad", "rest angle of the garter stripe"),
    "garter_k_t": _of_stripes("N", "torsional stiffness of the garter stripe"),
    "strain_xx": Variable(_CELLS, "1", "local transverse strain"),
    "strain_yy": Variable(_CELLS, "1", "local axial strain"),
    "mean_strain_xx": Variable(
        _STATE, "1", "mean transverse strain", "mean over the central unit cells"
    ),
    "mean_strain_yy": Variable(
        _STATE, "1", "mean axial strain", "mean over the central unit cells"
    ),
    "poisson_ratio": Variable(
        _STATE,
        "1",
        "Poisson's ratio",
        "-mean_strain_xx / mean_strain_yy; undefined at zero strain, and where the central cells"
        " have taken less than a fifth of the applied strain",
    ),
    "poisson_ratio_min": Variable(
        (), "1", "lowest Poisson's ratio", "over all strains; missing unless all of them converged"
    ),
    "applied_strain_at_min": Variable((), "1", "applied strain at the lowest Poisson's ratio"),
    "knit_cell_x": _of_cloth("finished unit cell in cloth along the weft", _KNIT_CELL),
    "knit_cell_y": _of_cloth("finished unit cell in cloth along the warp", _KNIT_CELL),
    "knit_wavelength_x": _of_cloth("wavelength in cloth along the weft", _KNIT_WAVE),
    "knit_wavelength_y": _of_cloth("wavelength in cloth along the warp", _KNIT_WAVE),
    "knit_width": _of_cloth("finished width of the sample in cloth", _KNIT_SAMPLE),
    "knit_length": _of_cloth("finished length of the sample in cloth", _KNIT_SAMPLE),
    "reaction_force": Variable(
        _STATE, "N", "reaction force", "over the whole width of the sample or periodic cell"
    ),
    "poisson_ratio_sensitivity": Variable(
        _PARAMETERS,
        "1",
        "logarithmic sensitivity of Poisson's ratio to a stripe parameter",
        _LOGARITHMIC,
        of="sensitivities",
    ),
    "reaction_force_sensitivity": Variable(
        _PARAMETERS,
        "N",
        "logarithmic sensitivity of the reaction force to a stripe parameter",
        _LOGARITHMIC,
        of="sensitivities",
    ),
    "energy_stretch": Variable(_STATE, "N mm", "energy of the extensional springs"),
    "energy_fold": Variable(_STATE, "N mm", "energy of the torsional springs"),
    "energy_wall": Variable(_STATE, "N mm", "energy of the wall penalty"),
    "energy_contact": Variable(
        _STATE, "N mm", "energy of the contact", "of the barrier between plies", of="contact"
    ),
    "residual_force": Variable(_STATE, "N", "largest residual force on a free unknown"),
    "iterations": Variable(
        _STATE,
        "1",
        "steps of the solver, or time steps by dynamics",
        "retried strain steps included",
    ),
    "factorisations": Variable(
        _STATE,
        "1",
        "factorisations",
        "of the stiffness, for all of the steps",
        in_cube=False,
    ),
    "kinetic_energy_peak": Variable(
        _STATE, "N mm", "largest kinetic energy on the way to a strain", of="dynamics"
    ),
    "kinetic_energy_left": Variable(
        (),
        "1",
        "kinetic energy left when relaxed",
        "at the end of the motion, over the largest while relaxing from the flat sheet",
        of="dynamics",
    ),
    "relaxation_force_left": Variable(
        (),
        "1",
        "force left when relaxed",
        "largest on a node at the end of the motion, over that on the flat sheet",
        of="dynamics",
    ),
    "relaxation_time": Variable((), "ms", "duration of the relaxation", of="dynamics"),
    "snapped": Variable(
        _STATE,
        "1",
        "whether the fabric snapped on the way to a strain",
        "1 where the fabric left its branch of equilibria: even in the smallest strain step, more"
        " than branch_limit of the work was lost; not looked for by dynamics",
    ),
    "hinges_past_pi": Variable(
        _STATE,
        "1",
        "hinges folded past half a turn",
        "there the fabric passes through itself, which the model does not prevent",
    ),
    "self_intersections": Variable(
        _STATE,
        "1",
        "pairs of grid cells that pass through each other",
        "each cell as two triangles; in periodic fabric, each pair once per period. The model does"
        " not prevent it",
    ),
    "row_force": Variable(
        _STATE, "N", "force for one row of the sheet", "a row is one grid cell wide", of="stripe"
    ),
    "zigzag_force": Variable(
        _STATE, "N", "force of the two-dimensional zigzag", "at its energy minimum", of="stripe"
    ),
    "zigzag_residual": Variable(
        _STATE, "N", "largest residual force on a free node of the zigzag", of="stripe"
    ),
    "zigzag_iterations": Variable(_STATE, "1", "minimiser steps of the zigzag", of="stripe"),
    **CAPACITOR_VARIABLES,
    "poisson_ratio_low": _of_siblings("1", "lowest Poisson's ratio of the siblings"),
    "poisson_ratio_high": _of_siblings("1", "highest Poisson's ratio of the siblings"),
    "reaction_force_low": _of_siblings("N", "lowest reaction force of the siblings"),
    "reaction_force_high": _of_siblings("N", "highest reaction force of the siblings"),
    "siblings": Variable(
        _STATE,
        "1",
        "siblings that reached a strain",
        "without the case itself",
        of="robustness",
    ),
    "relaxed_branches": Variable(
        (),
        "1",
        "distinct relaxed energies",
        "of the unperturbed fabric, relaxed from its start and from the shapes of its siblings",
        of="robustness",
    ),
    "mean_strain_xx_error": _of_laboratory(
        "1", "standard error of the mean transverse strain", _SCATTER
    ),
    "mean_strain_yy_error": _of_laboratory(
        "1", "standard error of the mean axial strain", _SCATTER
    ),
    "poisson_ratio_error": _of_laboratory("1", "standard error of Poisson's ratio", _SCATTER),
    "reaction_force_error": _of_laboratory("N", "standard error of the reaction force", _SCATTER),
    "force_per_width": _of_laboratory(
        "N/mm", "reaction force per width", "of the relaxed sample between the clamps"
    ),
    "markers_lost": _of_laboratory("1", "markers lost", "corners of unit cells that are not seen"),
    "cells_lost": _of_laboratory(
        "1", "unit cells lost", "cells with a corner that is not seen; no mean includes them"
    ),
    "distance": Variable(
        (),
        "1",
        "distance from the targets of a design",
        "root mean square over the targets, each over its tolerance",
        of="candidate",
    ),
    "distance_worst": Variable(
        (),
        "1",
        "distance from the targets within the spread",
        "the largest distance within the spread",
        of="candidate",
    ),
    "relaxed_cell_x": Variable((), "mm", "relaxed unit cell along the weft"),
    "relaxed_cell_y": Variable((), "mm", "relaxed unit cell along the warp"),
    "flat_cell_x": Variable((), "mm", "flat unit cell along the weft"),
    "flat_cell_y": Variable((), "mm", "flat unit cell along the warp"),
    "wavelength_x": _of_patches("wavelength of the boundary along the weft", _WAVE),
    "wavelength_y": _of_patches("wavelength of the boundary along the warp", _WAVE),
    "wave_amplitude_x": _of_patches("amplitude of the boundary along the weft", _WAVE),
    "wave_amplitude_y": _of_patches("amplitude of the boundary along the warp", _WAVE),
    "boundary_x": _of_patches("offset of the boundary along the weft", _TRACED, _POINTS),
    "boundary_y": _of_patches("offset of the boundary along the warp", _TRACED, _POINTS),
    "boundary_length_x": _of_patches("length of the boundary along the weft", _TRACED),
    "boundary_length_y": _of_patches("length of the boundary along the warp", _TRACED),
    "rib_width_centre": _of_patches("width of a rib patch at its centre", _ACROSS),
    "rib_width_edge": _of_patches("width of a rib patch at its edges", _ACROSS),
    "garter_height_centre": _of_patches("height of a garter patch at its centre", _ACROSS),
    "garter_height_edge": _of_patches("height of a garter patch at its edges", _ACROSS),
    "position": Variable(
        ("applied_strain", "node_y", "node_x", "component"), "mm", "node position", in_cube=False
    ),
    "length_x": Variable(_STATE, "mm", "length of the fabric along the weft", in_cube=False),
    "length_y": Variable(_STATE, "mm", "length of the fabric along the warp", in_cube=False),
    "kinetic_energy": Variable(("time",), "N mm", "kinetic energy", in_cube=False, of="dynamics"),
    "potential_energy": Variable(("time",), "N mm", "elastic energy", in_cube=False, of="dynamics"),
    "dissipated_work": Variable(
        ("time",), "N mm", "work done against the drag", in_cube=False, of="dynamics"
    ),
    "snapshot_position": Variable(
        ("snapshot", "node_y", "node_x", "component"),
        "mm",
        "node position while relaxing",
        in_cube=False,
        of="dynamics",
    ),
    "snapshot_length_x": Variable(
        ("snapshot",),
        "mm",
        "length of periodic fabric along the weft",
        in_cube=False,
        of="dynamics",
    ),
    "snapshot_length_y": Variable(
        ("snapshot",),
        "mm",
        "length of periodic fabric along the warp",
        in_cube=False,
        of="dynamics",
    ),
}


FLAGS: dict[str, type[IntEnum]] = {"status": Status, "capacitor_status": CapacitorStatus}
"""Variables whose values are flags, and their flags."""


def described(dataset: "xr.Dataset") -> "xr.Dataset":
    """The dataset with the CF attributes of every variable and coordinate of the schema."""
    for name, variable in (COORDINATES | VARIABLES).items():
        if name in dataset.variables:
            dataset.variables[name].attrs |= variable.attributes
    for name, meanings in FLAGS.items():
        if name in dataset.variables:
            dataset.variables[name].attrs |= {
                "flag_values": [flag.value for flag in meanings],
                "flag_meanings": " ".join(flag.name for flag in meanings),
            }
    return dataset


INTEGERS = (
    "iterations",
    "factorisations",
    "hinges_past_pi",
    "self_intersections",
    "siblings",
    "relaxed_branches",
    "periods",
    "unit_cells_y",
    "unit_cells_x",
    "capacitor_status",
    "markers_lost",
    "cells_lost",
)
"""Variables that are stored as integers."""
MISSING = -1
"""Their missing value."""


def encoding(dataset: "xr.Dataset") -> dict[str, dict[str, object]]:
    """NetCDF encoding of a case or cube: compressed, with integers stored as such."""
    chosen: dict[str, dict[str, object]] = {}
    for name in dataset.data_vars:
        kind = dataset[name].dtype.kind
        chosen[str(name)] = (
            {"zlib": True, "complevel": 4} if kind in "fi" and dataset[name].ndim else {}
        )
    for name in INTEGERS:
        if name in dataset:
            chosen[name] |= {"dtype": "int32", "_FillValue": MISSING}
    return chosen
