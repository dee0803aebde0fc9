"""Shapes of several designs side by side (paper, Fig. "relaxed configurations").

python docs/examples/shapes.py draws shapes.png beside it, from the kept cases of periodic fabric.
"""

from pathlib import Path

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from knitlab.export.meshes.fabric import closed_nodes
from knitlab.figures.figure_files import save
from knitlab.figures.sheets import draw_sheet, frame_sheet
from knitlab.figures.style import TWO_COLUMNS, print_style

REFERENCE = Path(__file__).parents[2] / "results" / "reference"
NOTE = "(n_stripe, n_subunit); size along weft and warp, and height"


def draw(cases: list[xr.Dataset]) -> Figure:
    """Shapes in perspective, relaxed; each fills its frame and is labelled with its size."""
    figure = Figure(figsize=(TWO_COLUMNS, 2.7))
    width = 1 / len(cases)
    for place, case in enumerate(cases):
        sheet = closed_nodes(case.isel(applied_strain=[0]), (2, 2))[0]
        scene = figure.add_axes((place * width, 0.0, width, 0.8), projection="3d")
        draw_sheet(scene, sheet)
        frame_sheet(scene, sheet)
        size = " × ".join(f"{extent:.3g}" for extent in np.ptp(sheet, axis=(0, 1)))
        design = f"({int(case['n_stripe'])}, {int(case['n_subunit'])})"
        middle = (place + 0.5) * width
        figure.text(middle, 0.9, f"{design}\n{size} mm", ha="center", va="center")
    figure.text(0.5, 0.01, NOTE, ha="center", fontsize="small")
    return figure


if __name__ == "__main__":
    files = sorted((REFERENCE / "periodic" / "cases").glob("*.nc"))
    with print_style():
        save(draw([xr.load_dataset(file) for file in files]), Path(__file__).with_suffix(".png"))
