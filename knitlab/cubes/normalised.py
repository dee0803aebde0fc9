"""Cubes in one form, whatever xarray or another program has made of them.

The dimensions of a cube are those of its designs, which its status has, and those that the schema
gives each variable. To merge, select, mask, stack, quantify or save a cube elsewhere changes
dimensions, types and units, but not what is known: what follows from the rest is restored.
"""

import json
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from knitlab.cubes.force_control import FORCES
from knitlab.io.errors import InputError, Mistake
from knitlab.observables.observable import Variable
from knitlab.observables.schema import (
    COORDINATES,
    DESIGN_DIMS,
    INTEGERS,
    SOURCE,
    STRAIN,
    STRIPE_DIMS,
    VARIABLES,
)
from knitlab.observables.status import Status

ATTRIBUTE = "parameters"  # of a cube, with the settings that all its designs share
TEXTS = ("case_id", "code")  # variables that are strings
KNOWN = VARIABLES | COORDINATES
AXES = {dim for each in VARIABLES.values() for dim in each.dims} | {*FORCES}
"""Dimensions beside those of designs: of their states, unit cells, nodes and stripe parameters."""
WHOLE = ("n_stripe", "n_subunit", "n", "cycle", "candidate", "cell_y", "cell_x")
"""Coordinates that are whole numbers."""
MAX_DESIGNS = 1_000_000  # of the grid that the labels of stacked designs span


class NoCube(InputError):
    """A dataset without what tables and figures need, or with something of another form."""


def normalised(cube: Any, where: str = "cube") -> xr.Dataset:
    """The cube, or the test, in the form that all functions rely on.

    A dimension that was selected as a single value is one again, masks and stacks are undone, units
    are those of the schema, and dimensions and numbers are in order. Where the status is missing,
    there is no design.

    Args:
        cube: a dataset, which is not changed.
        where: its name in messages.

    Raises:
        NoCube: if it has no status, or something has another form; the message names it.
    """
    if not isinstance(cube, xr.Dataset):
        given = f"a {type(cube).__name__}"
        if isinstance(cube, xr.DataArray):
            given = f"the variable {cube.name} alone"
        message = f"is {given}; give a dataset with status, its file or its results folder"
        raise _no_cube(where, message)
    require(cube, ["status"], "tables and figures", where)
    source = dict(cube.encoding)
    cube = _unstacked(_computed(cube), where)
    loose = [name for name in cube.coords if name in VARIABLES and cube[name].dims]
    cube = cube.reset_coords([name for name in loose if name not in cube.indexes])
    cube = _with_dimensions(_of_one_source(cube, where), keep_labels=_is_recorded(cube))
    dims = _design_dims(cube, where)
    cube = cube.assign_coords(_labels(cube, dims, where))
    known = [str(name) for name in cube.data_vars if name in VARIABLES]
    variables = {name: _variable(cube, name, dims, where) for name in known}
    changed = {name: each for name, each in variables.items() if each is not cube.variables[name]}
    cube = _in_order(cube.assign(changed), dims)
    cube.encoding = source
    return cube


def require(cube: xr.Dataset, names: Iterable[str], what: str, where: str = "cube") -> None:
    """Raise NoCube with the variables that a cube lacks, and what needs them."""
    if missing := [name for name in names if name not in cube.variables]:
        listed = " and ".join(f"{name} ({KNOWN[name].long_name})" for name in missing)
        hint = "keep it when you select variables, or give a cube that has it"
        raise _no_cube(where, f"has no {listed}, which {what} need; {hint}")


@contextmanager
def naming_missing(what: str, cubes: Sequence[xr.Dataset]) -> Iterator[None]:
    """Raise NoCube with the first variable of the schema that is read, and that a cube lacks."""
    try:
        yield
    except KeyError as error:
        named = [name for name in re.findall(r"\w+", str(error)) if name in KNOWN]
        for cube in cubes:
            require(cube, named[:1], what)
        raise


