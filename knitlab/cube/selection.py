"""Selections: values of a cube's coordinates that slice it along them."""

from collections.abc import Hashable, Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from knitlab.cube.plain_cube import PlainCube
from knitlab.io.errors import BadInput, ErrorCollector, Fault, fault, unknown

if TYPE_CHECKING:
    import xarray as xr

MOST_CHOICES = 30
"""Largest number of values of a coordinate that a message lists."""


def selected(cube: "xr.Dataset", selections: Mapping[str, Any]) -> "xr.Dataset":
    """Keep the selected values of coordinates; all dimensions are kept.

    Args:
        cube: the cube.
        selections: a value, or a sequence of values, by coordinate.

    Raises:
        BadInput: with every selection that does not exist.
    """
    return cube.isel(chosen_places(PlainCube.of(cube).coordinates, selections))


def selections_along(selections: Mapping[str, Any], names: Iterable[Hashable]) -> dict[str, Any]:
    """The selections along coordinates of these names."""
    known = set(names)
    return {name: value for name, value in selections.items() if name in known}


def as_given(selections: Mapping[str, Any]) -> list[str]:
    """Selections as the command line gives them, ``NAME=VALUE,VALUE``, to show or to store."""
    return [f"{name}={','.join(map(str, _values(value)))}" for name, value in selections.items()]


def refuse_others(selections: Mapping[str, Any], known: Iterable[str], problem: str) -> None:
    """Check the coordinates of selections.

    Args:
        selections: a value, or a sequence of values, by coordinate.
        known: names of coordinates that may be selected.
        problem: message about other coordinates.

    Raises:
        BadInput: with every selection along another coordinate.
    """
    names = set(known)
    others = {name: value for name, value in selections.items() if name not in names}
    if others:
        raise BadInput(Fault(f"selections {text}", problem) for text in as_given(others))


def choices(cube: "xr.Dataset", dims: Iterable[str]) -> str:
    """The values of dimensions of a cube, as text."""
    return "; ".join(f"{dim} of {', '.join(map(str, cube[dim].values))}" for dim in dims)


def chosen_places(
    coordinates: Mapping[str, np.ndarray], selections: Mapping[str, Any]
) -> dict[str, list[int]]:
    """Indices of the selected values along their coordinates.

    Args:
        coordinates: values along every labelled dimension.
        selections: a value, or a sequence of values, by coordinate.

    Raises:
        BadInput: with every selection that does not exist.
    """
    chosen: dict[str, list[int]] = {}
    faults = ErrorCollector()
    for name, value in selections.items():
        with faults:
            chosen[name] = _places(coordinates, name, value)
    if faults.all:
        raise BadInput(faults.all)
    return chosen


def _values(value: Any) -> list[Any]:
    return np.asarray(value, dtype=object).ravel().tolist()


def _places(coordinates: Mapping[str, np.ndarray], name: str, value: Any) -> list[int]:
    path = f"selections {as_given({name: value})[0]}"
    if name not in coordinates:
        raise fault(path, unknown(name, coordinates))
    present = coordinates[name]
    words = present.dtype.kind in "UO"
    places = []
    for one in _values(value):
        try:
            matches = present == str(one) if words else np.isclose(present, float(one), 0, 1e-9)
        except (TypeError, ValueError, OverflowError):
            raise fault(path, f"{one!r} is not a number; give one") from None
        found = np.flatnonzero(matches)
        if not found.size:
            shown = [str(choice) if words else f"{choice:g}" for choice in present]
            more = ", …" if len(shown) > MOST_CHOICES else ""
            choices = ", ".join(shown[:MOST_CHOICES]) + more
            raise fault(path, f"the cube has no {name} = {one}; choose from {choices}")
        places.append(int(found[0]))
    if not places:
        raise fault(path, "has no value; give one")
    return list(dict.fromkeys(places))
