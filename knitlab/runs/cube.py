"""The cube: every design that a results folder knows, on one labelled grid.

A large cube is made in blocks of designs, each when it is written, as the whole may not fit into
memory.
"""

import itertools
import json
import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import asdict, fields
from functools import partial, reduce
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from knitlab.cubes.case_file import case_path, read_values, stored_cases
from knitlab.cubes.common_settings import differences, shared
from knitlab.cubes.cube_file import (
    ATTRIBUTE,
    GAUGE,
    OPTION,
    Damaged,
    design_dims,
    known_variables,
    parameters_of,
    read_cube,
)
from knitlab.cubes.normalised import TEXTS, NoCube, require
from knitlab.io.errors import invalid
from knitlab.io.provenance import provenance
from knitlab.model.stitches import Gauge
from knitlab.model.stripe import STRIPE_QUANTITIES
from knitlab.observables.case_variables import FIXED_COORDINATES, fixed_coordinates, variables_of
from knitlab.observables.knit_size import ALONG_X, ALONG_Y, at_gauge, knit_sizes
from knitlab.observables.of_cubes import CLOTH, DESIGN, STRIPES
from knitlab.observables.schema import VARIABLES, described
from knitlab.observables.status import Status
from knitlab.runs.plan import Plan
from knitlab.runs.results_folder import CaseState, CubeDesign, Labels, cube_designs
from knitlab.solvers.case import Case

MAY_DIFFER = ("applied_strain", "unit_cells", "solver", "sensitivities", "unloading", "robustness")
"""Parameters in which designs of one cube may differ."""
DAMAGED_CUBE = "cube-damaged.nc"
UNIT_CELLS = ("unit_cells_y", "unit_cells_x")
BLOCK_BYTES = 50e6
"""Numbers of the designs that are made and written together, and are in memory at a time."""
Values = dict[str, Any]
GAUGE_ATTRIBUTES = {field.name: f"{GAUGE}{field.name}" for field in fields(Gauge)}  # in mm


class Entry(NamedTuple):
    """Values of a design by variable, along the strains [1] and unit cells of its own test."""

    values: Values
    strains: tuple[float, ...]


class Owner(NamedTuple):
    """The first cube, of several, that has the best results of a design."""

    cube: xr.Dataset
    design: CubeDesign

    @property
    def rank(self) -> int:
        """A design with results is taken before one that failed, and this before a missing one."""
        return {Status.pending: 0, Status.failed: 1}.get(self.design.status, 2)


Owners = Mapping[Labels, Owner]


def previous_cube(plan: Plan, path: Path, refresh: bool = False) -> xr.Dataset | None:
    """The existing cube, if there is one; InputError if the plan's designs cannot be added to it.

    With ``refresh`` the plan's designs replace those that the cube has. A damaged cube, or one that
    another program made unreadable, is renamed.
    """
    if not path.exists():
        return None
    try:
        cube = validated_cube(read_cube(path, lazily=True), path)
    except (Damaged, NoCube):
        path.replace(path.with_name(DAMAGED_CUBE))
        return None
    dims = design_dims(cube)
    if dims != plan.dims:
        message = f"has the dimensions {', '.join(dims)}, but the workflow has"
        hint = f"give results = {unused_folder(path.parent.parent)}"
        raise invalid(str(path), f"{message} {', '.join(plan.dims)}; {hint}")
    _check_strains(plan, cube, path, refresh)
    others = set(cube_designs(cube)) - set(plan.designs.values())
    changed = differences(parameters_of(cube), plan.common)
    listed = "; ".join(str(change) for change in changed if change.key[0] not in MAY_DIFFER)
    if others and listed:
        message = f"holds {len(others)} designs computed otherwise ({listed}); give results ="
        message += f" {unused_folder(path.parent.parent)}, or list the values of a setting to make"
        raise invalid(str(path), f"{message} it a dimension")
    return cube


def unused_folder(folder: Path) -> Path:
    """A folder next to another, with a name that is not in use."""
    names = (folder.with_name(f"{folder.name or 'results'}-{k}") for k in itertools.count(2))
    return next(path for path in names if not path.exists())


