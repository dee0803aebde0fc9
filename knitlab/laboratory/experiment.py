"""Experiments as cubes: records with the names, dimensions and units of simulations."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Float

from knitlab.cube.common_settings import ATTRIBUTE, parameters_of
from knitlab.cube.cube_file import design_dims, is_measured, open_cube, write_cube
from knitlab.cube.design_status import Status
from knitlab.cube.plain_cube import CUBE
from knitlab.cube.schema import CYCLE, DESIGN_DIMS, SOURCE, VARIABLES, described
from knitlab.fabric.stripe import periods_per_patch
from knitlab.io.errors import BadInput, fault
from knitlab.io.fingerprint import code_fingerprint, file_digest, text_fingerprint
from knitlab.io.provenance import provenance
from knitlab.laboratory.description import Description, RecordKind, read_description
from knitlab.laboratory.machine import (
    Pulls,
    Values,
    capacitance_values,
    force_values,
    read_capacitance,
    read_pulls,
)
from knitlab.laboratory.markers import along_pull, marker_values, read_marked
from knitlab.laboratory.quantities import number
from knitlab.measure.cycles import Cycle
from knitlab.sweep.parameters import defaults

IMPORTS = "imports"
LARGEST_AT_REST = 0.25
"""Largest strain of the reference shape, as a fraction of the first applied strain."""
LEAST_FOLLOWED = 0.02
"""Axial strain at the centre over applied strain, below which a sample counts as unloaded."""
COMMON_VARIABLES = ("status", "case_id", "code", "periods")
"""Variables that every import has."""


@dataclass(frozen=True)
class Imported:
    """An import.

    Attributes:
        cube: the cube of the experiment.
        path: file of the cube.
        summary: summary of the records, in lines of text.
    """

    cube: xr.Dataset
    path: Path
    summary: tuple[str, ...]

    def __repr__(self) -> str:
        return f"<Imported {self.path}: {len(self.cube)} variables>"


def import_records(kind: RecordKind, path: Path, results: Path) -> Imported:
    """Import the records of one kind that a description names into the experiment's cube.

    The cube is written to a folder with the name of the description. Records of other kinds that
    it already holds are kept, if they are of the same sample at the same strains.

    Args:
        kind: kind of the records.
        path: the description, a TOML file beside the records.
        results: folder of results.

    Raises:
        BadInput: with every fault that was found; nothing is written then.
    """
    description = read_description(path, kind)
    cycles, summary = _READERS[kind](path.parent, description)
    cube_file = results / path.stem / CUBE
    cube = _experiment(description, cycles)
    files = {name: file_digest(path.parent / name) for name in _files(description, kind)}
    names = [str(name) for name in cube.data_vars if name not in COMMON_VARIABLES]
    imports = {kind: {"description": file_digest(path), "files": files, "variables": names}}
    if cube_file.exists():
        old = open_cube(cube_file)
        if not is_measured(old):
            raise fault(
                str(cube_file),
                "holds simulations; give the description another name, or another folder",
            )
        imports = json.loads(old.attrs.get(IMPORTS, "{}")) | imports
        others = [
            name for other in imports if other != kind for name in imports[other]["variables"]
        ]
        _check_same(old, cube, others, description, cube_file)
        cube = cube.assign({name: old[name] for name in others})
    cube.attrs |= _attributes(description) | {IMPORTS: json.dumps(imports)}
    write_cube(cube, cube_file)
    return Imported(cube, cube_file, tuple(summary))


Read = tuple[list[Values], list[str]]


def _read_markers(folder: Path, description: Description) -> Read:
    table, tensile = description.markers, description.tensile
    if table is None:
        raise TypeError("the description has no markers")
    marked = read_marked(folder, table, description.sample)
    frames = np.arange(len(marked.corners))
    requested, path = description.protocol.applied_strain, folder / table.file
    if table.strain_per_frame is not None:
        strain = frames * table.strain_per_frame
        if strain[-1] < requested[-1] * (1 - 1e-9):
            raise fault(
                str(path),
                f"ends at an applied strain of {strain[-1]:.3g}, but strain_max is"
                f" {requested[-1]:g}; reduce strain_max",
            )
        pulls, spans = None, [frames]
    elif table.frame_rate is not None and table.starts is not None and tensile is not None:
        pulls = read_pulls(folder, description, tensile)
        time = number(table.starts, "s") + frames / number(table.frame_rate, "Hz")
        strain = pulls.strain(time)
        seen = np.isfinite(strain)
        spans = [np.flatnonzero(cycle.loaded(time) & seen) for cycle in pulls.cycles]
        if not len(spans[0]):
            raise _another_time(path, time, pulls)
    else:
        raise TypeError("the description has no times for its frames")
    _check_at_rest(path, strain[: table.relaxed_frames], requested[1])
    if table.align == "pull":
        marked = along_pull(path, marked, strain)
    values = [marker_values(marked, requested, strain[span], span) for span in spans]
    _check_from_rest(path, values[0], requested)
    summary = [marked.summary, *([_counted(pulls)] if pulls else [])]
    if not np.isfinite(values[0]["mean_strain_yy"]).any():
        summary.append("no central unit cell keeps its markers, so there are no mean strains")
    return values, summary


def _check_at_rest(path: Path, strain: Float[np.ndarray, " frame"], step: float) -> None:
    """Check that the frames of the relaxed shape precede the pull.

    Raises:
        BadInput: if they do not.
    """
    pulled = np.nanmax(np.abs(strain), initial=0.0)
    if pulled > LARGEST_AT_REST * step:
        raise fault(
            f"{path}: relaxed_frames {len(strain)}",
            f"already reach a strain of {pulled:.3g}; give fewer, or correct starts or"
            " strain_per_frame",
        )


def _check_from_rest(path: Path, values: Values, requested: Sequence[float]) -> None:
    """Check that the fabric is strained if and only if the machine pulls it.

    Raises:
        BadInput: if not.
    """
    mean = values["mean_strain_yy"]
    if abs(mean[0]) > max(requested[1] / 2, 5 * np.nan_to_num(values["mean_strain_yy_error"][0])):
        raise fault(
            str(path),
            f"shows an axial strain of {mean[0]:.3g} where the applied strain is 0; correct starts"
            " or relaxed_frames",
        )
    if np.isfinite(mean).any() and np.nanmax(np.abs(mean)) < LEAST_FOLLOWED * requested[-1]:
        problem = "shows markers that do not move while the sample is pulled; correct starts"
        raise fault(str(path), problem)


def _another_time(path: Path, time: Float[np.ndarray, " frame"], pulls: Pulls) -> BadInput:
    first = pulls.cycles[0]
    return fault(
        str(path),
        f"runs from {time[0]:g} s to {time[-1]:g} s by the machine's clock, and does not cover"
        f" the first pull, from {first.start:g} s to {first.turn:g} s; correct starts or"
        " frame_rate",
    )


def _read_tensile(folder: Path, description: Description) -> Read:
    if description.tensile is None:
        raise TypeError("the description has no tensile test")
    pulls = read_pulls(folder, description, description.tensile)
    return [force_values(pulls, cycle, description) for cycle in pulls.cycles], [_counted(pulls)]


def _read_capacitance(folder: Path, description: Description) -> Read:
    table, tensile = description.capacitance, description.tensile
    if table is None or tensile is None:
        raise TypeError("the description has no capacitance with a tensile test")
    pulls = read_pulls(folder, description, tensile)
    log, time = read_capacitance(folder, table, pulls)
    strains = np.array(description.protocol.applied_strain)
    least = defaults().capacitor.linearity

    def values_of(cycle: Cycle) -> Values:
        return capacitance_values(log, time, pulls, cycle, strains, least)

    shift = f"the meter's clock is {time[0] - log.time[0]:+.3g} s from the machine's"
    return [values_of(cycle) for cycle in pulls.cycles], [_counted(pulls), shift]


_READERS = {
    "markers": _read_markers,
    "tensile": _read_tensile,
    "capacitance": _read_capacitance,
}


def _counted(pulls: Pulls) -> str:
    count = len(pulls.cycles)
    return f"{count} cycle{'s' if count > 1 else ''} of the machine"


def _files(description: Description, kind: RecordKind) -> list[str]:
    """Files that an import of one kind reads."""
    markers, capacitance, tensile = (
        description.markers,
        description.capacitance,
        description.tensile,
    )
    files = [tensile.file] if tensile is not None else []
    if kind == "markers" and markers is not None:
        timed = markers.frame_rate is not None
        return [markers.file, *([markers.places] if markers.places else []), *(files * timed)]
    if kind == "capacitance" and capacitance is not None:
        return [capacitance.file, *files]
    return files


def _experiment(description: Description, cycles: list[Values]) -> xr.Dataset:
    """Cube of one design, with a dimension for cycles if there are several."""
    sample, strains = description.sample, description.protocol.applied_strain
    labels = {"n_stripe": [sample.n_stripe], "n_subunit": [sample.n_subunit]}
    coordinates: dict[str, Any] = {**labels, "applied_strain": list(strains)}
    if len(cycles) > 1:
        coordinates[CYCLE] = np.arange(1, len(cycles) + 1)
    stated = [description.source, *map(str, (sample.n_stripe, sample.n_subunit))]
    identifier = text_fingerprint(description.model_dump_json())
    common: Values = {
        "status": np.int8(Status.ok),
        "case_id": "-".join([*stated, identifier]),
        "code": code_fingerprint(),
        "periods": periods_per_patch(sample.n_stripe, sample.n_subunit),
    }
    variables: dict[str, Any] = {}
    dims = (*DESIGN_DIMS, CYCLE) if len(cycles) > 1 else DESIGN_DIMS
    for name in dict.fromkeys([*common, *(name for values in cycles for name in values)]):
        dims_of_variable = VARIABLES[name].dims
        known = [(common | values).get(name) for values in cycles]
        shape = next(np.shape(value) for value in known if value is not None)
        filled = [np.full(shape, np.nan) if value is None else value for value in known]
        array = np.array(filled, dtype=object if isinstance(filled[0], str) else None)
        if len(cycles) == 1:
            array = array[0]
        variables[name] = ((*dims, *dims_of_variable), np.asarray(array)[None, None])
        for dim, size in zip(dims_of_variable, shape, strict=True):
            if dim != "applied_strain":
                coordinates[dim] = np.arange(size)
    coordinates[SOURCE] = description.source
    return described(xr.Dataset(variables, coordinates))


def _check_same(
    old: xr.Dataset, new: xr.Dataset, kept: list[str], description: Description, path: Path
) -> None:
    """Check that an existing cube has the same sample and strains.

    Raises:
        BadInput: if it is not.
    """
    coordinates = (*design_dims(new), "applied_strain", SOURCE)
    same = set(coordinates) <= set(old.coords) and all(
        np.array_equal(old[name], new[name]) for name in coordinates
    )
    if kept and not (same and parameters_of(old) == _parameters(description)):
        raise fault(
            str(path),
            "has another sample, length, width, source, cycles or strains than the description;"
            " remove it, and import all records again",
        )


def _parameters(description: Description) -> dict[str, Any]:
    """Parameters of the sample, as attributes of the cube."""
    sample = description.sample
    return {
        "unit_cells": list(sample.unit_cells),
        "length": number(sample.length, "mm"),
        "width": number(sample.width, "mm"),
        "reading": {"boundary": "clamped"},
    }


def _attributes(description: Description) -> dict[str, str]:
    attributes = {
        "title": description.title,
        "workflow": description.source,
        "synthetic": "yes: made up by a simulation" if description.synthetic else "no",
        ATTRIBUTE: json.dumps(_parameters(description)),
    }
    return provenance() | {"source": description.source} | attributes
