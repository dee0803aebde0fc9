"""Experiments as cubes: records with the names, dimensions and units of simulations."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from pydantic import BaseModel

from knitlab.cubes.cube_file import (
    ATTRIBUTE,
    design_dims,
    is_measured,
    parameters_of,
    read_cube,
    write_cube,
)
from knitlab.io.cube_path import CUBE
from knitlab.io.errors import invalid
from knitlab.io.names import named_folder
from knitlab.io.provenance import MODEL, file_digest, provenance, text_digest
from knitlab.io.toml import json_table
from knitlab.lab.description import Description, RecordKind, read_description
from knitlab.lab.machine import Values, read_capacitance, read_tensile
from knitlab.lab.markers import read_markers
from knitlab.model.stripe import periods_per_patch
from knitlab.observables.schema import CYCLE, SOURCE, VARIABLES, described
from knitlab.observables.status import Status

READERS = {"markers": read_markers, "tensile": read_tensile, "capacitance": read_capacitance}
IMPORTS = "imports"


class ImportRecord(BaseModel):
    """What is read of the record of an import."""

    variables: list[str]


Imports = dict[str, ImportRecord]


@dataclass(frozen=True)
class Imported:
    """The cube of an experiment, its file, and a summary of the records in lines of text."""

    cube: xr.Dataset
    path: Path
    summary: tuple[str, ...]

    def __repr__(self) -> str:
        return f"<Imported {self.path}: {len(self.cube)} variables>"


def import_records(
    kind: RecordKind, description: str | Path, results: str | Path = "results"
) -> Imported:
    """Import laboratory records into a cube.

    Args:
        kind: ``"markers"``, ``"tensile"`` or ``"capacitance"``.
        description: TOML file that describes the records, their units and the sample.
        results: folder that holds a folder of results for each experiment.

    Returns:
        The cube, its path, and a summary of the records in lines of text.

    Raises:
        InputError: with every mistake of the description and its records.
    """
    path = Path(description)
    described = read_description(path, kind)
    cycles, summary = READERS[kind](path.parent, described)
    cube_file = named_folder(Path(results), path.stem) / CUBE
    cube = _experiment(described, cycles)
    table, tensile = getattr(described, kind), described.tensile
    files = [table.file, getattr(table, "places", None)]
    if tensile is not None and getattr(table, "strain_per_frame", None) is None:
        files.append(tensile.file)
    record = {
        "description": file_digest(path),
        "files": {name: file_digest(path.parent / name) for name in dict.fromkeys(files) if name},
        "variables": list(dict.fromkeys(name for values in cycles for name in values)),
    }
    imports: dict[str, dict[str, Any]] = {kind: record}
    if cube_file.exists():
        old = read_cube(cube_file)
        if not is_measured(old):
            message = "holds simulations; give the description another name, or another folder"
            raise invalid(str(cube_file), message)
        message = f"{IMPORTS} is not a table as knitlab writes it; import all records again"
        stated = json_table(old.attrs.get(IMPORTS, "{}"), str(cube_file), Imports, message)
        imports = {**stated, **imports}
        kept = [name for other in imports if other != kind for name in imports[other]["variables"]]
        if missing := {*kept} - {*old.data_vars}:
            raise invalid(str(cube_file), f"has no {', '.join(missing)}; import all records again")
        coordinates = (*design_dims(cube), "applied_strain", SOURCE)
        same = parameters_of(old) == parameters_of(cube) and all(
            name in old.coords and np.array_equal(old[name], cube[name]) for name in coordinates
        )
        if kept and not same:
            message = "has another sample, length, width, source, cycles or strains than the"
            hint = "remove it, and import all records again"
            raise invalid(str(cube_file), f"{message} description; {hint}")
        cube = cube.assign({name: old[name] for name in kept})
    cube.attrs[IMPORTS] = json.dumps(imports)
    write_cube(cube, cube_file)
    return Imported(cube, cube_file, tuple(summary))


def _experiment(description: Description, cycles: list[Values]) -> xr.Dataset:
    """Cube of one design, with a dimension for cycles if there are several."""
    sample, source = description.sample, description.source
    identifier = text_digest(description.model_dump_json())
    common: Values = {
        "status": np.int8(Status.ok),
        "case_id": f"{source}-{sample.n_stripe}-{sample.n_subunit}-{identifier}",
        "code": MODEL,
        "periods": periods_per_patch(sample.n_stripe, sample.n_subunit),
    }
    each_cycle = [
        xr.Dataset({name: (VARIABLES[name].dims, each) for name, each in (common | values).items()})
        for values in cycles
    ]
    cube = each_cycle[0]
    if len(cycles) > 1:
        cube = xr.concat(each_cycle, pd.RangeIndex(1, len(cycles) + 1, name=CYCLE), data_vars="all")
    cube = cube.expand_dims({"n_stripe": [sample.n_stripe], "n_subunit": [sample.n_subunit]})
    indices = {dim: np.arange(size) for dim, size in cube.sizes.items() if dim not in cube.coords}
    strains = list(description.protocol.applied_strain)
    cube = cube.assign_coords(indices | {"applied_strain": strains, SOURCE: source})
    sizes = {"length": sample.length.to("mm"), "width": sample.width.to("mm")}
    clamped = {"options": {"boundary": "clamped"}}
    attributes: dict[str, Any] = {
        "source": source,
        "title": description.title,
        "workflow": source,
        "synthetic": "yes: generated by a simulation" if description.synthetic else "no",
        ATTRIBUTE: json.dumps({"unit_cells": list(sample.unit_cells)} | sizes | clamped),
    }
    return described(cube).assign_attrs(provenance() | attributes)
