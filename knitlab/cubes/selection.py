"""Selections: a value or a sequence of values by coordinate, along which a cube is sliced."""

from collections.abc import Collection, Hashable, Iterable, Mapping
from typing import Any

import numpy as np
import xarray as xr

from knitlab.cubes.force_control import (
    FORCE_RATIO,
    between,
    controllable,
    under_force,
    under_force_ratio,
)
from knitlab.io.errors import ErrorCollector, Mistake, invalid, raise_if_any, unknown
from knitlab.observables.schema import LOAD_RATIO, STRAIN
from knitlab.observables.status import Status

MAX_CHOICES = 30  # values of a coordinate that a message lists
MAX_VALUES = 10_000  # selected along a coordinate


def select(cube: xr.Dataset, selections: Mapping[str, Any]) -> xr.Dataset:
    """The cube at selected values of coordinates, with all dimensions.

    Curves are linear between two strains; a selected force takes the place of the applied strain.
    """
    for name, value in selections.items():
        if (number := len(_values(value))) > MAX_VALUES:
            message = f"has {number:,} values; give at most {MAX_VALUES:,}"
            raise invalid(f"selections {name}", message)
    if FORCE_RATIO in selections and FORCE_RATIO in controllable(cube):
        _check_single(selections, (FORCE_RATIO, LOAD_RATIO))
        cube = under_force_ratio(cube, _values(selections[FORCE_RATIO]))
    forces = controllable(cube)
    _check_single(selections, (STRAIN, *forces))
    for force in (name for name in selections if name in forces):
        cube = under_force(cube, force, _values(selections[force]))
    if STRAIN in selections and STRAIN in cube.dims:
        cube = _with_strains(cube, _values(selections[STRAIN]))
    coordinates = {str(name): cube[name].values for name in cube.coords if name in cube.dims}
    return cube.isel(chosen_indices(coordinates, selections))


def only_design(cube: xr.Dataset, selections: Mapping[str, Any], title: str = "") -> xr.Dataset:
    """The one design that selections leave, its labels as coordinates; InputError if not one."""
    left = select(cube, selections)
    exists = left["case_id"] != ""
    if "status" in left:
        exists = exists & (left["status"] != Status.excluded)
    dims = exists.dims
    found = np.argwhere(exists.values)
    where = f" of {title}" if title else ""
    if not len(found):
        raise invalid("selections", f"leave no design{where}; choose others")
    if len(found) > 1:
        labels = {dim: left[dim][np.unique(found[:, axis])] for axis, dim in enumerate(dims)}
        several = [dim for dim, values in labels.items() if values.size > 1]
        listed = choices(xr.Dataset(coords=labels), several)
        raise invalid("selections", f"leave {len(found)} designs{where}; select {listed}")
    return left.isel(dict(zip(dims, found[0].tolist(), strict=True)))


def _check_single(selections: Mapping[str, Any], names: Collection[str]) -> None:
    given = [name for name in selections if name in names]
    if len(given) > 1:
        both = " and ".join(given)
        raise invalid("selections", f"{both} exclude each other; select one of them")


def _with_strains(cube: xr.Dataset, wanted: list[Any]) -> xr.Dataset:
    """The cube at its strains and at further ones between them."""
    strains = np.asarray(cube[STRAIN].values, float)
    asked = np.unique([number for each in wanted if np.isfinite(number := _number(each))])
    near = np.isclose(asked[:, None], strains, 0, 1e-9).any(axis=1)
    new = asked[(strains[0] < asked) & (asked < strains[-1]) & ~near]
    if not len(new):
        return cube
    upper = np.searchsorted(strains, new)
    fraction = (new - strains[upper - 1]) / (strains[upper] - strains[upper - 1])
    moved = between(cube, (STRAIN,), upper, fraction)
    moved[STRAIN] = xr.Variable(STRAIN, new, cube[STRAIN].attrs)
    further = cube.drop_vars(moved).assign(moved)
    both = xr.concat([cube, further], STRAIN, data_vars="minimal", coords="minimal")
    return both.sortby(STRAIN).assign_attrs(cube.attrs)


def _number(value: Any) -> float:
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        return np.nan


def selections_along(selections: Mapping[str, Any], names: Iterable[Hashable]) -> dict[str, Any]:
    """The selections along coordinates of these names."""
    known = set(names)
    return {name: value for name, value in selections.items() if name in known}


def selectable(cube: xr.Dataset) -> list[str]:
    """Names along which a cube can be selected: its coordinates, and forces."""
    return [*map(str, cube.indexes), *controllable(cube)]


def as_given(selections: Mapping[str, Any]) -> list[str]:
    """Selections as the command line gives them, ``NAME=VALUE,VALUE``, to show or to store."""
    return [f"{name}={','.join(map(str, _values(value)))}" for name, value in selections.items()]


def refuse_others(selections: Mapping[str, Any], known: Iterable[str], message: str) -> None:
    """InputError with a message for every selection that is not along a known coordinate."""
    names = set(known)
    others = {name: value for name, value in selections.items() if name not in names}
    raise_if_any([Mistake(f"selections {text}", message) for text in as_given(others)])


def choices(cube: xr.Dataset, dims: Iterable[Hashable]) -> str:
    """The values of dimensions of a cube, as text."""
    return "; ".join(f"{dim} of {', '.join(map(str, cube[dim].values))}" for dim in dims)


def chosen_indices(
    coordinates: Mapping[str, np.ndarray], selections: Mapping[str, Any]
) -> dict[str, list[int]]:
    """Indices of the selected values along coordinates; InputError with every one not there."""
    chosen: dict[str, list[int]] = {}
    mistakes = ErrorCollector()
    for name, value in selections.items():
        with mistakes:
            chosen[name] = _indices(coordinates, name, value)
    raise_if_any(mistakes.all)
    return chosen


def _values(value: Any) -> list[Any]:
    return np.asarray(value, dtype=object).ravel().tolist()


def _indices(coordinates: Mapping[str, np.ndarray], name: str, value: Any) -> list[int]:
    path = f"selections {as_given({name: value})[0]}"
    if name not in coordinates:
        raise invalid(path, unknown(name, coordinates))
    present = coordinates[name]
    words = present.dtype.kind not in "biuf"
    indices = []
    for one in _values(value):
        try:
            matches = present == str(one) if words else np.isclose(present, float(one), 0, 1e-9)
        except (TypeError, ValueError, OverflowError):
            raise invalid(path, f"{one!r} is not a number; give one") from None
        if not matches.any():
            shown = [str(choice) if words else f"{choice:g}" for choice in present]
            more = ", …" if len(shown) > MAX_CHOICES else ""
            listed = ", ".join(shown[:MAX_CHOICES]) + more
            raise invalid(path, f"the cube has no {name} = {one}; choose from {listed}")
        indices.append(int(matches.argmax()))
    if not indices:
        raise invalid(path, "has no value; give one")
    return list(dict.fromkeys(indices))
