"""Measurement of a finished test: all variables of a case, as a labelled dataset."""

from collections.abc import Iterable, Sequence
from functools import partial
from typing import Any

import numpy as np
import xarray as xr

from knitlab.io.provenance import MODEL
from knitlab.model.fabric import Configuration
from knitlab.model.pattern import CELLS_PER_PERIOD
from knitlab.model.surfaces import self_intersections
from knitlab.observables.capacitance import capacitor as model
from knitlab.observables.capacitance import sensor
from knitlab.observables.capacitance.wedge import side_by_side, wedge_capacitance
from knitlab.observables.folds import hinges_past_pi, widths_across_folds
from knitlab.observables.schema import VARIABLES, Status, Variable, described
from knitlab.observables.sensitivity import STRIPE_PARAMETERS, sensitivities
from knitlab.observables.unit_cells import (
    central_mean,
    deformation_gradient,
    lattice_vectors,
    local_strain,
    lowest_poisson_ratio,
    mean_cell_size,
    poisson_ratio_of_test,
    strains_in_direction,
    unit_cell_corners,
)
from knitlab.observables.wavelength import POINTS, Direction, boundary_wave
from knitlab.solvers.case import Case
from knitlab.solvers.equilibrium.loading import X, Y
from knitlab.solvers.equilibrium.state import History, State, TensileTest
from knitlab.solvers.siblings import SiblingTest, spread
from knitlab.solvers.zigzag_tension import ChainState

LEAST_FOLLOWED = 0.2
"""Axial strain of the central cells over the applied strain below which they have no Poisson's
ratio: a sample that is pulled before it is at rest still contracts, and both strains are near 0."""
SAME_STATE = 1e-5  # largest difference of two states that count as equal, relative to a grid cell
FIXED_COORDINATES: dict[str, list[Any]] = {
    "stripe_parameter": list(STRIPE_PARAMETERS),
    "boundary_point": np.linspace(0, 1, POINTS).tolist(),
}
"""Labels along dimensions that are the same for every case."""


def fixed_coordinates(dims: Iterable[str]) -> dict[str, list[Any]]:
    """The :data:`FIXED_COORDINATES` of some dimensions."""
    return {name: labels for name, labels in FIXED_COORDINATES.items() if name in dims}


def variables_of(case: Case) -> dict[str, Variable]:
    """The variables of the schema that a case has."""
    electrodes = case.capacitor is not None
    has = {
        "all": True,
        "stripe": case.pure,
        "patches": not case.pure,
        "dynamics": case.relaxes_by_dynamics,
        "sensitivities": case.sensitivities,
        "capacitor": electrodes,
        "unloading": electrodes and case.unloading,
        "unloaded": case.unloading,
        "robustness": case.robustness > 0,
        "contact": case.options.contact != "none",
        "loaded": case.load.kind != "warp",
        "biaxial": case.load.kind == "biaxial",
        "sheared": case.load.shears and case.mesh_shape.periodic,
    }
    return {name: variable for name, variable in VARIABLES.items() if has.get(variable.of)}


def measured(
    case: Case,
    test: TensileTest,
    chain: Sequence[ChainState] = (),
    siblings: Sequence[SiblingTest] = (),
) -> xr.Dataset:
    """Dataset of a case: its variables of the schema at every strain of the protocol.

    Values are missing at strains that did not converge or were not tried; ``residual_force`` and
    ``iterations`` have values at every strain that was tried. Variables of the whole test are
    missing unless all strains converged. A pure stripe has a two-dimensional zigzag, ``chain``, at
    every strain.
    """
    reached = [state for state in test.states if state.converged]
    complete = len(reached) == len(case.applied_strain)
    values: dict[str, Any] = {
        "status": np.int8(Status.ok if complete else Status.not_converged),
        "case_id": case.case_id,
        "code": MODEL,
        "periods": case.periods,
        **dict(zip(("flat_cell_x", "flat_cell_y"), case.flat_cell, strict=True)),
        "residual_force": [state.residual for state in test.states],
        "iterations": [float(state.iterations) for state in test.states],
        "factorisations": [float(state.factorisations) for state in test.states],
        "snapped": [float(state.snapped) for state in reached],
    }
    if test.loading is not None:
        values |= _results(case, test)
        if case.pure:
            values["row_force"] = values["reaction_force"] / case.mesh_shape.cells_x
        values |= _shapes(case, reached)
        if not case.pure:
            values |= _relaxed_patches(case, (test.relaxed or reached[0]).configuration)
        if case.sensitivities:
            values |= sensitivities(case, reached)
        if case.capacitor is not None:
            values |= _capacitor_values(case, case.capacitor, reached, test.unloaded)
        if case.robustness:
            results = [_results(sibling.case, sibling.test) for sibling in siblings]
            energies = [sibling.branch_energy for sibling in siblings]
            values |= spread(values, results, [float(reached[0].energy.total), *energies])
    if case.relaxes_by_dynamics:
        values["kinetic_energy_peak"] = [state.kinetic_peak for state in test.states]
    if test.history is not None:
        values |= _history(case, test.history)
    if chain:
        values |= {
            "zigzag_force": [state.force if state.converged else np.nan for state in chain],
            "zigzag_residual": [state.residual for state in chain],
            "zigzag_iterations": [float(state.iterations) for state in chain],
        }
    return described(_dataset(case, values))


