"""The schema: every variable of a case and of a cube, with its dimensions, unit and meaning."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
import xarray as xr

from knitlab.observables.capacitance.sensor import CapacitorStatus


class Status(IntEnum):
    """Status of a design."""

    pending = 0
    ok = 1
    not_converged = 2
    failed = 3
    excluded = 4


RUN = (Status.ok, Status.not_converged)  # statuses of designs that have results
FLAGS: dict[str, type[IntEnum]] = {"status": Status, "capacitor_status": CapacitorStatus}
"""Variables whose values are flags, and their flags."""


@dataclass(frozen=True)
class Variable:
    """One variable, as a case holds it; a cube adds the dimensions of its designs.

    ``of`` says which cases have it: all, or those by dynamics, of a pure stripe, of rib and garter
    patches, with sensitivities, electrodes, ``unloading`` of these or ``unloaded`` at all, siblings
    or contact, ``loaded`` other than along the warp, with a lattice that is ``sheared``,
    experiments, candidates of a design;
    ``derived`` ones are in no file. Those of a ``design``, of its ``stripes`` or of ``cloth`` are
    in the cube only: case files state the first two among their parameters, and the last follow
    from its gauge.
    """

    dims: tuple[str, ...]
    units: str  # in UDUNITS notation
    long_name: str  # label for the axis of a figure
    description: str = ""
    in_cube: bool = True  # rather than in case files only
    of: str = "all"

    @property
    def attributes(self) -> dict[str, str]:
        """Its CF attributes."""
        described = {"description": self.description} if self.description else {}
        return {"units": self.units, "long_name": self.long_name, **described}


def _variable(dims: tuple[str, ...], text: str, of: str = "all", in_cube: bool = True) -> Variable:
    """A variable from ``long name [unit]; description``; without a unit it is 1."""
    label, _, description = text.partition("; ")
    long_name, _, units = label.removesuffix("]").partition(" [")
    return Variable(dims, units or "1", long_name, description, in_cube, of)


DESIGN_DIMS = ("n_stripe", "n_subunit")  # dimensions of a cube of checkerboards
STRIPE_DIMS = ("knit", "n", "boundary")
STRAIN = "applied_strain"  # dimension of curves
LOAD_RATIO = "load_ratio"  # dimension of biaxial tests
CYCLE = "cycle"  # dimension of an experiment with several cycles
SAMPLE = "sample"  # dimension of settings that a workflow changes together
SOURCE = "source"  # coordinate that states the source of a cube
SIMULATION = "simulation"  # source of a simulated cube; that of an experiment is its name

COORDINATES = {
    name: _variable((name,) if name != SOURCE else (), text)
    for name, text in {
        "n_stripe": "stitches across a rib stripe",
        "n_subunit": "stitches along a garter stripe",
        "knit": "knit of a pure stripe",
        "n": "stitches across a stripe",
        "boundary": "clamped sample, or periodic fabric",
        "source": "simulation, or the name of an experiment",
        "cycle": "cycle of a tensile test",
        "applied_strain": "applied strain; displacement of the driven end over the relaxed length",
        "cell_y": "unit cell along the warp",
        "cell_x": "unit cell along the weft",
        "stripe_parameter": (
            "parameter of the rib or of the garter stripe; rib_period is the paper's w,"
            " garter_period its h; k_s of springs, k_t, theta_0 of folds"
        ),
        "boundary_point": "position along a boundary, over its length from end to end",
        "node_y": "node row along the warp",
        "node_x": "node column along the weft",
        "component": "component of a position",
        "candidate": "candidate of a design",
        "time": "time since the flat sheet was released [ms]",
        "snapshot": "time since the flat sheet was released [ms]",
    }.items()
}

_LOGARITHMIC = (
    "for a parameter p, p times the derivative with respect to p at fixed applied strain: the"
    " change for a relative change of p, comparable between parameters; divide by p for the"
    " derivative. Missing at zero strain, and where the state is not a stable equilibrium"
)
_SAMPLE = "of the simulated sample, or of the period of periodic fabric"
_TRACED = "between unit cells, nearest the middle of the relaxed fabric"
_WAVE = f"{_TRACED}; missing where it crosses a single unit cell"
_WAVES = (
    "of the boundary whose wavelength is measured; unit cells that it crosses. Wavelength and"
    " amplitude from fewer than 3 waves can be wrong by more than 5 %"
)
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
_SIBLINGS = (
    "over the case and its siblings that reached the strain. Siblings are imperfect sheets with"
    " each stripe parameter changed by up to 2 %; every second clamped one begins from the other"
    " start"
)
_SCATTER = "of the curve that is fitted to the records near a strain"
_SENSING = (
    "over the strains from applied_strain_opened to sensing_end: measured without a gap, and"
    " unfolding not yet complete"
)

_DIMS = {
    "number": (),
    "curve": ("applied_strain",),
    "derivative": ("applied_strain", "stripe_parameter"),
    "field": ("applied_strain", "cell_y", "cell_x"),
    "boundary": ("boundary_point",),
    "nodes": ("applied_strain", "node_y", "node_x", "component"),
    "motion": ("time",),
    "snapshots": ("snapshot",),
    "snapshots of nodes": ("snapshot", "node_y", "node_x", "component"),
}
_IN_CASE_FILES_ONLY = ("factorisations", "position", "length_x", "length_y", "length_shear")


def _in_table(name: str, text: str) -> Variable:
    """A variable from ``shape, of: long name [unit]; description``; without ``of`` of all cases."""
    head, _, rest = text.partition(": ")
    shape, _, of = head.partition(", ")
    in_cube = name not in _IN_CASE_FILES_ONLY and not shape.startswith(("motion", "snapshots"))
    return _variable(_DIMS[shape], rest, of or "all", in_cube)


_TABLE = {
    "status": "number: status of the design",
    "case_id": "number: identifier of the case; names its file under cases/",
    "code": "number: version of the model that computed the design",
    "periods": "number: stripe periods along a patch",
    "unit_cells_y": f"number, design: unit cells along the warp; {_SAMPLE}",
    "unit_cells_x": f"number, design: unit cells along the weft; {_SAMPLE}",
    "rib_period": "number, stripes: period of the rib stripe [mm]; the paper's w",
    "rib_k_s": "number, stripes: extensional stiffness of the rib stripe [N/mm]",
    "rib_theta_0": "number, stripes: rest angle of the rib stripe [rad]",
    "rib_k_t": "number, stripes: torsional stiffness of the rib stripe [N]",
    "garter_period": "number, stripes: period of the garter stripe [mm]; the paper's h",
    "garter_k_s": "number, stripes: extensional stiffness of the garter stripe [N/mm]",
    "garter_theta_0": "number, stripes: rest angle of the garter stripe [rad]",
    "garter_k_t": "number, stripes: torsional stiffness of the garter stripe [N]",
    "strain_xx": "field: local strain along the weft",
    "strain_yy": "field: local strain along the warp",
    "mean_strain_xx": "curve: mean strain along the weft; mean over the central unit cells",
    "mean_strain_yy": "curve: mean strain along the warp; mean over the central unit cells",
    "mean_strain_xy": "curve, loaded: mean shear strain; shift of courses along themselves over"
    " their relaxed distance, mean over the central unit cells; the courses keep their direction",
    "poisson_ratio": "curve: Poisson's ratio; -mean_strain_xx / mean_strain_yy, or the contraction"
    " across another pulled direction over the strain along it; undefined at zero strain, under"
    " shear and biaxial loads, and where the central cells have taken less than a fifth of the"
    " applied strain",
    "poisson_ratio_min": "number: lowest Poisson's ratio; at the recorded strains, without"
    " interpolation between them; missing unless all of them converged",
    "applied_strain_at_min": "number: applied strain at the lowest Poisson's ratio; one of the"
    " recorded strains",
    "knit_cell_x": f"number, cloth: finished unit cell in cloth along the weft [mm]; {_KNIT_CELL}",
    "knit_cell_y": f"number, cloth: finished unit cell in cloth along the warp [mm]; {_KNIT_CELL}",
    "knit_wavelength_x": f"number, cloth: wavelength in cloth along the weft [mm]; {_KNIT_WAVE}",
    "knit_wavelength_y": f"number, cloth: wavelength in cloth along the warp [mm]; {_KNIT_WAVE}",
    "knit_width": f"number, cloth: finished width of the sample in cloth [mm]; {_KNIT_SAMPLE}",
    "knit_length": f"number, cloth: finished length of the sample in cloth [mm]; {_KNIT_SAMPLE}",
    "load_direction": "number, loaded: direction of the pull, from the courses [degree]; the"
    " reaction force acts on the width across it, of (x, y) (x sin, y cos); 90 under shear",
    "reaction_force": "curve: reaction force [N]; over the whole width of the sample or periodic"
    " cell; along the warp if the load is biaxial",
    "reaction_force_across": "curve, biaxial: reaction force along the weft [N]; over the whole"
    " length of the sample or periodic cell",
    "reaction_force_unloading": "curve, unloaded: reaction force during unloading [N]; from the"
    " last strain back, along the warp if the load is biaxial",
    "poisson_ratio_sensitivity": "derivative, sensitivities: logarithmic sensitivity of Poisson's"
    f" ratio to a stripe parameter; {_LOGARITHMIC}",
    "reaction_force_sensitivity": "derivative, sensitivities: logarithmic sensitivity of the"
    f" reaction force to a stripe parameter [N]; {_LOGARITHMIC}",
    "energy_stretch": "curve: energy of the extensional springs [N mm]",
    "energy_fold": "curve: energy of the torsional springs [N mm]",
    "energy_wall": "curve: energy of the wall penalty [N mm]",
    "energy_contact": "curve, contact: energy of the contact [N mm]; of the barrier between plies",
    "residual_force": "curve: largest residual force on a free unknown [N]",
    "iterations": "curve: steps of the solver, or time steps by dynamics; retried strain steps"
    " included",
    "factorisations": "curve: factorisations; of the stiffness, for all of the steps",
    "kinetic_energy_peak": "curve, dynamics: largest kinetic energy on the way to a strain [N mm]",
    "kinetic_energy_left": "number, dynamics: kinetic energy left when relaxed; at the end of the"
    " motion, over the largest while relaxing from the flat sheet",
    "relaxation_force_left": "number, dynamics: force left when relaxed; largest on a node at the"
    " end of the motion, over that on the flat sheet",
    "relaxation_time": "number, dynamics: duration of the relaxation [ms]",
    "snapped": "curve: whether the fabric snapped on the way to a strain; 1 where the fabric left"
    " its branch of equilibria: even in the smallest strain step, more than branch_limit of the"
    " work was lost; not looked for by dynamics",
    "hinges_past_pi": "curve: hinges folded past half a turn; there the fabric passes through"
    " itself, which the model does not prevent",
    "self_intersections": "curve: pairs of grid cells that pass through each other; each cell as"
    " two triangles; in periodic fabric, each pair once per period. The model does not prevent it",
    "row_force": "curve, stripe: force for one row of the sheet [N]; a row is one grid cell wide",
    "zigzag_force": "curve, stripe: force of the two-dimensional zigzag [N]; at its energy minimum",
    "zigzag_residual": "curve, stripe: largest residual force on a free node of the zigzag [N]",
    "zigzag_iterations": "curve, stripe: minimiser steps of the zigzag",
    "capacitor_status": "curve, capacitor: whether the capacitance can be measured; the"
    " capacitance is missing unless this is measured",
    "capacitance": "curve, capacitor: capacitance [pF]; between the electrodes; on periodic"
    " fabric, of electrode_length",
    "capacitance_ratio": "curve, capacitor: capacitance over that at applied_strain_opened; C over"
    " C0",
    "mutual_capacitance": "curve, capacitor: mutual capacitance [pF]; minus C12 of Maxwell's"
    " matrix, as a guarded meter measures it, without leads; missing on periodic fabric without a"
    " grounded plane, where it is the capacitance",
    "capacitance_error": "curve, capacitor: estimated error of the capacitance over itself; from"
    " two panel sizes; standard error of a measured one",
    "capacitance_wedge": "curve, capacitor: capacitance by the wedge integral [pF]; a fast"
    " estimate, also for closed folds",
    "electrode_gap": "curve, capacitor: shortest distance between the electrodes [mm]; 0 where"
    " they pass through each other; searched up to the size of a grid cell",
    "electrode_length": "number, capacitor: relaxed length of the electrodes [mm]; to which the"
    " capacitance applies",
    "fold_between": "curve, capacitor: mean fold angle at and between the electrodes [rad]; of the"
    " folds parallel to them",
    "applied_strain_opened": "number, capacitor: applied strain at which sensing begins; the first"
    " strain of the longest interval in which the capacitance is measured",
    "applied_strain_unfolded": "number, capacitor: applied strain at which unfolding is complete;"
    " fold_between has fallen to the fraction of its relaxed value given in electrodes.toml, or"
    " to its minimum; missing if neither happens within the test",
    "sensing_end": f"number, capacitor: applied strain at which sensing ends; {_SENSING}",
    "sensitivity": "number, capacitor: sensitivity [pF]; mean |dC/de| over the central 20 % of the"
    f" strain range, {_SENSING}",
    "gauge_factor": "number, capacitor: gauge factor; change of capacitance over itself and over"
    f" strain, {_SENSING}",
    "humidity_strain": "number, capacitor: strain that reads like a change of the permittivity by"
    f" 5 %; at the mean slope of the capacitance, {_SENSING}",
    "linearity": f"number, capacitor: R² of a straight line; {_SENSING}",
    "working_range": "number, capacitor: working range; width of the widest strain window in which"
    f" a line has the required R², {_SENSING}",
    "working_start": "number, capacitor: applied strain at which the working range begins",
    "working_slope": "number, capacitor: slope of the line over the working range [pF]",
    "capacitance_unloading": "curve, unloading: capacitance during unloading [pF]",
    "hysteresis": "number, unloading: hysteresis of the capacitance; largest difference between"
    " loading and unloading, over the range of the capacitance",
    "poisson_ratio_low": f"curve, robustness: lowest Poisson's ratio of the siblings; {_SIBLINGS}",
    "poisson_ratio_high": "curve, robustness: highest Poisson's ratio of the siblings;"
    f" {_SIBLINGS}",
    "reaction_force_low": "curve, robustness: lowest reaction force of the siblings [N];"
    f" {_SIBLINGS}",
    "reaction_force_high": "curve, robustness: highest reaction force of the siblings [N];"
    f" {_SIBLINGS}",
    "siblings": "curve, robustness: siblings that reached a strain; without the case itself",
    "relaxed_branches": "number, robustness: distinct relaxed energies; of the unperturbed fabric,"
    " relaxed from its start and from the shapes of its siblings",
    "mean_strain_xx_error": "curve, laboratory: standard error of the mean transverse strain;"
    f" {_SCATTER}",
    "mean_strain_yy_error": "curve, laboratory: standard error of the mean axial strain;"
    f" {_SCATTER}",
    "poisson_ratio_error": f"curve, laboratory: standard error of Poisson's ratio; {_SCATTER}",
    "reaction_force_error": "curve, laboratory: standard error of the reaction force [N];"
    f" {_SCATTER}",
    "force_per_width": "curve, laboratory: reaction force per width [N/mm]; of the relaxed sample"
    " between the clamps, in millimetres of cloth",
    "force_per_width_across": "curve, derived: reaction force along the weft per length [N/mm];"
    " under biaxial loads, of the relaxed sample, in millimetres of cloth",
    "force_ratio": "curve, derived: force_per_width_across over force_per_width; under biaxial"
    " loads, beside zero strain",
    "tangent_stiffness": "curve, derived: tangent stiffness per width [N/mm]; derivative of"
    " force_per_width with respect to the applied strain",
    "stretch_energy": "curve, derived: energy to stretch, per area [N/mm]; integral of"
    " force_per_width over the applied strain, in mJ per mm² of relaxed cloth; missing under"
    " biaxial loads",
    "energy_recovery": "number, derived: energy that unloading gives back, over that of loading;"
    " less than 1 where the fabric snaps, or with friction at the folds",
    "energy_lost": "number, derived: energy lost in a cycle, per area [N/mm]; in mJ per mm² of"
    " relaxed cloth",
    "residual_strain": "number, derived: strain without force during unloading; the set that the"
    " fabric keeps; below it real cloth is slack, and here it is pushed",
    "intersections_at_min": "number, derived: pairs of grid cells that pass through each other at"
    " the lowest Poisson's ratio; where there are any, that ratio is not one of a real fabric",
    "markers_lost": "curve, laboratory: markers lost; corners of unit cells that are not seen",
    "cells_lost": "curve, laboratory: unit cells lost; cells with a corner that is not seen; no"
    " mean includes them",
    "distance": "number, candidate: distance from the targets of a design; root mean square over"
    " the targets, each over its tolerance",
    "distance_worst": "number, candidate: distance from the targets within the spread; the largest"
    " distance within the spread",
    "relaxed_cell_x": "number: relaxed unit cell along the weft [mm]",
    "relaxed_cell_y": "number: relaxed unit cell along the warp [mm]",
    "flat_cell_x": "number: flat unit cell along the weft [mm]",
    "flat_cell_y": "number: flat unit cell along the warp [mm]",
    "wavelength_x": f"number, patches: wavelength of the boundary along the weft [mm]; {_WAVE}",
    "wavelength_y": f"number, patches: wavelength of the boundary along the warp [mm]; {_WAVE}",
    "wave_amplitude_x": f"number, patches: amplitude of the boundary along the weft [mm]; {_WAVE}",
    "wave_amplitude_y": f"number, patches: amplitude of the boundary along the warp [mm]; {_WAVE}",
    "waves_x": f"number, derived: waves along the weft; {_WAVES}",
    "waves_y": f"number, derived: waves along the warp; {_WAVES}",
    "boundary_x": f"boundary, patches: offset of the boundary along the weft [mm]; {_TRACED}",
    "boundary_y": f"boundary, patches: offset of the boundary along the warp [mm]; {_TRACED}",
    "boundary_length_x": f"number, patches: length of the boundary along the weft [mm]; {_TRACED}",
    "boundary_length_y": f"number, patches: length of the boundary along the warp [mm]; {_TRACED}",
    "rib_width_centre": f"number, patches: width of a rib patch at its centre [mm]; {_ACROSS}",
    "rib_width_edge": f"number, patches: width of a rib patch at its edges [mm]; {_ACROSS}",
    "garter_height_centre": "number, patches: height of a garter patch at its centre [mm];"
    f" {_ACROSS}",
    "garter_height_edge": f"number, patches: height of a garter patch at its edges [mm]; {_ACROSS}",
    "position": "nodes: node position [mm]",
    "length_x": "curve: length of the fabric along the weft [mm]",
    "length_y": "curve: length of the fabric along the warp [mm]",
    "length_shear": "curve, sheared: shift of the upper end of the fabric along the weft [mm]",
    "kinetic_energy": "motion, dynamics: kinetic energy [N mm]",
    "potential_energy": "motion, dynamics: elastic energy [N mm]",
    "dissipated_work": "motion, dynamics: work done against the drag [N mm]",
    "snapshot_position": "snapshots of nodes, dynamics: node position while relaxing [mm]",
    "snapshot_length_x": "snapshots, dynamics: length of periodic fabric along the weft [mm]",
    "snapshot_length_y": "snapshots, dynamics: length of periodic fabric along the warp [mm]",
}
VARIABLES = {name: _in_table(name, text) for name, text in _TABLE.items()}
INTEGERS = (
    *("iterations", "factorisations", "hinges_past_pi", "self_intersections"),
    *("intersections_at_min", "waves_x", "waves_y"),
    *("siblings", "relaxed_branches", "periods", "unit_cells_y", "unit_cells_x"),
    *("capacitor_status", "markers_lost", "cells_lost"),
)
"""Variables that are stored as integers."""
MISSING = -1  # value of a missing integer


def described(dataset: xr.Dataset) -> xr.Dataset:
    """The dataset with the CF attributes of every variable and coordinate of the schema."""
    for name, variable in (COORDINATES | VARIABLES).items():
        if name in dataset.variables:
            dataset.variables[name].attrs |= variable.attributes
    for name, meanings in FLAGS.items():
        if name in dataset.variables:
            dataset.variables[name].attrs |= {
                # Of the type in which the variable is stored, as CF has it.
                "flag_values": np.array([*meanings], np.int32 if name in INTEGERS else np.int8),
                "flag_meanings": " ".join(flag.name for flag in meanings),
            }
    return dataset


SMALL = 4096  # bytes of an array up to which HDF5's index of a compressed one is larger


def encoding(dataset: xr.Dataset, compressed: bool = True) -> dict[str, dict[str, object]]:
    """NetCDF encoding of a case or cube: integers stored as such, large arrays compressed.

    Coordinates have no missing values, for which xarray would declare a number.
    """
    chosen: dict[str, dict[str, object]] = {str(name): {} for name in dataset.data_vars}
    for name, settings in chosen.items():
        if compressed and dataset[name].nbytes > SMALL and dataset[name].dtype.kind in "fi":
            settings |= {"zlib": True, "complevel": 4}
        if name in INTEGERS:
            settings |= {"dtype": "int32", "_FillValue": MISSING}
    return chosen | {str(name): {"_FillValue": None} for name in dataset.indexes}
