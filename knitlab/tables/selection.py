"""Selections: ``NAME=VALUE`` texts that slice a cube along its coordinates."""

from collections.abc import Hashable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from knitlab.io.errors import BadInput, Fault, fault
from knitlab.io.plain_cube import PlainCube
from knitlab.io.suggestions import unknown

if TYPE_CHECKING:
    import xarray as xr

MOST_CHOICES = 30
"""Largest number of values of a coordinate that a message lists."""


def selected(cube: "xr.Dataset", selections: Sequence[str]) -> "xr.Dataset":
    """Keep the selected values of coordinates; all dimensions are kept.

    Args:
        cube: the cube.
        selections: texts ``NAME=VALUE`` or ``NAME=VALUE,VALUE``.

    Raises:
        BadInput: with every selection that is malformed or does not exist.
    """
    return cube.isel(chosen_places(PlainCube.of(cube).coordinates, selections))


def selection_texts(selections: Mapping[str, Any]) -> tuple[str, ...]:
    """Keyword arguments as selection texts.

    Args:
        selections: a value, or a list of them, by the coordinate: ``{"n_stripe": [4, 6]}``.

    Returns:
        Texts ``NAME=VALUE,VALUE``.
    """
    texts = []
    for name, value in selections.items():
        values = [value] if isinstance(value, str) else np.atleast_1d(value).tolist()
        texts.append(f"{name}={','.join(map(str, values))}")
    return tuple(texts)


def coordinate_of(text: str) -> str:
    """The coordinate of a selection."""
    return text.partition("=")[0].strip()


def selections_along(selections: Sequence[str], names: Iterable[Hashable]) -> list[str]:
    """The selections along coordinates of these names."""
    known = set(names)
    return [text for text in selections if coordinate_of(text) in known]


def refuse_others(selections: Sequence[str], known: Iterable[str], problem: str) -> None:
    """Check the coordinates of selections.

    Args:
        selections: texts ``NAME=VALUE``.
        known: names of coordinates that may be selected.
        problem: message about other coordinates.

    Raises:
        BadInput: with every selection along another coordinate.
    """
    names = set(known)
    faults = [
        Fault(f"selections {text}", problem)
        for text in selections
        if coordinate_of(text) not in names
    ]
    if faults:
        raise BadInput(faults)


def choices(cube: "xr.Dataset", dims: Iterable[str]) -> str:
    """The values of dimensions of a cube, as text."""
    return "; ".join(f"{dim} of {', '.join(map(str, cube[dim].values))}" for dim in dims)


def chosen_places(
    coordinates: Mapping[str, np.ndarray], selections: Sequence[str]
) -> dict[str, list[int]]:
    """Indices of the selected values along their coordinates.

    Args:
        coordinates: values along every labelled dimension.
        selections: texts ``NAME=VALUE`` or ``NAME=VALUE,VALUE``.

    Raises:
        BadInput: with every selection that is malformed or does not exist.
    """
    chosen: dict[str, list[int]] = {}
    faults = []
    for text in selections:
        try:
            name, places = _places(coordinates, text)
        except BadInput as error:
            faults += [Fault(f"selections {text}", entry.problem) for entry in error.faults]
        else:
            chosen[name] = [place for place in chosen.get(name, places) if place in places]
    if faults:
        raise BadInput(faults)
    return chosen


def _places(coordinates: Mapping[str, np.ndarray], text: str) -> tuple[str, list[int]]:
    name, equals, listed = (part.strip() for part in text.partition("="))
    if not equals or not listed:
        raise fault(text, "is not NAME=VALUE; give both")
    if name not in coordinates:
        raise fault(text, unknown(name, coordinates))
    present = coordinates[name]
    words = present.dtype.kind in "UO"
    places = []
    for value in (part.strip() for part in listed.split(",")):
        try:
            matches = present == value if words else np.isclose(present, float(value), 0, 1e-9)
        except ValueError:
            raise fault(text, f"{value!r} is not a number; give one") from None
        found = np.flatnonzero(matches)
        if not found.size:
            shown = [str(choice) if words else f"{choice:g}" for choice in present]
            more = ", …" if len(shown) > MOST_CHOICES else ""
            choices = ", ".join(shown[:MOST_CHOICES]) + more
            raise fault(text, f"the cube has no {name} = {value}; choose from {choices}")
        places.append(int(found[0]))
    return name, list(dict.fromkeys(places))
