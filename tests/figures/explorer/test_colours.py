"""Colour maps: even in CIELAB, which is another space than the one they were made in."""

import numpy as np
import pytest
from matplotlib.colors import to_rgb

from knitlab.figures.explorer.explorer import colour_maps

WHITE = np.array([0.9505, 1.0, 1.089])
TO_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
# G. M. Machado et al., IEEE Trans. Vis. Comput. Graph. 15, 1291 (2009), severity 1.
DEFICIENT = {
    "protanopia": [[0.1523, 1.0526, -0.2049], [0.1145, 0.7863, 0.0992], [-0.0039, -0.0481, 1.0520]],
    "deuteranopia": [
        [0.3673, 0.8606, -0.2279],
        [0.2801, 0.6725, 0.0474],
        [-0.0118, 0.0429, 0.9689],
    ],
    "tritanopia": [[1.2555, -0.0767, -0.1788], [-0.0784, 0.9308, 0.1476], [0.0047, 0.6914, 0.3039]],
}


def linear(name):
    encoded = np.array([to_rgb(colour) for colour in colour_maps()[name]])
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def lab(colours):
    ratio = np.clip(colours, 0, 1) @ TO_XYZ.T / WHITE
    f = np.where(ratio > 0.008856, np.cbrt(ratio), 7.787 * ratio + 16 / 116)
    return np.stack(
        [116 * f[:, 1] - 16, 500 * (f[:, 0] - f[:, 1]), 200 * (f[:, 1] - f[:, 2])], axis=1
    )


def test_lightness_rises_evenly_where_numbers_have_one_sign():
    steps = np.diff(lab(linear("sequence"))[:, 0])
    assert steps.min() > 0
    assert steps.std() < 0.2 * steps.mean()


def test_lightness_falls_evenly_on_both_sides_of_zero():
    lightness = lab(linear("signed"))[:, 0]
    middle = len(lightness) // 2
    for side in (lightness[: middle + 1][::-1], lightness[middle:]):
        steps = -np.diff(side)
        assert steps.min() > 0
        assert steps.std() < 0.2 * steps.mean()
    assert lightness[0] == pytest.approx(lightness[-1], abs=8)
    assert lightness[middle] > 90


@pytest.mark.parametrize("vision", DEFICIENT)
def test_both_signs_are_told_apart_by_every_vision(vision):
    colours = lab(linear("signed") @ np.array(DEFICIENT[vision]).T)
    for quarter in (0, len(colours) // 4):
        assert np.linalg.norm(colours[quarter] - colours[-1 - quarter]) > 20
