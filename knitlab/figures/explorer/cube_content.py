"""A cube for the page, as JSON can hold it: dimensions, designs, variables, shapes and run."""

import base64
import io
import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from PIL import Image

from knitlab.cubes.case_file import case_path, in_cloth, is_undamaged, read_case
from knitlab.cubes.cube_file import cube_name, design_dims, is_measured, parameters_of, source_of
from knitlab.cubes.model_line import model_line
from knitlab.figures.explorer.shapes import shape_content
from knitlab.figures.style import is_signed
from knitlab.io.errors import InputError
from knitlab.io.image_file import read_image
from knitlab.observables.schema import FLAGS, STRAIN
from knitlab.observables.status import Status
from knitlab.runs.recorded_plan import read_plan
from knitlab.runs.results_folder import earlier_failures

EXPANDED = "stripe_parameter"  # a variable along it becomes one for each label
DIGITS = 6  # significant digits of the numbers on the page
NEGLIGIBLE = 1e-7  # fraction of the largest value, below which one is zero but for round-off
BAND = ("low", "high", "error")  # endings of the variables that give the band of another
NO_CASE_FILE = "Its case file is not beside the cube, so that there is no shape."
DAMAGED_CASE_FILE = "Its case file is damaged, so that there is no shape."

PROVENANCE = {
    "source": "code",
    "git_commit": "commit",
    "library_versions": "libraries",
    "python_version": "Python",
    "random_seeds": "random seeds",
    "references": "reference",
}
MAX_WIDTH = 1400  # width to which figures are reduced [pixels]
MAX_FIGURES = 10


def cube_content(cube: xr.Dataset) -> dict[str, Any]:
    """What the page holds of a cube, with what is in the results folder that it was opened from."""
    folder = Path(source).parent if (source := cube.encoding.get("source")) else None
    indices = list(map(tuple, np.argwhere(cube["status"].values != Status.excluded).tolist()))
    failures = earlier_failures(folder) if folder else {}
    designs = []
    for index in indices:
        case_id = str(cube["case_id"].values[index])
        shape, noted = _shape(cube, index, folder)
        seconds = noted.get("batch_wall_seconds")
        designs.append(
            {
                "at": index,
                "status": int(cube["status"].values[index]),
                "case_id": case_id,
                "reason": failures.get(case_id, noted).get("reason", ""),
                "seconds": None if seconds is None else float(seconds),
                "shape": None if isinstance(shape, str) else shape,
                "why_no_shape": shape if isinstance(shape, str) else "",
            }
        )
    return {
        "name": cube_name(cube),
        "title": str(cube.attrs.get("title", "")),
        "source": source_of(cube),
        "model": model_line(cube),
        "dims": [
            {
                "name": dim,
                "long_name": cube[dim].attrs.get("long_name", dim),
                "units": cube[dim].attrs.get("units", "1"),
                "values": cube[dim].values.tolist(),
            }
            for dim in design_dims(cube)
        ],
        "strains": cube[STRAIN].values.tolist(),
        "designs": designs,
        "variables": variable_contents(cube, indices),
        "run": run_report(cube, designs, folder),
        "figures": figure_contents(folder) if folder else {"shown": [], "left_out": 0},
    }


def _shape(
    cube: xr.Dataset, index: tuple[int, ...], folder: Path | None
) -> tuple[dict[str, Any] | str, dict[Any, Any]]:
    """The shape of a design, or why there is none, and the attributes of its case file."""
    if is_measured(cube):
        return "It was measured, so that there is no shape.", {}
    if folder is None:
        return "The cube was not opened from a file, so that there is no shape.", {}
    case_id = str(cube["case_id"].values[index])
    if not case_id or not case_path(folder, case_id).exists():
        return NO_CASE_FILE, {}
    if not is_undamaged(folder, case_id):
        return DAMAGED_CASE_FILE, {}
    design = cube[dict(zip(design_dims(cube), index, strict=True))]
    case = in_cloth(read_case(folder, case_id), design)
    return shape_content(case, cube[STRAIN].values), case.attrs


def variable_contents(cube: xr.Dataset, indices: Sequence[tuple[int, ...]]) -> list[dict[str, Any]]:
    """Variables of designs, of their strains or stripe parameters, with values at some designs."""
    numbers = [
        str(name)
        for name in cube.data_vars
        if name not in FLAGS and cube[name].dtype.kind in "fiub"
    ]
    contents = {one["name"]: one for name in numbers for one in _contents(cube, name, indices)}
    for name, content in contents.items():
        ends = {end: f"{name}_{end}" for end in BAND}
        content["band"] = {end: edge for end, edge in ends.items() if edge in contents}
    return list(contents.values())


