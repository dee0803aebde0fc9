"""Film of a fabric that folds as it relaxes.

python docs/examples/folding.py results/relaxation/cases/NAME.nc -o folding.gif, after
knitlab run relaxation. Frames are evenly spaced in the logarithm of time.
"""

import argparse
from pathlib import Path

import xarray as xr
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.artist import Artist
from matplotlib.figure import Figure

from knitlab.figures.kinds.relaxation import snapshot_nodes
from knitlab.figures.sheets import design_text, draw_sheet, frame_sheet
from knitlab.figures.style import ONE_COLUMN, print_style

FRAMES_PER_SECOND = 15
LAST = 20
"""Frames that show the relaxed fabric."""


def animate(case: xr.Dataset) -> FuncAnimation:
    """The film of a case with snapshots."""
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

    return FuncAnimation(figure, frame, len(nodes) + LAST)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("case", type=Path)
    parser.add_argument("-o", "--output", type=Path, default=Path("folding.gif"))
    given = parser.parse_args()
    with print_style():
        film = animate(xr.load_dataset(given.case, engine="netcdf4"))
        film.save(given.output, writer=PillowWriter(fps=FRAMES_PER_SECOND))
