"""The model that the numbers of a cube are of, as one line."""

from collections.abc import Sequence

import numpy as np
import xarray as xr

from knitlab.cubes.cube_file import cube_name, is_measured, model_options, parameters_of, source_of


def model_line(cube: xr.Dataset) -> str:
    """Lengths, contact, boundary and method of a cube; of a swept setting every value."""
    if is_measured(cube):
        return f"none, {source_of(cube)} was measured"
    stated = model_options(cube) | {"method": cube.attrs.get("method")}
    stated |= {"thickness": parameters_of(cube).get("sheet", {}).get("thickness")}

    def values(name: str) -> list[object]:
        if name in cube.coords:
            return np.atleast_1d(cube[name].values).tolist()
        return [] if stated.get(name) is None else [stated[name]]

    thickness = ", ".join(f"{value:g}" for value in values("thickness"))
    touching = f"contact at {thickness} mm" if thickness else "contact"
    samples = f"clamped samples{_sizes(cube)}"
    parts = [
        [f"{value} lengths" for value in values("cell_size")],
        ["no contact" if value == "none" else touching for value in values("contact")],
        ["periodic fabric" if value == "periodic" else samples for value in values("boundary")],
        [str(value) for value in values("method")],
    ]
    return ", ".join(" and ".join(part) for part in parts if part) or "not stated in the cube"


def model_lines(cubes: Sequence[xr.Dataset]) -> list[str]:
    """The lines that state the models of cubes: one if they agree, else one for each cube."""
    lines = {cube_name(cube): model_line(cube) for cube in cubes}
    if len(set(lines.values())) == 1:
        return [f"model: {line}" for line in set(lines.values())]
    return [f"model of {name}: {line}" for name, line in lines.items()]


def _sizes(cube: xr.Dataset) -> str:
    """The sizes of the samples of a cube in unit cells, from the smallest to the largest."""
    if not {"unit_cells_y", "unit_cells_x"} <= set(cube.variables):
        return ""
    counts = [cube[f"unit_cells_{axis}"].values.astype(float).ravel() for axis in "yx"]
    sizes = {(int(y), int(x)) for y, x in zip(*counts, strict=True) if y > 0 and x > 0}
    ordered = sorted(sizes, key=lambda size: (size[0] * size[1], size))
    ends = dict.fromkeys((*ordered[:1], *ordered[-1:]))
    return " of " + " to ".join(f"{y} × {x}" for y, x in ends) + " unit cells" if ends else ""