def _check_strains(plan: Plan, cube: xr.Dataset, path: Path, refresh: bool) -> None:
    """Refuse other strains than those of designs that stay; a test may be longer or shorter."""
    before, now = cube["applied_strain"].values.tolist(), plan.applied_strain
    if all(one == other for one, other in zip(before, now, strict=False)):
        return
    known = {labels: each for labels, each in cube_designs(cube).items() if each.has_results}
    planned = set(plan.designs.values())
    apart = known.keys() - planned
    stay = (
        apart
        if refresh
        else {labels for labels, each in known.items() if each.case_id not in plan.cases}
    )
    if not stay or (planned <= known.keys() and not refresh):
        return
    grids = [f"{len(each)} strains to {each[-1]:g}" for each in (before, now)]
    message = f"holds designs at other strains ({grids[0]}, the plan has {grids[1]})"
    hint = f"give results = {unused_folder(path.parent.parent)} to keep both"
    if not apart:
        hint += ", or refresh = True to compute them again"
    raise invalid(str(path), f"{message}; {hint}")


def validated_cube(cube: xr.Dataset, path: Path) -> xr.Dataset:
    """What a run stores of the simulated cube of a path; NoCube if it lacks what all have."""
    cube = known_variables(cube)
    require(cube, (*UNIT_CELLS, "code"), "runs", str(path))
    return cube


def build_cube(
    plan: Plan,
    results: Path,
    old: Sequence[xr.Dataset],
    states: Mapping[str, CaseState],
    failed: Collection[str],
) -> xr.Dataset:
    """Cube of a plan, from its case files and earlier cubes, which have the same dimensions.

    Case files replace designs of these cubes; combinations never requested are ``excluded``. A
    large cube is one of dask, which reads the files when it is written.
    """
    known, files = owners(old), stored_cases(results)
    # A swept setting, such as contact, may give some cases variables that others lack.
    names = {str(name) for cube in old for name in cube.data_vars}
    strains = {strain for cube in old for strain in cube["applied_strain"].values.tolist()}
    new: dict[Labels, tuple[Case, Callable[[], Values]]] = {}
    for case_id, case in plan.cases.items():
        names |= _names_in_cube(case)
        design = tuple(case.design.values())
        cell, state = known[design].design if design in known else None, states.get(case_id)
        has_results = cell is not None and cell.has_results
        whole = {*case.applied_strain} <= strains  # of which another program may leave some out
        if cell and has_results and whole and state is CaseState.done and cell.case_id == case_id:
            continue
        if state is not CaseState.damaged and case_id in files:
            new[design] = case, partial(_case_values, case, results, plan.gauge)
        elif not has_results:
            status = Status.failed if case_id in failed else Status.pending
            new[design] = case, partial(dict, code="", status=status)

    pure = any(case.pure for case in plan.cases.values())
    groups = (DESIGN, STRIPES) if pure else (DESIGN, STRIPES, CLOTH)
    names |= {name for name, each in VARIABLES.items() if each.group in groups}
    kept = {design: owner for design, owner in known.items() if design not in new}
    designs = [*known, *plan.designs.values()]
    designs += [design for design in plan.excluded if len(design) == len(plan.dims)]
    cube = _gridded(
        dict(zip(plan.dims, zip(*designs, strict=True), strict=True)),
        names - {*plan.dims},  # a stripe number that is swept is a coordinate
        kept,
        new,
        plan.gauge,
    )
    for name, coordinate in plan.coordinates.items():
        cube[name].attrs |= coordinate.attributes
    planned = [True] * bool(new) + [each.design.case_id in plan.cases for each in kept.values()]
    cube.attrs |= _attributes(plan, old, planned)
    if "knit_cell_x" in cube:
        cube.attrs |= gauge_attributes(plan.gauge)
    return cube


def joined_cubes(cubes: Sequence[xr.Dataset]) -> xr.Dataset:
    """One cube with the designs of several along the same dimensions, and the gauge of all.

    A design with results is taken before one without, an earlier cube before a later one.
    """
    first = cubes[0]
    labels = {
        dim: [label for cube in cubes for label in cube[dim].values.tolist()]
        for dim in design_dims(first)
    }
    names = {str(name) for cube in cubes for name in cube.data_vars}
    joined = _gridded(labels, names, owners(cubes)).assign_attrs(first.attrs)
    for dim in labels:
        joined[dim].attrs |= first[dim].attrs
    joined.attrs[ATTRIBUTE] = json.dumps(joint_parameters(cubes))
    return joined


def joint_parameters(cubes: Iterable[xr.Dataset]) -> dict[str, Any]:
    """The parameters that all cubes share."""
    return reduce(shared, map(parameters_of, cubes))


def owners(cubes: Sequence[xr.Dataset]) -> Owners:
    """The designs of cubes, each with the cube that it is taken from."""
    known: dict[Labels, Owner] = {}
    for cube in cubes:
        for labels, design in cube_designs(cube).items():
            owner = Owner(cube, design)
            if labels not in known or owner.rank > known[labels].rank:
                known[labels] = owner
    return known


