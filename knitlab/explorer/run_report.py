"""The report of a run: what ran, how long, what failed, by which code, and its figures."""

import base64
import io
import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import netCDF4
import xarray as xr
from PIL import Image

from knitlab.execution.status import PLAN
from knitlab.explorer.page import Content
from knitlab.io.case_file import case_path
from knitlab.io.cube_file import is_measured, source_of
from knitlab.io.design_status import Status

PROVENANCE = {
    "source": "code",
    "git_commit": "commit",
    "library_versions": "libraries",
    "python_version": "Python",
    "random_seeds": "random seeds",
    "references": "reference",
}
WIDEST = 1400
"""Width to which figures are reduced [pixels]."""
COLOURS = 128
MOST_FIGURES = 12


def run_of(cube: xr.Dataset, designs: Sequence[Content], folder: Path | None) -> Content:
    """What ran, how long it took, what failed, and the code and settings behind it.

    Args:
        cube: the cube.
        designs: its designs, with ``case_id`` and ``status``.
        folder: its results folder, if it was opened from a file.
    """
    stated = json.loads(cube.attrs.get("parameters", "{}"))
    times = _batch_times([design["case_id"] for design in designs], folder)
    return {
        "facts": [
            ["workflow", str(cube.attrs.get("workflow", ""))],
            ["title", str(cube.attrs.get("title", ""))],
            ["kind", f"measured: {source_of(cube)}" if is_measured(cube) else "simulated"],
            ["method", str(cube.attrs.get("method", ""))],
            ["designs", _counted(designs)],
            ["applied strains", _strains(cube)],
            ["computing time", _computing_time(times, len(designs))],
            *_planned(folder),
        ],
        "settings": [[name, value] for name, value in _flat(stated)],
        "provenance": [
            [label, str(cube.attrs[name])]
            for name, label in PROVENANCE.items()
            if name in cube.attrs
        ],
        "seconds": [times.get(design["case_id"]) for design in designs],
    }


def figures_of(folder: Path) -> list[Content]:
    """The PNG figures of a results folder, reduced for the screen, with their names."""
    found = sorted((folder / "figures").glob("*.png"))
    return [
        {"name": path.stem, "source": f"data:image/png;base64,{_reduced(path)}"}
        for path in found[:MOST_FIGURES]
    ]


def _reduced(path: Path) -> str:
    with Image.open(path) as image:
        drawn = image.convert("RGB")
    drawn.thumbnail((WIDEST, 4 * WIDEST), Image.Resampling.LANCZOS)
    written = io.BytesIO()
    drawn.quantize(COLOURS, dither=Image.Dither.NONE).save(written, "PNG", optimize=True)
    return base64.b64encode(written.getvalue()).decode("ascii")


def _counted(designs: Sequence[Content]) -> str:
    counts = Counter(Status(design["status"]).name.replace("_", " ") for design in designs)
    return f"{len(designs)}: {', '.join(f'{count} {name}' for name, count in counts.items())}"


def _strains(cube: xr.Dataset) -> str:
    strains = cube["applied_strain"].values
    return f"{strains.size}, from {strains.min():g} to {strains.max():g}"


def _batch_times(case_ids: Sequence[str], folder: Path | None) -> dict[str, float]:
    """Wall time [s] of the batch of each case that has its file, by identifier."""
    times = {}
    for case_id in case_ids:
        if folder is None or not case_id or not case_path(folder, case_id).is_file():
            continue
        with netCDF4.Dataset(case_path(folder, case_id)) as case:
            if "batch_wall_seconds" in case.ncattrs():
                times[case_id] = float(case.getncattr("batch_wall_seconds"))
    return times


def _computing_time(times: Mapping[str, float], designs: int) -> str:
    if not times:
        return "not known: no case file is beside the cube"
    # Cases of one batch state the same time.
    total = f"{sum(set(times.values())):.0f} s in {len(set(times.values()))} batches"
    return total if len(times) == designs else f"{total}, of {len(times)} of {designs} designs"


def _planned(folder: Path | None) -> Iterator[list[str]]:
    """What was overridden in the workflow, if the plan is beside the cube."""
    try:
        plan = json.loads((folder / PLAN).read_text()) if folder else {}
    except (OSError, ValueError):
        return
    if overrides := plan.get("overrides"):
        yield ["overridden", ", ".join(map(str, overrides))]


def _flat(table: Mapping[str, Any], within: str = "") -> Iterator[tuple[str, str]]:
    """Names and values of a table and of the tables within it."""
    for name, value in table.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{within}{name}.")
        else:
            yield f"{within}{name}", value if isinstance(value, str) else json.dumps(value)
