"""The cube: every design that a results folder knows, on one labelled grid."""

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from knitlab.cube.case_file import case_path, read_values
from knitlab.cube.cube_file import (
    ATTRIBUTE,
    OPTION,
    design_dims,
    differences,
    ordered_labels,
    parameters_of,
    read_cube,
    shared,
)
from knitlab.cube.schema import VARIABLES, Status, described
from knitlab.fabric.stripe import STRIPE_QUANTITIES
from knitlab.io.errors import BadInput, fault
from knitlab.io.fingerprint import provenance
from knitlab.measure.knit_size import ALONG_X, ALONG_Y, Gauge, at_gauge, knit_sizes
from knitlab.simulation.case import Case
from knitlab.simulation.measurement import FIXED_COORDINATES, fixed_coordinates, variables_of
from knitlab.sweep.plan import Plan
from knitlab.sweep.results_folder import CaseState, Cell, Design, cells

TEXT_VARIABLES = ("case_id", "code")
MAY_DIFFER = ("applied_strain", "unit_cells", "solver", "sensitivities", "unloading", "robustness")
"""Parameters in which designs of one cube may differ."""
UNIT_CELLS = ("unit_cells_y", "unit_cells_x")
Values = dict[str, Any]
GAUGE_ATTRIBUTES = {field.name: f"gauge_{field.name}" for field in fields(Gauge)}  # in mm


@dataclass(frozen=True)
class Entry:
    """Values of a design by variable, along the strains [1] and unit cells of its own test."""

    values: Values
    strains: tuple[float, ...]


def previous_cube(plan: Plan, path: Path) -> xr.Dataset | None:
    """The existing cube, if there is one; BadInput if the plan's designs cannot be added to it."""
    if not path.exists():
        return None
    try:
        cube = read_cube(path)
    except BadInput as error:
        problem = "cannot be read; remove it and run again: it is rebuilt from the case files"
        raise fault(str(path), problem) from error
    dims = design_dims(cube)
    if dims != plan.dims:
        problem = f"has the dimensions {', '.join(dims)}, but the workflow has"
        raise fault(str(path), f"{problem} {', '.join(plan.dims)}; name another results folder")
    if not {*UNIT_CELLS, "code"} <= set(cube):
        raise fault(str(path), "is of another version of knitlab; name another results folder")
    others = set(cells(cube)) - set(plan.designs.values())
    changed = differences(parameters_of(cube), plan.common)
    listed = "; ".join(str(change) for change in changed if change.key[0] not in MAY_DIFFER)
    if others and listed:
        problem = f"holds {len(others)} designs computed otherwise ({listed}); name another results"
        problem += " folder, or list the values of a setting to make it a dimension"
        raise fault(str(path), problem)
    return cube


def build_cube(
    plan: Plan,
    results: Path,
    old: xr.Dataset | None,
    states: Mapping[str, CaseState],
    failed: Collection[str],
) -> xr.Dataset:
    """Cube of a plan, from its case files and the previous cube, which has the same dimensions.

    A planned case has the results of its file, unless that is damaged or done already in the old
    cube, else those of its design in the old cube, else it is ``failed`` or ``pending``. Other
    cells of the old cube are kept; combinations never requested are ``excluded``.
    """
    known = cells(old)
    entries = {} if old is None else _old_entries(plan, old, known)
    for case_id, case in plan.cases.items():
        design = tuple(case.design.values())
        cell = known.get(design)
        has_results = cell is not None and cell.has_results
        state, path = states.get(case_id), case_path(results, case_id)
        if cell and has_results and state is CaseState.done and cell.case_id == case_id:
            continue
        if state is not CaseState.damaged and path.is_file():
            wanted = {name for name, variable in variables_of(case).items() if variable.in_cube}
            values = known_in_advance(case) | read_values(path, wanted)
            values |= sizes_of(case, values, plan.gauge)
            entries[design] = Entry(values, case.applied_strain)
        elif not has_results:
            status = Status.failed if case_id in failed else Status.pending
            values = known_in_advance(case) | {"code": "", "status": status}
            entries[design] = Entry(values, case.applied_strain)

    cube = _gridded(plan, _names(plan, old), entries)
    cube.attrs |= _attributes(plan, old, entries)
    if "knit_cell_x" in cube:
        cube.attrs |= stated_gauge(plan.gauge)
    return cube


def _names(plan: Plan, old: xr.Dataset | None) -> list[str]:
    """Variables of the cube, in the order of the registry."""
    case = next(iter(plan.cases.values()))
    # A swept setting, such as contact, may give some cases variables that others lack.
    wanted = set() if old is None else set(map(str, old.data_vars))
    for each in plan.cases.values():
        wanted |= {name for name, variable in variables_of(each).items() if variable.in_cube}
    kinds = ("design", "stripes") if case.pure else ("design", "stripes", "cloth")
    named = [name for name, each in VARIABLES.items() if name in wanted or each.of in kinds]
    # A stripe number that is swept is a coordinate.
    return [name for name in named if name not in plan.dims]


def _old_entries(plan: Plan, old: xr.Dataset, known: Mapping[Design, Cell]) -> dict[Design, Entry]:
    """The cells of an old cube, with knit sizes at the gauge of the new one."""
    arrays = {str(name): old[name].values for name in old.data_vars}
    strains = tuple(old["applied_strain"].values.tolist())
    gauge, entries = gauge_of(old.attrs), {}
    for design, cell in known.items():
        values = {name: array[cell.indices] for name, array in arrays.items()}
        if gauge is not None:
            sizes = {name: float(values[name]) for name in (*ALONG_X, *ALONG_Y)}
            values |= at_gauge(sizes, gauge, plan.gauge)
        entries[design] = Entry(values, strains)
    return entries


