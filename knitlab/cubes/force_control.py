"""Control by force: the states of a tensile test at forces instead of at applied strains.

A force that grows slowly leads through the same equilibria as a displacement that grows slowly, up
to where the force has a maximum. There a test that controls the force jumps to the next state that
carries more; the recorded path contains it unless the jump ends on another branch.

Biaxial tests at several ratios of strains hold those at a ratio of forces too, at ratios between.
"""

from collections.abc import Hashable, Sequence
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Float, Int

from knitlab.io.errors import invalid
from knitlab.observables.schema import INTEGERS, LOAD_RATIO, STRAIN

FORCE_RATIO = "force_ratio"
FORCES = ("reaction_force", "force_per_width", FORCE_RATIO)
"""Variables that a test may control: forces, and under biaxial loads their ratio."""


def controllable(cube: xr.Dataset) -> list[str]:
    """The forces of a cube at which it can be read."""
    along = {FORCE_RATIO: LOAD_RATIO}
    return [
        force
        for force in FORCES
        if force in cube.data_vars and along.get(force, STRAIN) in cube[force].dims
    ]


def between(
    cube: xr.Dataset,
    dims: tuple[Hashable, ...],
    upper: np.ndarray,
    fraction: np.ndarray,
    axis: str = STRAIN,
) -> dict[str, xr.Variable]:
    """Every variable along an axis, and this, a ``fraction`` of the way to its ``upper`` index.

    Integers are missing unless both neighbours agree.
    """
    above = xr.Variable(dims, upper)
    below = xr.Variable(dims, np.maximum(upper - 1, 0))
    along = xr.Variable(dims, fraction)
    moved = {}
    for name in (name for name, each in cube.variables.items() if axis in each.dims):
        variable = cube.variables[name].to_base_variable().astype(float).transpose(..., axis)
        low = variable.isel({axis: below})
        high = variable.isel({axis: above})
        if name in INTEGERS:
            values = low.where((low == high) & np.isfinite(along))
        else:  # a neighbour of which nothing is used may be missing
            values = low.where(along < 1, 0.0) * (1 - along) + high.where(along > 0, 0.0) * along
        values = values.transpose(*(dim for dim in variable.dims if dim in dims), ...)
        moved[str(name)] = xr.Variable(values.dims, values.values, variable.attrs)
    return moved


def under_force(cube: xr.Dataset, name: str, forces: Sequence[Any]) -> xr.Dataset:
    """The cube along a force in place of the applied strain, which becomes a variable.

    Every variable is that of the first state that carries each force, linear between two strains;
    missing if none does. ``jumped`` is 1 where the force fell before.
    """
    curve = cube[name].astype(float).transpose(..., STRAIN)
    wanted = _checked(name, forces)
    upper, fraction = _first_to_carry(curve.values, wanted)
    dims = (*curve.dims[:-1], name)
    fell = np.diff(curve.values, axis=-1, prepend=curve.values[..., :1]) < 0
    before = np.arange(curve.sizes[STRAIN]) < upper[..., None]
    jumped = (fell[..., None, :] & before).any(axis=-1) & np.isfinite(fraction)
    about = {"units": "1", "long_name": "whether the force fell before, so that the test jumps"}
    moved = between(cube.drop_vars(name), dims, upper, fraction)
    return (
        cube.drop_vars([name, *moved])
        .assign(moved)
        .assign(jumped=(dims, jumped.astype(float), about))
        .assign_coords({name: (name, wanted, cube[name].attrs)})
    )


def under_force_ratio(cube: xr.Dataset, ratios: Sequence[Any]) -> xr.Dataset:
    """The cube along ratios of forces in place of those of strains, which become a variable.

    At every strain, curves are linear between the two tests whose ratios of forces are on both
    sides. What has no strain remains if all tests agree on it, and the status is the lowest.
    """
    wanted = _checked(FORCE_RATIO, ratios, least=-np.inf)
    curve = cube[FORCE_RATIO].astype(float).transpose(..., STRAIN, LOAD_RATIO)
    upper, fraction = _first_to_carry(curve.values, wanted)
    # What rests is at rest under every ratio of forces.
    resting = (cube[STRAIN] == 0).values[:, None]
    lowest = curve.values[..., :1]
    fraction = np.where(resting, 0.0, np.where(lowest <= wanted, fraction, np.nan))
    upper = np.where(resting, 0, upper)
    along = [name for name, each in cube.variables.items() if LOAD_RATIO in each.dims]
    kept = {name: cube.variables[name].isel({LOAD_RATIO: 0}) for name in along}
    alike = {
        name: first for name, first in kept.items() if cube.variables[name].broadcast_equals(first)
    }
    curves = [name for name in along if STRAIN in cube[name].dims and name != FORCE_RATIO]
    moved = between(cube[curves], (*curve.dims[:-1], FORCE_RATIO), upper, fraction, LOAD_RATIO)
    read = (
        cube.drop_vars(along)
        .assign(alike | {"status": cube["status"].min(LOAD_RATIO)} | moved)
        .assign_coords({FORCE_RATIO: (FORCE_RATIO, wanted, cube[FORCE_RATIO].attrs)})
    )
    if "tangent_stiffness" in moved:  # that at a ratio of strains was another
        slope = read["force_per_width"].differentiate(STRAIN)
        read["tangent_stiffness"] = slope.assign_attrs(cube["tangent_stiffness"].attrs)
    return read


def _checked(name: str, forces: Sequence[Any], least: float = 0.0) -> Float[np.ndarray, " force"]:
    values = []
    for force in forces:
        try:
            values.append(float(force))
        except (TypeError, ValueError, OverflowError):
            raise invalid(f"selections {name}", f"{force!r} is not a number; give one") from None
        if not (np.isfinite(values[-1]) and values[-1] >= least):
            hint = "is no pull; give a force from 0 on" if least == 0 else "is no ratio; give one"
            raise invalid(f"selections {name}", f"{force} {hint}")
    if not values:
        raise invalid(f"selections {name}", "has no value; give one")
    return np.array(list(dict.fromkeys(values)))


def _first_to_carry(
    curves: Float[np.ndarray, "*case strain"], forces: Float[np.ndarray, " force"]
) -> tuple[Int[np.ndarray, "*case force"], Float[np.ndarray, "*case force"]]:
    """Index of the first strain whose force is as large, and how far it is from the last [0, 1]."""
    carried = curves[..., None, :] >= forces[:, None]
    upper = carried.argmax(axis=-1)
    high = np.take_along_axis(curves, upper, axis=-1)
    low = np.take_along_axis(curves, np.maximum(upper - 1, 0), axis=-1)
    rise = np.where(high > low, high - low, 1.0)
    fraction = np.where(upper == 0, 0.0, (forces - low) / rise)
    return upper, np.where(carried.any(axis=-1), fraction, np.nan)