def as_cube_of_one(case: xr.Dataset) -> xr.Dataset:
    """A single case as a cube of one design, without the variables that only case files have."""
    known = [name for name in case.data_vars if name in VARIABLES]
    names = [name for name in known if VARIABLES[str(name)].in_cube]
    cube = _with_dimensions(case[names], keep_labels=False)
    return _in_order(cube, _design_dims(cube, "test"))


def _no_cube(where: str, message: str) -> NoCube:
    return NoCube([Mistake(where, message)])


def _computed(cube: xr.Dataset) -> xr.Dataset:
    """The cube without units of pint and chunks of dask."""
    plain = dict[Any, xr.Variable]()
    for name, each in cube.variables.items():
        data: Any = each._data  # not read from a file
        if hasattr(data, "magnitude"):
            unit = f"{data.units:~}" or "1"
            plain[name] = xr.Variable(each.dims, data.magnitude, {**each.attrs, "units": unit})
    if plain:
        coordinates = {name: plain.pop(name) for name in cube.coords if name in plain}
        # Their indexes have units, too.
        cube = cube.assign(plain).drop_vars(coordinates).assign_coords(coordinates)
    in_chunks = any(each.chunks for each in cube.variables.values())
    return _computed(cube.compute()) if in_chunks else cube


def _unstacked(cube: xr.Dataset, where: str) -> xr.Dataset:
    """The cube with a dimension for each of the labels along which its designs were stacked."""
    for dim in map(str, list(cube.sizes)):
        labels = [str(name) for name, each in cube.coords.items() if each.dims == (dim,)]
        labels = [name for name in labels if name != dim and name not in VARIABLES]
        indexed = isinstance(cube.indexes.get(dim), pd.MultiIndex)
        if not indexed and (dim in cube.coords or not {*DESIGN_DIMS} <= {*labels}):
            continue
        counts = [len(np.unique(cube[name].values)) for name in labels]
        if (count := np.prod(counts, dtype=float)) > MAX_DESIGNS:
            message = f"would have {count:.0e} designs along {', '.join(labels)}"
            raise _no_cube(where, f"{message}; give fewer at a time")
        try:
            index: dict[Any, Any] = {dim: labels}
            cube = (cube if indexed else cube.set_index(index)).unstack(dim)
        except ValueError as error:
            message = f"has a design twice along {dim}; keep one of each"
            raise _no_cube(where, message) from error
    return cube


def _of_one_source(cube: xr.Dataset, where: str) -> xr.Dataset:
    """The cube with its source as a single value."""
    if SOURCE not in cube.coords or not cube[SOURCE].dims:
        return cube
    sources = {str(each) for each in cube[SOURCE].values.flat}
    if len(sources) > 1:
        listed = ", ".join(sorted(sources))
        raise _no_cube(where, f"is of several sources, {listed}; give a cube of each")
    cube = cube.isel({SOURCE: 0}, missing_dims="ignore")
    return cube.drop_vars(SOURCE).assign_coords({SOURCE: sources.pop()})


def _is_recorded(cube: xr.Dataset) -> bool:
    """Whether a dataset is one case as it was simulated, and not a design of a cube."""
    if cube["status"].dims:
        return False
    with suppress(ValueError, TypeError):
        return "position" in cube or "design" in json.loads(cube.attrs.get(ATTRIBUTE, "{}"))
    return False


def _with_dimensions(cube: xr.Dataset, keep_labels: bool) -> xr.Dataset:
    """The cube with a dimension for each single value that was selected along one.

    With ``keep_labels`` those of designs are left as they are.
    """
    for name in reversed([*map(str, cube.coords)]):
        if cube[name].dims or name in (SOURCE, *FORCES) or (keep_labels and name not in AXES):
            continue
        label = xr.Variable(name, [cube[name].item()], cube[name].attrs)
        along = {
            variable: each.variable.set_dims((name, *each.dims))
            for variable, each in cube.data_vars.items()
            if name not in AXES or name in VARIABLES.get(str(variable), Variable((), "")).dims
        }
        cube = cube.drop_vars(name).assign(along).assign_coords({name: label})
    return cube


