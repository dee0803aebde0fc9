"""The report of a run: what ran, how long, what failed, by which code, and its figures."""

import base64
import io
import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import xarray as xr
from PIL import Image

from knitlab.cube.cube_file import is_measured, parameters_of, source_of
from knitlab.cube.schema import Status
from knitlab.sweep.results_folder import PLAN

PROVENANCE = {
    "source": "code",
    "git_commit": "commit",
    "library_versions": "libraries",
    "python_version": "Python",
    "random_seeds": "random seeds",
    "references": "reference",
}
WIDEST = 1400  # width to which figures are reduced [pixels]
MOST_FIGURES = 10


def run_of(
    cube: xr.Dataset, designs: Sequence[Mapping[str, Any]], folder: Path | None
) -> dict[str, Any]:
    """What ran, how long its batches took, what failed, and the code and settings behind it."""
    strains = cube["applied_strain"].values
    return {
        "facts": [
            ["workflow", str(cube.attrs.get("workflow", ""))],
            ["title", str(cube.attrs.get("title", ""))],
            ["kind", f"measured: {source_of(cube)}" if is_measured(cube) else "simulated"],
            ["method", str(cube.attrs.get("method", ""))],
            ["designs", _counted(designs)],
            ["applied strains", f"{strains.size}, from {strains.min():g} to {strains.max():g}"],
            ["computing time", _computing_time([design["seconds"] for design in designs])],
            *_planned(folder),
        ],
        "settings": list(map(list, _flat(parameters_of(cube)))),
        "provenance": [
            [PROVENANCE[name], str(cube.attrs[name])] for name in PROVENANCE if name in cube.attrs
        ],
    }


def figures_of(folder: Path) -> dict[str, Any]:
    """The PNG figures of a results folder, reduced for the screen, and how many are left out."""
    paths = sorted((folder / "figures").glob("*.png"))
    shown = [{"name": path.stem, "source": _reduced(path)} for path in paths[:MOST_FIGURES]]
    return {"shown": shown, "left_out": len(paths) - len(shown)}


def _reduced(path: Path) -> str:
    """A figure as the address of an image: reduced without other loss, or as it is if smaller."""
    stored = path.read_bytes()
    with Image.open(path) as image:
        drawn = image.convert("RGB")
    drawn.thumbnail((WIDEST, 4 * WIDEST), Image.Resampling.LANCZOS)
    written = io.BytesIO()
    drawn.save(written, "WEBP", lossless=True)
    reduced = written.getvalue()
    kind, smaller = ("webp", reduced) if len(reduced) < len(stored) else ("png", stored)
    return f"data:image/{kind};base64,{base64.b64encode(smaller).decode('ascii')}"


def _counted(designs: Sequence[Mapping[str, Any]]) -> str:
    counts = Counter(Status(design["status"]).name.replace("_", " ") for design in designs)
    return f"{len(designs)}: {', '.join(f'{count} {name}' for name, count in counts.items())}"


def _computing_time(seconds: Sequence[float | None]) -> str:
    known = [each for each in seconds if each is not None]
    if not known:
        return "not known: no case file is beside the cube"
    # Cases of one batch state the same time.
    batches = set(known)
    total = f"{sum(batches):.0f} s, summed over {len(batches)} batches"
    missing = f"; known for {len(known)} of {len(seconds)} designs"
    return total + (missing if len(known) < len(seconds) else "")


def _planned(folder: Path | None) -> Iterator[list[str]]:
    """What was overridden in the workflow, if the plan is beside the cube."""
    try:
        plan = json.loads((folder / PLAN).read_text()) if folder else {}
    except (OSError, ValueError):
        return
    if overrides := plan.get("overrides"):
        yield ["overridden", ", ".join(f"{name}={value}" for name, value in overrides.items())]


def _flat(table: Mapping[str, Any], within: str = "") -> Iterator[tuple[str, str]]:
    for name, value in table.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{within}{name}.")
        else:
            yield f"{within}{name}", value if isinstance(value, str) else json.dumps(value)
