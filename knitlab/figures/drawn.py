"""Drawn figures: the files of a figure, and whether they are up to date."""

import hashlib
import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import xarray as xr

from knitlab.cube.cube_file import cube_path, swept_dims
from knitlab.cube.selection import as_given
from knitlab.io.fingerprint import DIGITS, file_digest, package_fingerprint
from knitlab.sweep.figure_names import COMPARING, suffixes

MARK = "knitlab-drawn-of:"
"""Prefix of the fingerprint that is stored in the file of every figure."""
UNDRAWN = ".svg"
"""Format that a run does not write."""
MOST_SLICES = 8
"""Largest number of values of swept settings for which a run draws figures."""


@dataclass(frozen=True)
class RequestedFigure:
    """A figure that a workflow asks for.

    Attributes:
        kind: name of the figure.
        selections: the slice of the cube that it shows.
        outputs: files to write.
    """

    kind: str
    selections: Mapping[str, Any]
    outputs: tuple[Path, ...]


def requested_figures(
    kinds: Iterable[str], cube: xr.Dataset, folder: Path
) -> list[RequestedFigure]:
    """The figures of a workflow, one for each value of swept settings unless it compares them.

    Args:
        kinds: names of figures.
        cube: cube of the workflow.
        folder: results folder of the workflow.
    """
    swept = swept_dims(cube)
    values = itertools.product(*(cube[dim].values for dim in swept))
    slices: list[dict[str, Any]] = [dict(zip(swept, each, strict=True)) for each in values]
    found = []
    for kind in kinds:
        for selections in [{}] if kind in COMPARING else slices:
            stem = "_".join([kind, *(f"{dim}-{value}" for dim, value in selections.items())])
            names = [f"{stem}{suffix}" for suffix in suffixes(kind) if suffix != UNDRAWN]
            outputs = tuple(folder / "figures" / name for name in names)
            found.append(RequestedFigure(kind, selections, outputs))
    return found


def fingerprint_of_figure(
    kind: str,
    cube_paths: Sequence[Path],
    selections: Mapping[str, Any],
    options: Mapping[str, str] | None = None,
) -> str:
    """Fingerprint of everything a figure depends on: cubes, code and the version of matplotlib.

    Args:
        kind: a name of a figure.
        cube_paths: cubes, or the results folders that hold them.
        selections: values by coordinate that slice the cubes.
        options: what a kind with options shows.

    Raises:
        OSError: if a cube cannot be read.
    """
    chosen = [f"{name}:{value}" for name, value in (options or {}).items()]
    parts = [kind, *as_given(selections), *chosen, package_fingerprint(), version("matplotlib")]
    parts += [file_digest(cube_path(path)) for path in cube_paths]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[: 2 * DIGITS]


def is_drawn(output: Path, fingerprint: str) -> bool:
    """Whether a file holds the figure with this fingerprint."""
    return output.is_file() and f"{MARK}{fingerprint}".encode() in output.read_bytes()
