"""Variables that follow from others of a cube, and are in no file.

They are the force, stiffness and energy over a side of the cloth, what unloading recovers, whether
the fabric passes through itself at its lowest Poisson's ratio, and how many waves were measured.
"""

from typing import Any

import numpy as np
import xarray as xr

from knitlab.observables.schema import STRAIN, VARIABLES

ROUND_OFF = 1e-6  # force over the largest that counts as none
TRACED_PERIODS = 8  # PERIODIC_CELLS of knitlab.observables.wavelength, whose import loads JAX
RELIABLE_WAVES = 3  # waves from which the error of a wavelength is below 4 %
Derived = dict[str, xr.DataArray]


def with_derived(cube: xr.Dataset) -> xr.Dataset:
    """The cube with the variables that follow from its own.

    The ``force_per_width`` of an experiment is in its file, as the records give it.
    """
    derived = _forces(cube)
    derived |= _after_unloading(cube, derived.get("stretch_energy"))
    needed = {"self_intersections", "applied_strain_at_min"}
    if "intersections_at_min" not in cube and needed <= set(cube):
        at_min = abs(cube[STRAIN] - cube["applied_strain_at_min"]) < 1e-9
        derived["intersections_at_min"] = cube["self_intersections"].where(at_min).max(STRAIN)
    derived |= _waves(cube)
    for name, values in derived.items():
        derived[name] = values.assign_attrs(VARIABLES[name].attributes)
    return cube.assign(derived)


def _forces(cube: xr.Dataset) -> Derived:
    """Forces over the sides that they act on, stiffness and the energy to stretch."""
    derived = Derived()
    force = cube.get("force_per_width")
    across = cube.get("reaction_force_across")
    needed = {"reaction_force", "knit_cell_x", "unit_cells_x"}
    if "load_direction" in cube:
        needed |= {"knit_cell_y", "unit_cells_y"}
    if force is None and needed <= set(cube):
        width = cube["knit_cell_x"] * cube["unit_cells_x"]
        if "load_direction" in cube:
            length = cube["knit_cell_y"] * cube["unit_cells_y"]
            angle = np.deg2rad(cube["load_direction"].fillna(90))
            width, along = sides_of_pull(width, length, angle)
            if across is not None:
                per_length = derived["force_per_width_across"] = across / along
                ratio = per_length * width / cube["reaction_force"]
                derived["force_ratio"] = ratio.where(cube[STRAIN] > 0).transpose(*across.dims)
        force = (cube["reaction_force"] / width).transpose(*cube["reaction_force"].dims)
        derived["force_per_width"] = force
    if force is not None and "stretch_energy" not in cube and cube.sizes.get(STRAIN, 0) > 1:
        derived["tangent_stiffness"] = force.differentiate(STRAIN)
        derived["stretch_energy"] = _under_one_force(cube, force.cumulative_integrate(STRAIN))
    return derived


def sides_of_pull(width: Any, length: Any, angle: Any) -> tuple[Any, Any]:
    """Sides of cloth across and along a pull at an angle from the courses [rad]."""
    sine, cosine = np.sin(angle), np.cos(angle)
    across = np.hypot(width * sine, length * cosine)
    return across, np.hypot(width * cosine, length * sine)


def _after_unloading(cube: xr.Dataset, stretch_energy: xr.DataArray | None) -> Derived:
    """What a fabric gives back when it is unloaded, and the strain that it keeps."""
    derived = Derived()
    back = cube.get("reaction_force_unloading")
    if back is None or "reaction_force" not in cube or cube.sizes.get(STRAIN, 0) <= 1:
        return derived
    stored = cube["reaction_force"].integrate(STRAIN)
    returned = back.integrate(STRAIN)
    derived["energy_recovery"] = _under_one_force(cube, returned / stored)
    derived["residual_strain"] = _strain_without_force(back)
    if stretch_energy is not None:
        lost = stretch_energy.isel({STRAIN: -1}, drop=True)
        derived["energy_lost"] = lost * (1 - derived["energy_recovery"])
    return derived


def _waves(cube: xr.Dataset) -> Derived:
    """Numbers of waves, by which wavelengths can be trusted."""
    derived = Derived()
    boundary = cube.coords.get("boundary", cube.attrs.get("model_boundary"))
    if boundary is None:
        return derived
    periods = xr.where(xr.DataArray(boundary) == "periodic", TRACED_PERIODS, 1)
    for side in "xy":
        if {f"wavelength_{side}", f"unit_cells_{side}"} <= set(cube):
            waves = periods * cube[f"unit_cells_{side}"]
            measured = cube[f"wavelength_{side}"].notnull()
            derived[f"waves_{side}"] = waves.where(measured).transpose(*measured.dims)
    return derived


def _under_one_force(cube: xr.Dataset, energy: xr.DataArray) -> xr.DataArray:
    """The energy where only one force does work, missing under biaxial loads."""
    across = cube.get("reaction_force_across")
    return energy if across is None else energy.where(across.isnull().all(STRAIN))


def _strain_without_force(force: xr.DataArray) -> xr.DataArray:
    """The largest strain at which a force changes its sign, by linear interpolation [1]."""
    strain = force[STRAIN].values

    def last_zero(force: np.ndarray) -> float:
        force = np.where(abs(force) < ROUND_OFF * np.nanmax(abs(force), initial=0.0), 0.0, force)
        crossed = np.flatnonzero((force[:-1] <= 0) & (force[1:] > 0))
        if not len(crossed):
            return np.nan
        one = slice(crossed[-1], crossed[-1] + 2)
        return float(np.interp(0.0, force[one], strain[one]))

    return xr.apply_ufunc(last_zero, force, input_core_dims=[[STRAIN]], vectorize=True)
