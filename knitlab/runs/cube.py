"""The cube: every design that a results folder knows, on one labelled grid."""

import json
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import asdict, fields
from functools import reduce
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from knitlab.cubes.case_file import case_path, read_values
from knitlab.cubes.cube_file import (
    ATTRIBUTE,
    GAUGE,
    OPTION,
    Damaged,
    design_dims,
    differences,
    known_variables,
    parameters_of,
    read_cube,
    shared,
)
from knitlab.cubes.normalised import TEXTS, NoCube, require
from knitlab.io.errors import invalid
from knitlab.io.provenance import provenance
from knitlab.model.stitches import Gauge
from knitlab.model.stripe import STRIPE_QUANTITIES
from knitlab.observables.knit_size import ALONG_X, ALONG_Y, at_gauge, knit_sizes
from knitlab.observables.measurement import FIXED_COORDINATES, fixed_coordinates, variables_of
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
Values = dict[str, Any]
GAUGE_ATTRIBUTES = {field.name: f"{GAUGE}{field.name}" for field in fields(Gauge)}  # in mm


class Entry(NamedTuple):
    """Values of a design by variable, along the strains [1] and unit cells of its own test."""

    values: Values
    strains: tuple[float, ...]


def previous_cube(plan: Plan, path: Path) -> xr.Dataset | None:
    """The existing cube, if there is one; InputError if the plan's designs cannot be added to it.

    A damaged cube, or one that another program made unreadable, is renamed.
    """
    if not path.exists():
        return None
    try:
        cube = validated_cube(read_cube(path), path)
    except (Damaged, NoCube):
        path.replace(path.with_name(DAMAGED_CUBE))
        return None
    dims = design_dims(cube)
    if dims != plan.dims:
        message = f"has the dimensions {', '.join(dims)}, but the workflow has"
        raise invalid(str(path), f"{message} {', '.join(plan.dims)}; name another results folder")
    others = set(cube_designs(cube)) - set(plan.designs.values())
    changed = differences(parameters_of(cube), plan.common)
    listed = "; ".join(str(change) for change in changed if change.key[0] not in MAY_DIFFER)
    if others and listed:
        message = f"holds {len(others)} designs computed otherwise ({listed}); name another results"
        message += " folder, or list the values of a setting to make it a dimension"
        raise invalid(str(path), message)
    return cube


def validated_cube(cube: xr.Dataset, path: Path) -> xr.Dataset:
    """What a run stores of the simulated cube of a path; NoCube if it lacks what all have."""
    cube = known_variables(cube)
    require(cube, (*UNIT_CELLS, "code"), "runs", str(path))
    return cube


def build_cube(
    plan: Plan,
    results: Path,
    old: xr.Dataset | None,
    states: Mapping[str, CaseState],
    failed: Collection[str],
) -> xr.Dataset:
    """Cube of a plan, from its case files and the previous cube, which has the same dimensions.

    Case files replace designs of the old cube; combinations never requested are ``excluded``.
    """
    known = cube_designs(old)
    entries = {} if old is None else _entries_of(old, known)
    if old is not None and (gauge := read_gauge(old.attrs)):
        for entry in entries.values():
            sizes = {name: float(entry.values[name]) for name in (*ALONG_X, *ALONG_Y)}
            entry.values.update(at_gauge(sizes, gauge, plan.gauge))
    # A swept setting, such as contact, may give some cases variables that others lack.
    names = set() if old is None else set(map(str, old.data_vars))
    strains = set() if old is None else set(old["applied_strain"].values.tolist())
    for case_id, case in plan.cases.items():
        variables = {name for name, each in variables_of(case).items() if each.in_cube}
        names |= variables
        design = tuple(case.design.values())
        cell, state = known.get(design), states.get(case_id)
        has_results = cell is not None and cell.has_results
        whole = {*case.applied_strain} <= strains  # of which another program may leave some out
        if cell and has_results and whole and state is CaseState.done and cell.case_id == case_id:
            continue
        values, path = input_values(case), case_path(results, case_id)
        if state is not CaseState.damaged and path.is_file():
            values |= read_values(path, variables)
            values |= cloth_sizes(case, values, plan.gauge)
        elif has_results:
            continue
        else:
            status = Status.failed if case_id in failed else Status.pending
            values |= {"code": "", "status": status}
        entries[design] = Entry(values, case.applied_strain)

    pure = any(case.pure for case in plan.cases.values())
    groups = (DESIGN, STRIPES) if pure else (DESIGN, STRIPES, CLOTH)
    names |= {name for name, each in VARIABLES.items() if each.group in groups}
    designs = [*entries, *(design for design in plan.excluded if len(design) == len(plan.dims))]
    labels = dict(zip(plan.dims, zip(*designs, strict=True), strict=True))
    # A stripe number that is swept is a coordinate.
    cube = _gridded(labels, names - {*plan.dims}, entries)
    for name, coordinate in plan.coordinates.items():
        cube[name].attrs |= coordinate.attributes
    cube.attrs |= _attributes(plan, old, entries)
    if "knit_cell_x" in cube:
        cube.attrs |= gauge_attributes(plan.gauge)
    return cube


