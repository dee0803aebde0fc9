"""Variables of a cube for the page: those with a number for a design, or for each of its states."""

import itertools
from collections.abc import Iterator, Sequence

import numpy as np
import xarray as xr

from knitlab.cube.cube_file import design_dims
from knitlab.cube.schema import FLAGS, INTEGERS
from knitlab.explorer.page import Content

STRAIN = "applied_strain"
EXPANDED = ("stripe_parameter",)
"""Dimensions along which a variable becomes one for each label."""
DIGITS = 6
"""Significant digits of the numbers on the page."""
NEGLIGIBLE = 1e-7
"""Part of the largest value of a variable below which another is zero but for round-off."""
BAND = ("low", "high", "error")
"""Endings of the variables that give the band of another."""


def variables_of(cube: xr.Dataset, places: Sequence[tuple[int, ...]]) -> list[Content]:
    """Every variable of a cube that a map or a curve can show.

    Those along unit cells or along a boundary are left out, and so are those without any value.

    Args:
        cube: the cube.
        places: the cells of its designs, which the values are of, in this order.
    """
    found = [
        content
        for name in map(str, cube.data_vars)
        if name not in FLAGS and cube[name].dtype.kind in "fiub"
        for content in _contents(cube, name, places)
    ]
    names = {content["name"] for content in found}
    for content in found:
        partners = {end: f"{content['name']}_{end}" for end in BAND}
        content["band"] = {end: name for end, name in partners.items() if name in names}
    return found


def _contents(cube: xr.Dataset, name: str, places: Sequence[tuple[int, ...]]) -> Iterator[Content]:
    variable, dims = cube[name], design_dims(cube)
    if not set(dims) <= set(variable.dims):
        return
    further = [str(dim) for dim in variable.dims if dim not in (*dims, STRAIN)]
    if not set(further) <= set(EXPANDED):
        return
    for labels in itertools.product(*(cube[dim].values.tolist() for dim in further)):
        one = variable.sel(dict(zip(further, labels, strict=True)))
        along = STRAIN in one.dims
        ordered = one.transpose(*dims, STRAIN) if along else one.transpose(*dims)
        values = np.array([ordered.values[place] for place in places], float)
        if not np.isfinite(values).any():
            continue
        negligible = NEGLIGIBLE * np.nanmax(np.abs(values))
        label = ", ".join(map(str, labels))
        yield {
            "name": f"{name}[{label}]" if label else name,
            "long_name": f"{one.attrs.get('long_name', name)}{f': {label}' if label else ''}",
            "units": one.attrs.get("units", "1"),
            "description": one.attrs.get("description", ""),
            "along_strain": along,
            "whole": name in INTEGERS,
            "values": [_rounded(value, negligible) for value in values.ravel().tolist()],
        }


def _rounded(value: float, negligible: float) -> float | None:
    if not np.isfinite(value):
        return None
    return 0.0 if abs(value) < negligible else float(f"{value:.{DIGITS}g}")