def _results(case: Case, test: TensileTest) -> dict[str, Any]:
    """Strains, Poisson's ratio and force of a test; empty if its fabric did not relax."""
    if test.loading is None:
        return {}
    reached = [state for state in test.states if state.converged]
    relaxed = (test.relaxed or reached[0]).configuration
    configurations = [relaxed, *(state.configuration for state in reached)]
    corners = unit_cell_corners(
        case.mesh_shape, case.cell_grid, Configuration.stacked(configurations)
    )
    at_rest, corners = corners[0], corners[1:]
    strain_xx, strain_yy = local_strain(at_rest, corners)
    mean_xx, mean_yy = (np.asarray(central_mean(each)) for each in (strain_xx, strain_yy))
    values: dict[str, Any] = {}
    across, along = mean_xx, mean_yy
    if case.load.kind != "warp":
        gradient = deformation_gradient(lattice_vectors(at_rest), lattice_vectors(corners))
        values["mean_strain_xy"] = np.asarray(central_mean(gradient[..., 0, 1]))
        values["load_direction"] = case.load.angle_of_pull
        pulled = strains_in_direction(gradient, case.load.angle_of_pull)
        across, along = map(np.asarray, pulled)
    if case.load.kind == "biaxial":
        values["reaction_force_across"] = np.array(
            [test.loading.force_along(X, state.gradient) for state in reached]
        )
    ratio = poisson_ratio_of_test(across, along)
    applied = np.array(case.applied_strain)[: len(ratio)]
    ratio[along < LEAST_FOLLOWED * applied] = np.nan
    if case.load.kind in ("shear", "biaxial"):
        ratio[:] = np.nan
    if case.all_corners_held:
        # Its transverse strain is only round-off.
        if case.load.kind == "weft":
            strain_yy, mean_yy = strain_yy * np.nan, mean_yy * np.nan
        else:
            strain_xx, mean_xx = strain_xx * np.nan, mean_xx * np.nan
        ratio[:] = np.nan
    cell_x, cell_y = mean_cell_size(at_rest)
    complete = len(reached) == len(case.applied_strain)
    force = test.loading.reaction_force
    if case.load.kind == "biaxial":
        force = partial(test.loading.force_along, Y)
    forces = np.array([force(state.gradient) for state in reached])
    if case.unloading and complete:
        back = np.full(len(forces), np.nan)
        unloaded = [force(state.gradient) for state in test.unloaded]
        top = force((test.held or reached[-1]).gradient)
        back[len(back) - 1 - len(unloaded) :] = [*unloaded[::-1], top]
        values["reaction_force_unloading"] = back
    return values | {
        "reaction_force": forces,
        "strain_xx": strain_xx,
        "strain_yy": strain_yy,
        "mean_strain_xx": mean_xx,
        "mean_strain_yy": mean_yy,
        "poisson_ratio": ratio,
        "relaxed_cell_x": float(cell_x),
        "relaxed_cell_y": float(cell_y),
        **(lowest_poisson_ratio(applied, ratio) if complete else {}),
    }