def _names_in_cube(case: Case) -> set[str]:
    """The variables of a case that a cube has."""
    return {name for name, each in variables_of(case).items() if each.in_cube}


def _case_values(case: Case, results: Path, gauge: Gauge) -> Values:
    """What a case file adds to the inputs of a case."""
    values = read_values(case_path(results, case.case_id), _names_in_cube(case))
    return values | cloth_sizes(case, values, gauge)


def _attributes(plan: Plan, old: Sequence[xr.Dataset], planned: Sequence[bool]) -> dict[str, str]:
    """Attributes of a cube: its provenance, and the parameters that all of its designs share."""
    common = plan.common
    if old and not all(planned):
        before = joint_parameters(old)
        common = shared(before, common) if any(planned) else before
    attributes = {"title": plan.title, "workflow": plan.workflow, ATTRIBUTE: json.dumps(common)}
    if plan.material is not None:
        attributes["material"] = plan.material
    if plan.yarn is not None:
        attributes |= plan.yarn.attributes
    if "method" in common:
        attributes["method"] = common["method"]
    options = {f"{OPTION}{key}": value for key, value in common.get("options", {}).items()}
    most = max((case.robustness for case in plan.cases.values()), default=0)
    seeds = {"random_seeds": f"1 to {most}: of the perturbed copies of each design"} if most else {}
    return provenance() | seeds | attributes | options


def input_values(case: Case) -> Values:
    """Sample size, periods and stripe parameters of a case, under the registry's names."""
    sizes = dict(zip(UNIT_CELLS, case.cell_grid.count, strict=True))
    stripes = {
        f"{stripe.knit}_{name}": getattr(stripe, name)
        for stripe in (case.weft, case.warp)
        for name in STRIPE_QUANTITIES
        if f"{stripe.knit}_{name}" not in case.design
    }
    return {"periods": case.periods, "case_id": case.case_id, **sizes, **stripes}


def cloth_sizes(case: Case, values: Mapping[str, Any], gauge: Gauge) -> dict[str, float]:
    """Knit sizes [mm] of a simulated case at a gauge; a pure stripe has none."""
    if case.pure:
        return {}
    kinds = ("relaxed_cell", "flat_cell", "wavelength")
    lengths = {name: float(values[name]) for kind in kinds for name in (f"{kind}_x", f"{kind}_y")}
    return knit_sizes(lengths, case.stitches, case.options.boundary == "periodic", gauge)


def gauge_attributes(gauge: Gauge) -> dict[str, float]:
    """The attributes of a cube that state its gauge [mm]."""
    return {GAUGE_ATTRIBUTES[name]: value for name, value in asdict(gauge).items()}


def read_gauge(attributes: Mapping[Any, Any]) -> Gauge | None:
    """The gauge that attributes of a cube state; those of pure stripes state none."""
    if not set(GAUGE_ATTRIBUTES.values()) <= set(attributes):
        return None
    return Gauge(**{name: float(attributes[key]) for name, key in GAUGE_ATTRIBUTES.items()})