def _attributes(
    plan: Plan, old: xr.Dataset | None, entries: Mapping[Design, Entry]
) -> dict[str, str]:
    """Attributes of a cube: its provenance, and the parameters that all of its designs share."""
    common = plan.common
    planned = [entry.values["case_id"] in plan.cases for entry in entries.values()]
    if old is not None and not all(planned):
        common = shared(parameters_of(old), common) if any(planned) else parameters_of(old)
    attributes = {"title": plan.title, "workflow": plan.workflow, ATTRIBUTE: json.dumps(common)}
    if plan.material is not None:
        attributes["material"] = plan.material
    if "method" in common:
        attributes["method"] = common["method"]
    options = {f"{OPTION}{key}": value for key, value in common.get("options", {}).items()}
    most = max((case.robustness for case in plan.cases.values()), default=0)
    seeds = {"random_seeds": f"1 to {most}: of the siblings of each design"} if most else {}
    return provenance() | seeds | attributes | options


def known_in_advance(case: Case) -> Values:
    """Sample size, periods and stripe parameters of a case, under the registry's names."""
    sizes = dict(zip(UNIT_CELLS, case.cell_grid.count, strict=True))
    stripes = {
        f"{stripe.knit}_{name}": getattr(stripe, name)
        for stripe in (case.weft, case.warp)
        for name in STRIPE_QUANTITIES
        if f"{stripe.knit}_{name}" not in case.design
    }
    return {"periods": case.periods, "case_id": case.case_id, **sizes, **stripes}


def sizes_of(case: Case, values: Mapping[str, Any], gauge: Gauge) -> dict[str, float]:
    """Knit sizes [mm] of a simulated case at a gauge; a pure stripe has none."""
    if case.pure:
        return {}
    names = (
        f"{kind}_{axis}" for kind in ("relaxed_cell", "flat_cell", "wavelength") for axis in "xy"
    )
    lengths = {name: float(values[name]) for name in names}
    return knit_sizes(lengths, case.stitches, case.options.boundary == "periodic", gauge)


def stated_gauge(gauge: Gauge) -> dict[str, float]:
    """The attributes of a cube that state its gauge [mm]."""
    return {GAUGE_ATTRIBUTES[name]: value for name, value in asdict(gauge).items()}


def gauge_of(attributes: Mapping[Any, Any]) -> Gauge | None:
    """The gauge that attributes of a cube state; those of pure stripes state none."""
    if not set(GAUGE_ATTRIBUTES.values()) <= set(attributes):
        return None
    return Gauge(**{name: float(attributes[key]) for name, key in GAUGE_ATTRIBUTES.items()})


def _gridded(plan: Plan, names: Sequence[str], entries: Mapping[Design, Entry]) -> xr.Dataset:
    designs = [*entries, *(design for design in plan.excluded if len(design) == len(plan.dims))]
    labels = [ordered_labels(along) for along in zip(*designs, strict=True)]
    strains = sorted({strain for entry in entries.values() for strain in entry.strains})
    sizes = {"applied_strain": len(strains)}
    for dim, name in zip(("cell_y", "cell_x"), UNIT_CELLS, strict=True):
        sizes[dim] = max(int(entry.values[name]) for entry in entries.values())
    sizes |= {name: len(labels) for name, labels in FIXED_COORDINATES.items()}
    grid = tuple(map(len, labels))
    arrays: dict[str, np.ndarray] = {
        name: np.full((*grid, *(sizes[dim] for dim in VARIABLES[name].dims)), np.nan)
        for name in names
        if name not in TEXT_VARIABLES
    }
    arrays["status"] = np.full(grid, Status.excluded, np.int8)
    arrays |= {name: np.full(grid, "", dtype=object) for name in TEXT_VARIABLES}

    index_of = [{label: k for k, label in enumerate(along)} for along in labels]
    rank = {strain: k for k, strain in enumerate(strains)}
    for design, entry in entries.items():
        at = tuple(along[label] for along, label in zip(index_of, design, strict=True))
        rows = [rank[strain] for strain in entry.strains]
        for name, value in entry.values.items():
            dims = VARIABLES[name].dims
            if "applied_strain" not in dims:
                arrays[name][at] = str(value) if name in TEXT_VARIABLES else value
            else:
                # Values of an old cube may be padded to more unit cells than the new one has.
                extents = zip(dims[1:], np.shape(value)[1:], strict=True)
                within = tuple(slice(0, min(size, sizes[dim])) for dim, size in extents)
                arrays[name][at][(rows, *within)] = value[(slice(None), *within)]

    variables: dict[str, Any] = {
        name: ((*plan.dims, *VARIABLES[name].dims), array) for name, array in arrays.items()
    }
    coordinates = {
        **dict(zip(plan.dims, labels, strict=True)),
        "applied_strain": strains,
        **{dim: np.arange(sizes[dim]) for dim in ("cell_y", "cell_x")},
        **fixed_coordinates({dim for name in names for dim in VARIABLES[name].dims}),
    }
    cube = described(xr.Dataset(variables, coordinates))
    for name, coordinate in plan.coordinates.items():
        cube[name].attrs |= coordinate.attributes
    return cube