def _design_dims(cube: xr.Dataset, where: str) -> tuple[str, ...]:
    """The dimensions of the designs, in the order of the schema."""
    dims, labelled = dict.fromkeys(cube["status"].dims), {*cube.indexes}
    for name in (name for name in cube.data_vars if name in VARIABLES):
        dims |= dict.fromkeys(dim for dim in cube.variables[name].dims if dim in labelled)
    dims = {dim: None for dim in map(str, dims) if dim not in AXES}
    if not dims and _is_recorded(cube):
        return ()
    for base in (DESIGN_DIMS, STRIPE_DIMS):
        if {*base} <= {*dims}:
            return tuple(dict.fromkeys((*base, *dims)))
    missing = [dim for dim in DESIGN_DIMS if dim not in dims]
    message = f"has no status along {' and '.join(missing)}"
    hint = f"keep this dimension: select {missing[0]}=[4], or {missing[0]}=4 without drop=True"
    raise _no_cube(where, f"{message}; {hint}")


def _labels(cube: xr.Dataset, dims: Sequence[str], where: str) -> dict[str, xr.Variable]:
    """The coordinates of designs and states: numbers as such, each label once."""
    labels = dict[str, xr.Variable]()
    for dim in dict.fromkeys((*dims, *(name for name in COORDINATES if name in cube.dims))):
        if dim not in cube.coords:
            if dim in (*DESIGN_DIMS, *STRIPE_DIMS, STRAIN):
                raise _no_cube(where, f"has no coordinate {dim}; keep it, or give another cube")
            if dim in dims:
                labels[dim] = xr.Variable(dim, np.arange(cube.sizes[dim]))
            continue
        variable = _in_unit(dim, cube[dim].variable.to_base_variable(), where)
        values = variable.values
        if values.dtype.kind == "f" and values.itemsize < 8:
            values = values.astype(str).astype(float)  # 0.1 of fewer digits is 0.1
        words = any(isinstance(each, str) for each in values)
        if dim == STRAIN or dim in WHOLE or (values.dtype.kind == "O" and not words):
            values = _numbers(dim, values, where)
        if dim in WHOLE and (values == np.rint(values)).all():
            values = values.astype(int)
        index = pd.Index(values)
        if index.hasnans or not index.is_unique or (dim in WHOLE and values.dtype.kind == "f"):
            twice = index[index.duplicated() | index.isna()].unique()
            shown = ", ".join(map(str, [*twice[:1]] or values))
            message = f"has {dim} = {shown}, which is no label of a single design or state"
            raise _no_cube(where, f"{message}; keep one with each label")
        labels[dim] = xr.Variable(dim, values, variable.attrs, variable.encoding)
    return labels


def _variable(cube: xr.Dataset, name: str, dims: Sequence[str], where: str) -> xr.Variable:
    """A variable of the schema along the dimensions of the designs and its own."""
    variable, own = cube.variables[name], VARIABLES[name].dims
    own = (*own, *FORCES) if STRAIN in own else own
    further = [dim for dim in variable.dims if dim not in (*dims, *own)]
    if further:
        variable = _constant(name, variable, further, where)
    if missing := {dim: cube.sizes[dim] for dim in dims if dim not in variable.dims}:
        variable = variable.set_dims({**missing, **variable.sizes})
    return _typed(name, _in_unit(name, variable, where), where)


def _constant(name: str, variable: xr.Variable, dims: Sequence[Any], where: str) -> xr.Variable:
    """A variable without dimensions along which it is the same, or missing, as masks leave it."""
    kept = [dim for dim in variable.dims if dim not in dims]
    ordered = variable.transpose(*kept, *dims)
    values = ordered.values.reshape(*(variable.sizes[dim] for dim in kept), -1)
    stated = pd.notna(values)
    first = np.take_along_axis(values, stated.argmax(axis=-1)[..., None], axis=-1)
    if not {*dims} <= AXES or ((values != first) & stated).any():
        listed = ", ".join(map(str, dims))
        raise _no_cube(where, f"has {name} along {listed}; leave it out, or give another cube")
    return xr.Variable(kept, first[..., 0], variable.attrs)


