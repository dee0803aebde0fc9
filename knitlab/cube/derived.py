"""Variables that follow from others when a cube is opened: force over width, validity."""

import xarray as xr

from knitlab.cube.schema import VARIABLES

STRAIN = "applied_strain"


def with_derived(cube: xr.Dataset) -> xr.Dataset:
    """The cube with force, tangent stiffness and energy over the width of the cloth, and validity.

    They are in no file: files of every version then have them. ``force_per_width`` of an experiment
    is that of its records.
    """
    derived: dict[str, xr.DataArray] = {}
    if "force_per_width" in cube:
        derived["force_per_width"] = cube["force_per_width"]
    elif "reaction_force" in cube and {"knit_cell_x", "unit_cells_x"} <= set(cube):
        width = cube["knit_cell_x"] * cube["unit_cells_x"]
        derived["force_per_width"] = (cube["reaction_force"] / width).transpose(
            *cube["reaction_force"].dims
        )
    if "force_per_width" in derived and cube.sizes.get(STRAIN, 0) > 1:
        force = derived["force_per_width"]
        derived["tangent_stiffness"] = force.differentiate(STRAIN)
        derived["stretch_energy"] = force.cumulative_integrate(STRAIN)
    if {"self_intersections", "applied_strain_at_min"} <= set(cube):
        at_min = abs(cube[STRAIN] - cube["applied_strain_at_min"]) < 1e-9
        crossings = cube["self_intersections"].where(at_min).max(STRAIN)
        derived["intersections_at_min"] = crossings
    named = {
        name: values.assign_attrs(VARIABLES[name].attributes) for name, values in derived.items()
    }
    return cube.assign({name: values for name, values in named.items() if name not in cube})
