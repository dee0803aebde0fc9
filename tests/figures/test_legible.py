"""Figures can be read: nothing cut off, no label over another, every mark in a legend."""

import numpy as np
import pytest
import xarray as xr
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.proj3d import proj_transform

from knitlab.figures.drawing import draw
from knitlab.figures.sheets import draw_sheet, frame_sheet
from knitlab.figures.style import print_style, value_colours
from tests.cubes.artificial_cubes import synthetic_cube
from tests.figures.test_drawing import synthetic_case
from tests.figures.test_sensor import with_electrodes

CUBES = {
    "auxetic": synthetic_cube,
    "curves": synthetic_cube,
    "sensitivity": lambda: synthetic_cube(sensitivities=True),
    "sensor": with_electrodes,
    "capacitors": with_electrodes,
    "stripes": lambda: stripes_cube(),
    "samples": lambda: synthetic_case(periodic=False),
    "shape": lambda: synthetic_case(periodic=True),
}


SLOW = ("capacitors", "curves", "samples", "sensitivity", "sensor", "stripes")


def stripes_cube() -> xr.Dataset:
    """Pure stripes whose sheets depart from the zigzag the more, the narrower they are."""
    strain = np.linspace(0, 2, 9)
    dims = ("knit", "n", "boundary")
    zigzag = np.broadcast_to(strain, (2, 5, 2, 9))
    steep = np.array([1.0, 0.5, 0.3, 0.2, 0.1])[None, :, None, None]
    return xr.Dataset(
        {
            "status": (dims, np.ones((2, 5, 2), np.int8)),
            "case_id": (dims, np.full((2, 5, 2), "a")),
            "zigzag_force": ((*dims, "applied_strain"), zigzag),
            "row_force": ((*dims, "applied_strain"), zigzag * (1 + steep * strain)),
        },
        {
            "knit": ["rib", "garter"],
            "n": [2, 4, 6, 8, 16],
            "boundary": ["periodic", "clamped"],
            "applied_strain": strain,
        },
    )


def drawn(figure):
    FigureCanvasAgg(figure).draw()
    return figure


@pytest.mark.parametrize(
    "kind",
    [pytest.param(kind, marks=pytest.mark.slow if kind in SLOW else ()) for kind in CUBES],
)
def test_nothing_is_cut_off(kind):
    with print_style():
        figure = drawn(draw(kind, [CUBES[kind]()]))
        box = figure.get_tightbbox()
    width, height = figure.get_size_inches()
    room = 0.02
    assert box.x0 > -room
    assert box.y0 > -room
    assert box.x1 < width + room
    assert box.y1 < height + room


@pytest.mark.parametrize("size", [(1, 1, 0.1), (10, 1, 1), (1, 8, 3)])
def test_a_sheet_fills_its_frame_and_does_not_leave_it(size):
    y, x = np.mgrid[:5, :5] / 4
    sheet = np.stack([x, y, x * y], axis=-1) * size
    scene = Figure(figsize=(4, 3)).add_subplot(projection="3d")
    draw_sheet(scene, sheet)
    frame_sheet(scene, sheet)
    scene.apply_aspect()
    across, along, _ = proj_transform(*sheet.reshape(-1, 3).T, scene.get_proj())
    reach = max(np.abs(across).max(), np.abs(along).max()) / scene.viewLim.x1
    assert 0.9 < reach < 1


def test_colours_follow_decades_where_values_span_several():
    colours = value_colours(np.array([1e-9, 1e-6, 1e-3, np.nan]))
    assert colours.norm(1e-6) == pytest.approx(0.5)
    assert colours.get_array().tolist() == [1e-9, 1e-3]
