"""Files of figures: each with the fingerprint of what it depends on, written atomically."""

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from knitlab.figures.drawn import MARK
from knitlab.figures.figure_kind import Drawing
from knitlab.figures.kinds.folding import FRAMES_PER_SECOND
from knitlab.io.atomic_write import atomic_write

PALETTE = 256
"""Colours of a PNG: with a palette it is a third as large, and no difference can be seen."""
_NOTE = {".png": "Description", ".svg": "Description", ".pdf": "Keywords"}
"""Metadata key of the fingerprint, by format."""


def save(drawing: Drawing, output: Path, fingerprint: str = "") -> None:
    """Write a figure or a film into a file, atomically.

    Args:
        drawing: the figure or film.
        output: the file; its suffix sets the format.
        fingerprint: of everything it depends on, for :func:`~knitlab.figures.drawn.is_drawn`.
    """
    mark = f"{MARK}{fingerprint}"
    suffix = output.suffix.lower()
    with atomic_write(output) as temporary:
        if isinstance(drawing, FuncAnimation):
            drawing.save(temporary, writer=_MarkedFilm(mark))
            return
        if suffix == ".png":
            _write_png(drawing, temporary, mark)
        else:
            FigureCanvasAgg(drawing)
            drawing.savefig(temporary, metadata={_NOTE[suffix]: mark})


def _write_png(figure: Figure, output: Path, mark: str) -> None:
    """Write a figure as a PNG of at most :data:`PALETTE` colours."""
    canvas, dpi = FigureCanvasAgg(figure), mpl.rcParams["savefig.dpi"]
    # Not by savefig, which would compress the image only to be read again.
    figure.set_dpi(dpi)
    canvas.draw()
    image = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
    note = PngInfo()
    note.add_text(_NOTE[".png"], mark)
    reduced = image.quantize(PALETTE, dither=Image.Dither.NONE)
    reduced.save(output, format="PNG", optimize=True, dpi=(dpi, dpi), pnginfo=note)


class _MarkedFilm(PillowWriter):
    """Writes a film with a comment."""

    def __init__(self, comment: str) -> None:
        super().__init__(fps=FRAMES_PER_SECOND)
        self._comment = comment

    def finish(self) -> None:
        first, *further = self._frames  # type: ignore[attr-defined]
        first.save(
            self.outfile,
            save_all=True,
            append_images=further,
            duration=1000 // self.fps,
            loop=0,
            comment=self._comment.encode(),
        )