def _in_unit(name: str, variable: xr.Variable, where: str) -> xr.Variable:
    """A variable in the unit of the schema and with its attributes, where it lacks them."""
    known = KNOWN.get(name)
    if known is None:
        return variable
    stated, factor = variable.attrs.get("units", known.units), 1.0
    if stated != known.units:
        from knitlab.io.table_file import unit_factor

        try:
            hint = f"as {known.units}"
            factor = unit_factor(f"{where}: {name}", str(stated), known.units, hint)
        except InputError as error:
            raise NoCube(error.mistakes) from error
    texts = {key: each for key, each in variable.attrs.items() if key != "long_name"}
    if isinstance(label := variable.attrs.get("long_name"), str):
        texts["long_name"] = label
    attributes = known.attributes | texts | {"units": known.units}
    if factor == 1 and attributes == variable.attrs:
        return variable
    scaled = variable.copy(deep=False) if factor == 1 else factor * variable
    scaled.attrs = attributes
    return scaled


def _typed(name: str, variable: xr.Variable, where: str) -> xr.Variable:
    """A variable of the schema of its own type."""
    kind = variable.dtype.kind
    if name not in (*TEXTS, "status") and (kind == "f" or (kind == "i" and name not in INTEGERS)):
        return variable  # which may still be in its file
    values = variable.values
    if name in TEXTS:
        if kind in "iufbcmM" and pd.notna(values).any():
            raise _no_cube(where, f"has {name} of the wrong type {values.dtype}; leave it out")
        texts = np.array(["" if pd.isna(each) else _text(each) for each in values.flat], object)
        values = values if kind == "U" else texts.reshape(values.shape)
    elif name == "status":
        values = _statuses(values, where)
    else:
        values = _numbers(name, values, where)
        if name in INTEGERS and (values < 0).any():  # as programs fill integers
            values = np.where(values < 0, np.nan, values)
    return xr.Variable(variable.dims, values, variable.attrs, variable.encoding)


def _text(value: Any) -> str:
    return value.decode() if isinstance(value, bytes) else str(value)


def _numbers(name: str, values: np.ndarray, where: str) -> np.ndarray:
    """Values as numbers; NoCube if they are none."""
    if values.dtype.kind in "iufb":
        return values
    try:
        numbers = pd.to_numeric(pd.Series(values.astype(object).ravel()))
        return numbers.to_numpy(None if numbers.dtype.kind in "iu" else float).reshape(values.shape)
    except (TypeError, ValueError) as error:
        message = f"has {name} of the wrong type {values.dtype}, not numbers"
        raise _no_cube(where, f"{message}; give another cube") from error


def _statuses(values: np.ndarray, where: str) -> np.ndarray:
    """Statuses as they are stored; a missing one, also as programs fill integers, is no design."""
    if values.dtype.kind not in "iufb":
        codes = {flag.name: flag.value for flag in Status}
        named = [codes.get(each, each) for each in values.astype(object).flat]
        values = _numbers("status", np.array(named, object).reshape(values.shape), where)
    numbers = values.astype(float)
    numbers[~(numbers >= 0)] = Status.excluded
    if unknown := {*numbers.flat} - {*map(float, Status)}:
        listed = ", ".join(f"{code:g}" for code in sorted(unknown))
        raise _no_cube(where, f"has designs of the unknown status {listed}; give another cube")
    return numbers.astype(np.int8)


def _in_order(cube: xr.Dataset, dims: Sequence[str]) -> xr.Dataset:
    """The cube with its dimensions in the order of the schema, and their numbers ascending."""
    indexes = cube.indexes
    numbers = [dim for dim in COORDINATES if dim in indexes and indexes[dim].dtype.kind in "fiu"]
    unsorted = [dim for dim in numbers if not indexes[dim].is_monotonic_increasing]
    cube = cube.sortby(unsorted) if unsorted else cube
    return cube.transpose(*dict.fromkeys((*dims, *COORDINATES)), ..., missing_dims="ignore")
