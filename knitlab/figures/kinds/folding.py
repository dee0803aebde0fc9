"""The fabric folding, as a film."""

import xarray as xr
from matplotlib.animation import FuncAnimation
from matplotlib.artist import Artist
from matplotlib.figure import Figure

from knitlab.figures.figure_files import FRAMES_PER_SECOND
from knitlab.figures.figure_kind import FigureKind
from knitlab.figures.kinds.relaxation import snapshot_nodes
from knitlab.figures.sheets import design_text, draw_sheet, frame_sheet
from knitlab.figures.style import ONE_COLUMN

LAST_FRAME_HELD = 20
"""Frames for which the film rests on the relaxed shape."""


def folding_animation(case: xr.Dataset) -> FuncAnimation:
    """Film of a fabric that folds as it relaxes.

    Frames are evenly spaced in the logarithm of time.
    """
    nodes = snapshot_nodes(case)
    figure = Figure(figsize=(ONE_COLUMN * 1.3, ONE_COLUMN), dpi=120)
    scene = figure.add_axes((0, 0, 1, 0.92), projection="3d")

    def frame(number: int) -> list[Artist]:
        snapshot = min(number, len(nodes) - 1)
        scene.clear()
        draw_sheet(scene, nodes[snapshot])
        frame_sheet(scene, nodes)
        time = float(case["snapshot"][snapshot])
        figure.suptitle(f"{design_text(case)}, {time:.2g} ms", fontsize=8)
        return []

    frames = len(nodes) + LAST_FRAME_HELD
    return FuncAnimation(figure, frame, frames, interval=1000 / FRAMES_PER_SECOND)


FIGURE = FigureKind(folding_animation, needs="snapshot_position")