def _contents(
    cube: xr.Dataset, name: str, indices: Sequence[tuple[int, ...]]
) -> Iterator[dict[str, Any]]:
    variable, dims = cube[name], design_dims(cube)
    if not set(dims) <= set(variable.dims) <= {*dims, STRAIN, EXPANDED}:
        return
    for label in cube[EXPANDED].values.tolist() if EXPANDED in variable.dims else [""]:
        one = variable.sel({EXPANDED: label} if label else {}).transpose(*dims, ...)
        values = np.array([one.values[index] for index in indices], float)
        if not np.isfinite(values).any():
            continue
        values[np.abs(values) < NEGLIGIBLE * np.nanmax(np.abs(values))] = 0
        yield {
            "name": f"{name}[{label}]" if label else name,
            "long_name": f"{one.attrs.get('long_name', name)}{f': {label}' if label else ''}",
            "units": one.attrs.get("units", "1"),
            "description": one.attrs.get("description", ""),
            "along_strain": STRAIN in one.dims,
            "signed": is_signed(name),
            "values": [
                float(f"{value:.{DIGITS}g}") if np.isfinite(value) else None
                for value in values.ravel().tolist()
            ],
        }


def run_report(
    cube: xr.Dataset, designs: Sequence[Mapping[str, Any]], folder: Path | None
) -> dict[str, Any]:
    """What ran, how long its batches took, what failed, and the code and settings behind it."""
    strains = cube[STRAIN].values
    counts = Counter(Status(design["status"]).name.replace("_", " ") for design in designs)
    known = [design["seconds"] for design in designs if design["seconds"] is not None]
    time = "not known: no case file is beside the cube"
    if batches := set(known):
        # Cases of one batch state the same time.
        time = f"{sum(batches):.0f} s, summed over {len(batches)} batches"
        if len(known) < len(designs):
            time += f"; known for {len(known)} of {len(designs)} designs"
    overridden: dict[str, Any] = {}
    if folder:
        with suppress(InputError):
            overridden = read_plan(folder)["overrides"]
    overrides = ", ".join(f"{name}={value}" for name, value in overridden.items())
    counted = ", ".join(f"{count} {name}" for name, count in counts.items())
    return {
        "facts": [
            ["workflow", str(cube.attrs.get("workflow", ""))],
            ["title", str(cube.attrs.get("title", ""))],
            ["kind", f"measured: {source_of(cube)}" if is_measured(cube) else "simulated"],
            ["method", str(cube.attrs.get("method", ""))],
            ["designs", f"{len(designs)}: {counted}"],
            ["applied strains", f"{strains.size}, from {strains.min():g} to {strains.max():g}"],
            ["computing time", time],
            *([["overridden", overrides]] if overrides else []),
        ],
        "settings": list(map(list, _flat(parameters_of(cube)))),
        "provenance": [
            [PROVENANCE[name], str(cube.attrs[name])] for name in PROVENANCE if name in cube.attrs
        ],
    }


def figure_contents(folder: Path) -> dict[str, Any]:
    """The PNG figures of a results folder, reduced for the screen, and how many are left out."""
    paths = sorted((folder / "figures").glob("*.png"))
    shown = [{"name": path.stem, "source": _reduced(path)} for path in paths[:MAX_FIGURES]]
    return {"shown": shown, "left_out": len(paths) - len(shown)}


def _reduced(path: Path) -> str:
    """A figure as the address of an image: reduced without other loss, or as it is if smaller."""
    drawn = Image.fromarray(read_image(path, of_stitches=False)[..., :3])
    stored = path.read_bytes()
    drawn.thumbnail((MAX_WIDTH, 4 * MAX_WIDTH), Image.Resampling.LANCZOS)
    written = io.BytesIO()
    drawn.save(written, "WEBP", lossless=True)
    reduced = written.getvalue()
    kind, smaller = ("webp", reduced) if len(reduced) < len(stored) else ("png", stored)
    return f"data:image/{kind};base64,{base64.b64encode(smaller).decode('ascii')}"


def _flat(table: Mapping[str, Any], within: str = "") -> Iterator[tuple[str, str]]:
    for name, value in table.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{within}{name}.")
        else:
            yield f"{within}{name}", value if isinstance(value, str) else json.dumps(value)
