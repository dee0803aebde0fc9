"""Variables that follow from others when a cube is opened: force over width, validity."""

import numpy as np
import xarray as xr

from knitlab.cube.schema import STRAIN, VARIABLES


def with_derived(cube: xr.Dataset) -> xr.Dataset:
    """The cube with force, stiffness and energy over a side of the cloth, recovery and validity.

    They are in no file: files of every version then have them. ``force_per_width`` of an experiment
    is that of its records.
    """
    derived: dict[str, xr.DataArray] = {}
    force = cube.get("force_per_width")
    if force is None and {"reaction_force", "knit_cell_x", "unit_cells_x"} <= set(cube):
        width = cube["knit_cell_x"] * cube["unit_cells_x"]
        if "load_direction" in cube:
            length = cube["knit_cell_y"] * cube["unit_cells_y"]
            angle = np.deg2rad(cube["load_direction"].fillna(90))
            width = (width**2 * np.sin(angle) ** 2 + length**2 * np.cos(angle) ** 2) ** 0.5
        force = (cube["reaction_force"] / width).transpose(*cube["reaction_force"].dims)
        derived["force_per_width"] = force
    if force is not None and "stretch_energy" not in cube and cube.sizes.get(STRAIN, 0) > 1:
        derived["tangent_stiffness"] = force.differentiate(STRAIN)
        derived["stretch_energy"] = force.cumulative_integrate(STRAIN)
    back = cube.get("reaction_force_unloading")
    if back is not None and cube.sizes.get(STRAIN, 0) > 1:
        both = (cube["reaction_force"], back)
        stored, returned = (each.integrate(STRAIN) for each in both)
        derived["energy_recovery"] = returned / stored
    needed = {"self_intersections", "applied_strain_at_min"}
    if "intersections_at_min" not in cube and needed <= set(cube):
        at_min = abs(cube[STRAIN] - cube["applied_strain_at_min"]) < 1e-9
        derived["intersections_at_min"] = cube["self_intersections"].where(at_min).max(STRAIN)
    return cube.assign(
        {name: values.assign_attrs(VARIABLES[name].attributes) for name, values in derived.items()}
    )