def _shapes(case: Case, reached: list[State]) -> dict[str, Any]:
    configurations = Configuration.stacked([state.configuration for state in reached])
    intersecting = self_intersections(case.mesh_shape, configurations)
    return {
        f"energy_{name}": [float(getattr(state.energy, name)) for state in reached]
        for name in ("stretch", "fold", "wall", "contact")
    } | {
        **_lengths(case, configurations),
        "hinges_past_pi": hinges_past_pi(*case.assemble(), configurations).astype(float),
        "self_intersections": np.array(intersecting, float),
        "position": configurations.positions,
    }


def _lengths(case: Case, configurations: Configuration, of: str = "") -> dict[str, Any]:
    if not case.mesh_shape.periodic:
        return {}
    names = ("length_x", "length_y", "length_shear")
    lengths = zip(names, configurations.lengths.T, strict=False)
    return {f"{of}{name}": length for name, length in lengths}


def _relaxed_patches(case: Case, relaxed: Configuration) -> dict[str, Any]:
    shape, cells = case.mesh_shape, case.cell_grid
    values: dict[str, Any] = {}
    directions: tuple[Direction, ...] = ("x", "y")
    for direction in directions:
        wave = boundary_wave(shape, cells, relaxed, direction)
        if wave is not None:
            values |= {
                f"wavelength_{direction}": wave.wavelength,
                f"wave_amplitude_{direction}": wave.amplitude,
                f"boundary_{direction}": wave.across,
                f"boundary_length_{direction}": wave.along[-1],
            }
    for knit, (centre, edge) in widths_across_folds(shape, case.sample, cells, relaxed).items():
        extent = "width" if knit == "rib" else "height"
        values |= {f"{knit}_{extent}_centre": centre, f"{knit}_{extent}_edge": edge}
    return values


def _capacitor_values(
    case: Case, capacitor: model.Capacitor, reached: Sequence[State], unloaded: Sequence[State]
) -> dict[str, Any]:
    """Capacitance along loading, and unloading from the last strain but one, by schema names."""
    electrodes = case.electrodes
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
            different = moved > SAME_STATE * case.assemble()[1].cell_sides.min()
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


def _history(case: Case, history: History) -> dict[str, Any]:
    return {
        "time": history.time,
        "kinetic_energy": history.kinetic,
        "kinetic_energy_left": float(history.kinetic[-1] / history.kinetic.max()),
        "relaxation_force_left": history.force_left,
        "relaxation_time": float(history.time[-1]),
        "potential_energy": history.potential,
        "dissipated_work": history.dissipated,
        "snapshot": history.snapshot_time,
        "snapshot_position": history.snapshots.positions,
        **_lengths(case, history.snapshots, "snapshot_"),
    }


def _dataset(case: Case, values: dict[str, Any]) -> xr.Dataset:
    """The variables of the schema, padded along ``applied_strain`` with missing values."""
    shape = case.mesh_shape
    sizes = {
        "applied_strain": len(case.applied_strain),
        "cell_y": case.cell_grid.count[0],
        "cell_x": case.cell_grid.count[1],
        **{name: len(labels) for name, labels in FIXED_COORDINATES.items()},
        "node_y": shape.nodes_y,
        "node_x": shape.nodes_x,
        "component": 3,
        "time": len(values.get("time", ())),
        "snapshot": len(values.get("snapshot", ())),
    }
    variables: dict[str, Any] = {}
    for name, variable in variables_of(case).items():
        if not variable.dims:
            variables[name] = ((), values.get(name, np.nan))
        elif name in values or variable.in_cube:
            padded = np.full([sizes[dim] for dim in variable.dims], np.nan)
            if name in values:
                padded[: len(values[name])] = values[name]
            variables[name] = (variable.dims, padded)
    coordinates: dict[str, Any] = {
        **case.design,
        "applied_strain": list(case.applied_strain),
        "cell_y": np.arange(sizes["cell_y"]),
        "cell_x": np.arange(sizes["cell_x"]),
    }
    coordinates |= {name: values[name] for name in ("time", "snapshot") if name in values}
    coordinates |= fixed_coordinates({dim for dims, _ in variables.values() for dim in dims})
    if "position" in variables:
        coordinates["component"] = ["x", "y", "z"]
    return xr.Dataset(variables, coordinates)