def _gridded(
    labels: Mapping[str, Iterable[Any]],
    names: Collection[str],
    kept: Owners,
    new: Mapping[Labels, tuple[Case, Callable[[], Values]]] = {},
    gauge: Gauge | None = None,
) -> xr.Dataset:
    """Designs on the grid of labels: numbers ascend, texts are in order of appearance."""
    along = {dim: list(dict.fromkeys(given)) for dim, given in labels.items()}
    for given in along.values():
        if not any(isinstance(label, str) for label in given):
            given.sort()
    cubes = list({id(owner.cube): owner.cube for owner in kept.values()}.values())
    strains = {strain for case, _ in new.values() for strain in case.applied_strain}
    cells: list[tuple[int, ...]] = [case.cell_grid.count for case, _ in new.values()]
    for cube in cubes:
        if cube.nbytes <= BLOCK_BYTES:
            cube.load()
        strains |= {*cube["applied_strain"].values.tolist()}
        rows = [owner.design.indices for owner in kept.values() if owner.cube is cube]
        at = tuple(np.transpose(rows))
        cells.append(tuple(int(cube[name].values[at].max()) for name in UNIT_CELLS))
    sizes = {"applied_strain": len(strains)}
    sizes |= dict(zip(("cell_y", "cell_x"), map(max, zip(*cells, strict=True)), strict=True))
    sizes |= {name: len(labels) for name, labels in FIXED_COORDINATES.items()}

    def filled(dtype: Any, value: Any, dims: Sequence[str] = ()) -> xr.Variable:
        shape = [*map(len, along.values()), *(sizes[dim] for dim in dims)]
        return xr.Variable((*along, *dims), np.broadcast_to(np.array(value, dtype), shape))

    variables = {
        name: filled(float, np.nan, variable.dims)
        for name, variable in VARIABLES.items()
        if name in names and name not in TEXTS
    }
    variables["status"] = filled(np.int8, int(Status.excluded))
    variables |= {name: filled("U1", "") for name in TEXTS}
    coordinates = {
        **along,
        "applied_strain": sorted(strains),
        **{dim: np.arange(sizes[dim]) for dim in ("cell_y", "cell_x")},
        **fixed_coordinates({dim for name in names for dim in VARIABLES[name].dims}),
    }
    empty = described(xr.Dataset(variables, coordinates))

    def entries(part: xr.Dataset) -> dict[Labels, Entry]:
        found = _entries_of(cubes, part, kept, gauge)
        for design in itertools.product(*(part[dim].values.tolist() for dim in along)):
            if design in new:
                case, values = new[design]
                found[design] = Entry(input_values(case) | values(), case.applied_strain)
        return found

    def block(part: xr.Dataset) -> xr.Dataset:
        return _with_entries(part, entries(part))

    if empty.nbytes <= BLOCK_BYTES:
        return block(empty)
    import dask.array as da  # a small cube does without

    grid = tuple(map(len, along.values()))
    size = empty.nbytes // math.prod(grid)
    chunks = da.core.normalize_chunks("auto", grid, BLOCK_BYTES, np.dtype(f"V{size}"))
    whole = {
        name: da.full(each.shape, each.values.flat[0], each.dtype, chunks=-1)
        for name, each in empty.data_vars.items()
    }
    blocks = empty.copy(data=whole).chunk(dict(zip(along, chunks, strict=True)))
    return xr.map_blocks(block, blocks, template=blocks)


def _entries_of(
    cubes: Sequence[xr.Dataset], part: xr.Dataset, kept: Owners, gauge: Gauge | None
) -> dict[Labels, Entry]:
    """The designs of a part of a grid that are kept from cubes, at a gauge."""
    entries: dict[Labels, Entry] = {}
    for cube in cubes:
        dims = design_dims(cube)
        there = cube.isel({dim: _indices(cube[dim], part[dim]) for dim in dims}).load()
        arrays = {str(name): array.values for name, array in there.data_vars.items()}
        if gauge and (before := read_gauge(cube.attrs)):
            sizes = {name: arrays[name] for name in (*ALONG_X, *ALONG_Y)}
            arrays |= at_gauge(sizes, before, gauge)
        strains = tuple(there["applied_strain"].values.tolist())
        for design, cell in cube_designs(there).items():
            if design in kept and kept[design].cube is cube:
                values = {name: array[cell.indices] for name, array in arrays.items()}
                entries[design] = Entry(values, strains)
    return entries


def _indices(labels: xr.DataArray, wanted: xr.DataArray) -> slice | np.ndarray:
    """Where labels are wanted ones, as a slice if possible, which netCDF reads much faster."""
    at = np.flatnonzero(labels.isin(wanted))
    return slice(at[0], at[-1] + 1) if len(at) and at[-1] - at[0] < len(at) else at


def _with_entries(part: xr.Dataset, entries: Mapping[Labels, Entry]) -> xr.Dataset:
    """A part of a grid with its entries."""
    arrays = {
        str(name): np.array(each.values, object if name in TEXTS else None)
        for name, each in part.data_vars.items()
    }
    labels = [part[dim].values.tolist() for dim in design_dims(part)]
    index_of = [{label: k for k, label in enumerate(given)} for given in labels]
    rank = {strain: k for k, strain in enumerate(part["applied_strain"].values.tolist())}
    for design, entry in entries.items():
        at = tuple(index[label] for index, label in zip(index_of, design, strict=True))
        rows = [rank[strain] for strain in entry.strains]
        for name, value in entry.values.items():
            dims = VARIABLES[name].dims
            if "applied_strain" not in dims:
                arrays[name][at] = str(value) if name in TEXTS else value
            else:
                # Values of an old cube may be padded to more unit cells than the new one has.
                extents = zip(dims[1:], np.shape(value)[1:], strict=True)
                within = tuple(slice(0, min(size, part.sizes[dim])) for dim, size in extents)
                arrays[name][at][(rows, *within)] = value[(slice(None), *within)]
    return part.copy(data=arrays)
