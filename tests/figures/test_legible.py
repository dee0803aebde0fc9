"""What all figures share: sheets in perspective, and colours of values."""

import numpy as np
import pytest
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.proj3d import proj_transform

from knitlab.figures.sheets import draw_sheet, frame_sheet
from knitlab.figures.style import is_signed, value_colours


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


def test_colours_of_what_hardly_differs_begin_at_zero():
    colours = value_colours(np.array([0.00085, 0.00096]))
    assert colours.norm(0.00085) > 0.8
    assert colours.get_array().tolist() == [0, 0.00096]


def test_zero_is_white_for_what_can_be_negative():
    colours = value_colours(np.array([0.1, 0.4]), is_signed("poisson_ratio_min"))
    assert colours.norm(0.0) == 0.5
    assert value_colours(np.array([-0.4, -0.1])).norm(0.0) == 0.5
    assert not is_signed("reaction_force")
