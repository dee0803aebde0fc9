"""Files of figures: those that a workflow asks for, whether they are up to date, and writing them.

Matplotlib is imported only to write, so that a run with nothing to do is fast.
"""

import hashlib
import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import xarray as xr

from knitlab.cube.cube_file import cube_path, swept_dims
from knitlab.cube.selection import as_given
from knitlab.io.atomic_write import atomic_write
from knitlab.io.fingerprint import DIGITS, file_digest, package_fingerprint
from knitlab.sweep.figure_names import COMPARING, suffixes

if TYPE_CHECKING:
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    from knitlab.figures.figure_kind import Drawing

MARK = "knitlab-drawn-of:"
"""Prefix of the fingerprint that is stored in the file of every figure."""
UNDRAWN = ".svg"
"""Format that a run does not write."""
PALETTE = 256
"""Colours of a PNG: with a palette it is a third as large, and no difference can be seen."""
FRAMES_PER_SECOND = 15


@dataclass(frozen=True)
class RequestedFigure:
    """A figure that a workflow asks for: of a slice of its cube, written to several files."""

    kind: str
    selections: Mapping[str, Any]
    outputs: tuple[Path, ...]


def requested_figures(
    kinds: Iterable[str], cube: xr.Dataset, folder: Path
) -> list[RequestedFigure]:
    """The figures of a workflow, one for each value of swept settings unless it compares them."""
    swept = swept_dims(cube)
    values = itertools.product(*(cube[dim].values for dim in swept))
    slices: list[dict[str, Any]] = [dict(zip(swept, each, strict=True)) for each in values]
    requested = []
    for kind in kinds:
        for selections in [{}] if kind in COMPARING else slices:
            stem = "_".join([kind, *(f"{dim}-{value}" for dim, value in selections.items())])
            names = [f"{stem}{suffix}" for suffix in suffixes(kind) if suffix != UNDRAWN]
            outputs = tuple(folder / "figures" / name for name in names)
            requested.append(RequestedFigure(kind, selections, outputs))
    return requested


def fingerprint_of_figure(
    kind: str,
    cube_paths: Sequence[Path],
    selections: Mapping[str, Any],
    options: Mapping[str, str] = {},
) -> str:
    """Fingerprint of all that a figure depends on: cubes, their slice, code and matplotlib's.

    Raises:
        OSError: if a cube cannot be read.
    """
    chosen = [f"{name}:{value}" for name, value in options.items()]
    parts = [kind, *as_given(selections), *chosen, package_fingerprint(), version("matplotlib")]
    parts += [file_digest(cube_path(path)) for path in cube_paths]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[: 2 * DIGITS]


def is_drawn(output: Path, fingerprint: str) -> bool:
    """Whether a file holds the figure with this fingerprint."""
    return output.is_file() and f"{MARK}{fingerprint}".encode() in output.read_bytes()


def save(drawing: "Drawing", output: Path, fingerprint: str = "") -> None:
    """Write a figure or film in the format of its suffix, with the fingerprint of its sources."""
    from matplotlib.animation import FuncAnimation, PillowWriter
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    mark, suffix = f"{MARK}{fingerprint}", output.suffix.lower()
    with atomic_write(output) as temporary:
        if isinstance(drawing, FuncAnimation):
            drawing.save(temporary, writer=PillowWriter(fps=FRAMES_PER_SECOND))
            with temporary.open("ab") as film:
                # No reader minds what follows the end of a GIF.
                film.write(mark.encode())
        elif suffix == ".png":
            _write_png(FigureCanvasAgg(drawing), temporary, mark)
        else:
            FigureCanvasAgg(drawing)
            key = "Keywords" if suffix == ".pdf" else "Description"
            drawing.savefig(temporary, metadata={key: mark})


def draw_into(draw: Callable[[], "Drawing"], *outputs: Path) -> None:
    """Draw a figure in the style for print, and write it into files."""
    from knitlab.figures.style import print_style

    with print_style():
        drawing = draw()
        for output in outputs:
            save(drawing, output)


def _write_png(canvas: "FigureCanvasAgg", output: Path, mark: str) -> None:
    """Write a figure as a PNG of at most :data:`PALETTE` colours."""
    import matplotlib as mpl
    import numpy as np
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    dpi = mpl.rcParams["savefig.dpi"]
    # Not by savefig, which would compress the image only to be read again.
    canvas.figure.set_dpi(dpi)
    canvas.draw()
    image = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
    note = PngInfo()
    note.add_text("Description", mark)
    reduced = image.quantize(PALETTE, dither=Image.Dither.NONE)
    reduced.save(output, format="PNG", optimize=True, dpi=(dpi, dpi), pnginfo=note)