def joined_cubes(cubes: Sequence[xr.Dataset]) -> xr.Dataset:
    """One cube with the designs of several along the same dimensions, and the gauge of all.

    A design with results is taken before one without, an earlier cube before a later one.
    """
    first, rank_of = cubes[0], {Status.pending: 0, Status.failed: 1}
    entries = [
        pair for cube in cubes[::-1] for pair in _entries_of(cube, cube_designs(cube)).items()
    ]
    entries.sort(key=lambda pair: rank_of.get(pair[1].values["status"], 2))  # the last is taken
    labels = {
        dim: [label for cube in cubes for label in cube[dim].values.tolist()]
        for dim in design_dims(first)
    }
    names = {str(name) for cube in cubes for name in cube.data_vars}
    joined = _gridded(labels, names, dict(entries)).assign_attrs(first.attrs)
    for dim in labels:
        joined[dim].attrs |= first[dim].attrs
    joined.attrs[ATTRIBUTE] = json.dumps(reduce(shared, map(parameters_of, cubes)))
    return joined


def _entries_of(cube: xr.Dataset, known: Mapping[Labels, CubeDesign]) -> dict[Labels, Entry]:
    arrays = {str(name): array.values for name, array in cube.data_vars.items()}
    strains = tuple(cube["applied_strain"].values.tolist())
    return {
        design: Entry({name: array[cell.indices] for name, array in arrays.items()}, strains)
        for design, cell in known.items()
    }


def _attributes(
    plan: Plan, old: xr.Dataset | None, entries: Mapping[Labels, Entry]
) -> dict[str, str]:
    """Attributes of a cube: its provenance, and the parameters that all of its designs share."""
    common = plan.common
    planned = [entry.values["case_id"] in plan.cases for entry in entries.values()]
    if old is not None and not all(planned):
        common = shared(parameters_of(old), common) if any(planned) else parameters_of(old)
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
    labels: Mapping[str, Iterable[Any]], names: Collection[str], entries: Mapping[Labels, Entry]
) -> xr.Dataset:
    """Entries on the grid of labels: numbers ascend, texts are in order of appearance."""
    along = {dim: list(dict.fromkeys(given)) for dim, given in labels.items()}
    for given in along.values():
        if not any(isinstance(label, str) for label in given):
            given.sort()
    strains = sorted({strain for entry in entries.values() for strain in entry.strains})
    sizes = {"applied_strain": len(strains)}
    for dim, name in zip(("cell_y", "cell_x"), UNIT_CELLS, strict=True):
        sizes[dim] = max(int(entry.values[name]) for entry in entries.values())
    sizes |= {name: len(labels) for name, labels in FIXED_COORDINATES.items()}
    grid = tuple(map(len, along.values()))
    arrays: dict[str, np.ndarray] = {
        name: np.full((*grid, *(sizes[dim] for dim in variable.dims)), np.nan)
        for name, variable in VARIABLES.items()
        if name in names and name not in TEXTS
    }
    arrays["status"] = np.full(grid, Status.excluded, np.int8)
    arrays |= {name: np.full(grid, "", dtype=object) for name in TEXTS}

    index_of = [{label: k for k, label in enumerate(given)} for given in along.values()]
    rank = {strain: k for k, strain in enumerate(strains)}
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
                within = tuple(slice(0, min(size, sizes[dim])) for dim, size in extents)
                arrays[name][at][(rows, *within)] = value[(slice(None), *within)]

    variables: dict[str, Any] = {
        name: ((*along, *VARIABLES[name].dims), array) for name, array in arrays.items()
    }
    coordinates = {
        **along,
        "applied_strain": strains,
        **{dim: np.arange(sizes[dim]) for dim in ("cell_y", "cell_x")},
        **fixed_coordinates({dim for name in names for dim in VARIABLES[name].dims}),
    }
    return described(xr.Dataset(variables, coordinates))
