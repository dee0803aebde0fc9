"""Files of figures: which a workflow asks for, whether they are up to date, and writing them.

Matplotlib is imported only to write, so that a run with nothing to do is fast.
"""

import hashlib
import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import xarray as xr

from knitlab.cubes.cube_file import swept_dims
from knitlab.cubes.selection import as_given
from knitlab.figures.registry import figure_kind
from knitlab.io.atomic_write import atomic_write
from knitlab.io.cube_path import cube_path
from knitlab.io.errors import CannotWrite, InputError, Mistake
from knitlab.io.names import inside
from knitlab.io.provenance import DIGITS, file_digest, package_digest
from knitlab.runs.figure_names import check_figure_suffix

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MARK = "knitlab-drawn-of:"  # prefix of the fingerprint that is stored in the file of every figure
MAX_FILES = 12  # of figures, one for each value of swept settings, that a run draws
COMPARING = {"load_angle": "directions", "cycle": "cycles"}  # figures of all values of a setting
RUN_SUFFIX = ".png"  # format of the figures of a run
PALETTE = 256  # colours of a PNG, which is a third as large, and no difference can be seen


@dataclass(frozen=True)
class RequestedFigure:
    """A figure that a workflow asks for, of a slice of its cube."""

    name: str
    selections: Mapping[str, Any]
    output: Path
    fingerprint: str


def requested_figures(
    names: Sequence[str], cube: xr.Dataset, folder: Path
) -> tuple[list[RequestedFigure], list[Mistake]]:
    """The figures of a workflow, one for each swept value unless it compares them, and mistakes.

    Where these would be too many files, one figure compares the values of a setting instead.
    """
    swept, mistakes = swept_dims(cube), list[Mistake]()
    # Without swept settings matplotlib, which the kinds import, is not needed to know the files.
    comparing = [name for name in names if swept and figure_kind(name).compares]
    sliced_names = [name for name in names if name not in comparing]
    number = math.prod(cube.sizes[dim] for dim in swept)
    if number > 1 and number * len(sliced_names) > MAX_FILES:
        several = [dim for dim in swept if cube.sizes[dim] > 1]
        compared = len(several) == 1 and bool(cube["poisson_ratio_min"].notnull().any())
        instead = [COMPARING.get(dim, "swept") for dim in several if compared]
        shown = f", but {instead[0]}" if instead else ""
        message = f"{', '.join(sliced_names)} are not drawn for each of {number} values{shown}"
        mistakes.append(Mistake("figures", f"{message}; draw one by knitlab map with a selection"))
        names = comparing = list(dict.fromkeys([*comparing, *instead]))
    requested, digest = list[RequestedFigure](), file_digest(cube_path(folder)) if names else ""
    for name in names:
        sliced = () if name in comparing else swept
        for values in itertools.product(*(cube[dim].values for dim in sliced)):
            selections = dict(zip(sliced, values, strict=True))
            stem = "_".join([name, *(f"{dim}-{value}" for dim, value in selections.items())])
            output = inside(folder / "figures", stem + RUN_SUFFIX)
            fingerprint = fingerprint_of_figure(name, [digest], selections)
            requested.append(RequestedFigure(name, selections, output, fingerprint))
    return requested, mistakes


def fingerprint_of_figure(
    kind: str,
    cube_digests: Sequence[str],
    selections: Mapping[str, Any],
    options: Mapping[str, str] = {},
) -> str:
    """Fingerprint of all that a figure depends on: cubes, their slice, code and matplotlib's."""
    chosen = [f"{name}:{value}" for name, value in options.items()]
    parts = [kind, *as_given(selections), *chosen, package_digest(), version("matplotlib")]
    files = [Path(value) for name, value in options.items() if name == "material"]
    parts += [*(file_digest(file) for file in files if file.is_file()), *cube_digests]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[: 2 * DIGITS]


def is_drawn(output: Path, fingerprint: str) -> bool:
    """Whether a file holds the figure with this fingerprint."""
    return output.is_file() and f"{MARK}{fingerprint}".encode() in output.read_bytes()


def save(figure: "Figure", output: Path, fingerprint: str = "") -> None:
    """Write a figure in the format of its suffix, with the fingerprint of its sources."""
    import matplotlib as mpl
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    mark, suffix, note = f"{MARK}{fingerprint}", output.suffix.lower(), PngInfo()
    key = "Keywords" if suffix == ".pdf" else "Description"
    # In memory, as matplotlib raises errors of its own where a disk is full.
    file, settings = BytesIO(), dict[str, Any](metadata={key: mark})
    if suffix == ".png":  # compressed below
        settings["pil_kwargs"] = {"compress_level": 0}
    figure.savefig(file, format=suffix.removeprefix("."), **settings)
    if suffix == ".png":
        note.add_text("Description", mark)
        image = Image.open(file).convert("RGB").quantize(PALETTE, dither=Image.Dither.NONE)
        dpi, file = (mpl.rcParams["savefig.dpi"],) * 2, BytesIO()
        image.save(file, format="PNG", optimize=True, dpi=dpi, pnginfo=note)
    with atomic_write(output) as temporary:
        temporary.write_bytes(file.getvalue())


def draw_into(draw: Callable[[], "Figure"], output: Path, fingerprint: str = "") -> None:
    """Draw a figure in the style for print into a file, unless that holds it by a fingerprint."""
    if fingerprint and is_drawn(output, fingerprint):
        return
    from knitlab.figures.style import print_style

    with print_style():
        save(draw(), output, fingerprint)


def save_figure(draw: Callable[[], "Figure"], path: str | Path) -> Path:
    """Draw a figure into a file; InputError if its suffix is not that of a figure."""
    path = Path(path)
    check_figure_suffix(path)
    draw_into(draw, path)
    return path


def maybe_draw(
    draw: Callable[[xr.Dataset], "Figure"], found: xr.Dataset, output: str | Path | None
) -> xr.Dataset:
    """What was found, after its figure is drawn into a file, if one is asked for."""
    if output is not None:
        draw_into(lambda: draw(found), Path(output))
    return found


@contextmanager
def reporting(name: str, mistakes: list[Mistake]) -> Iterator[None]:
    """Add why a figure cannot be drawn to mistakes; CannotWrite ends the drawing of all."""
    try:
        yield
    except CannotWrite:
        raise
    except InputError as error:
        mistakes += [Mistake(f"figure {name}", entry.message) for entry in error.mistakes]
