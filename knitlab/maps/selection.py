"""Selections: ``NAME=VALUE`` texts that slice a cube along its coordinates."""

import difflib
from collections.abc import Iterable, Sequence

import numpy as np
import xarray as xr

from knitlab.sweep.faults import BadInput, Fault, fault


def unknown(name: str, known: Iterable[str]) -> str:
    """Say that a name is not known, and which one it may have been or which there are."""
    names = sorted(known)
    nearest = difflib.get_close_matches(name, names, n=1)
    remedy = f"did you mean {nearest[0]!r}?" if nearest else f"choose of {', '.join(names)}"
    return f"there is no {name!r}; {remedy}"


def selected(cube: xr.Dataset, selections: Sequence[str]) -> xr.Dataset:
    """Keep the coordinate values that are named; every dimension stays.

    Args:
        cube: the cube.
        selections: texts ``NAME=VALUE`` or ``NAME=VALUE,VALUE``.

    Raises:
        BadInput: with every selection that is malformed or names what is not there.
    """
    faults = []
    for text in selections:
        try:
            cube = _one(cube, text)
        except BadInput as error:
            faults += [Fault(f"--select {text}", entry.problem) for entry in error.faults]
    if faults:
        raise BadInput(faults)
    return cube


def _one(cube: xr.Dataset, text: str) -> xr.Dataset:
    name, equals, listed = (part.strip() for part in text.partition("="))
    if not equals or not listed:
        raise fault(text, "is not NAME=VALUE; give both")
    if name not in cube.dims or name not in cube.coords:
        raise fault(text, unknown(name, map(str, cube.dims)))
    present = cube[name].values
    words = present.dtype.kind in "UO"
    places = []
    for value in (part.strip() for part in listed.split(",")):
        if words:
            if value not in present:
                choices = ", ".join(map(str, present))
                raise fault(text, f"the cube has no {name} = {value}; choose of {choices}")
            places.append(int(np.flatnonzero(present == value)[0]))
            continue
        try:
            matches = np.flatnonzero(np.isclose(present, float(value), rtol=0, atol=1e-9))
        except ValueError:
            raise fault(text, f"{value!r} is not a number; give one") from None
        if not matches.size:
            choices = ", ".join(f"{choice:g}" for choice in present)
            raise fault(text, f"the cube has no {name} = {value}; choose of {choices}")
        places.append(int(matches[0]))
    return cube.isel({name: list(dict.fromkeys(places))})
