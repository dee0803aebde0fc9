"""Columns that reduce a curve over a window of strain: ``mean(poisson_ratio, 0.05:0.25)``."""

import re
from collections.abc import Iterable, Sequence

import numpy as np
import xarray as xr

from knitlab.cube.cube_file import design_dims
from knitlab.cube.strain_window import REDUCTIONS, STRAIN, StrainWindow
from knitlab.io.errors import fault, unknown

_CALL = re.compile(rf"\b({'|'.join(REDUCTIONS)})\s*\(\s*(\w+)\s*,\s*([^()]*?)\s*\)")


def reduced_columns(text: str) -> list[str]:
    """The parts of a condition, or of another text, that name a reduced column."""
    return list(dict.fromkeys(match[0] for match in _CALL.finditer(text)))


def with_columns(cubes: Sequence[xr.Dataset], texts: Iterable[str]) -> list[xr.Dataset]:
    """Cubes with the reduced columns in some texts as variables; BadInput if these cannot be."""
    curves = {
        str(name)
        for cube in cubes
        for name in cube.data_vars
        if set(cube[name].dims) - set(design_dims(cube)) == {STRAIN}
    }
    extended = list(cubes)
    for match in (match for text in texts for match in _CALL.finditer(text)):
        column, reduction, name, window = match[0], match[1], match[2], match[3]
        strains = StrainWindow.of(window, column)
        if name not in curves:
            raise fault(column, f"reduces a curve along {STRAIN}, and {unknown(name, curves)}")
        extended = [
            cube.assign({column: _reduced(cube, reduction, name, strains, column)})
            if name in cube
            else cube
            for cube in extended
        ]
    return extended


def _reduced(
    cube: xr.Dataset, reduction: str, name: str, window: StrainWindow, label: str
) -> xr.DataArray:
    dims = design_dims(cube)
    curve = cube[name].transpose(*dims, STRAIN)
    curves = np.asarray(curve.values, float).reshape(-1, curve.sizes[STRAIN])
    values = REDUCTIONS[reduction](*window.read(np.asarray(cube[STRAIN].values, float), curves))
    unit = "1" if reduction == "linearity" else curve.attrs.get("units", "1")
    described = {"units": unit, "long_name": label}
    return xr.DataArray(values.reshape(curve.shape[:-1]), dims=dims, attrs=described)
