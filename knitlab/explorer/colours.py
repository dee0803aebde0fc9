"""Colour maps of the page: perceptually uniform, and told apart without colour vision.

Numbers of one sign have matplotlib's viridis. Numbers of both signs go from blue through near white
to orange, in equal steps of lightness on both sides of zero; the two hues differ for every kind of
colour vision.
"""

import matplotlib as mpl
import numpy as np
from jaxtyping import Float
from matplotlib.colors import to_hex

from knitlab.figures.style import SEQUENCE_COLOURS

STEPS = 33
LIGHTEST, DARKEST = 0.97, 0.47
"""Lightness in OKLab at zero and at both ends."""
BLUE, ORANGE = np.array([-0.035, -0.135]), np.array([0.105, 0.095])
"""Chromatic coordinates (a, b) in OKLab at the ends."""
TO_CONE_ROOTS = np.array(
    [
        [1, 0.3963377774, 0.2158037573],
        [1, -0.1055613458, -0.0638541728],
        [1, -0.0894841775, -1.2914855480],
    ]
)
TO_LINEAR_RGB = np.array(
    [
        [4.0767416621, -3.3077115913, 0.2309699292],
        [-1.2684380046, 2.6097574011, -0.3413193965],
        [-0.0041960863, -0.7034186147, 1.7076147010],
    ]
)
"""From B. Ottosson, A perceptual color space for image processing, 2020."""


def colour_maps() -> dict[str, list[str]]:
    """Colours as ``#rrggbb``, from the lowest value to the highest, by the name of their map."""
    sequence = mpl.colormaps[SEQUENCE_COLOURS](np.linspace(0, 1, STEPS))
    return {
        "sequence": [to_hex(colour) for colour in sequence],
        "signed": [to_hex(colour) for colour in signed_colours(STEPS)],
    }


def signed_colours(steps: int) -> Float[np.ndarray, "step 3"]:
    """Colours (red, green, blue) from 0 to 1 for values from -1 to 1."""
    value = np.linspace(-1, 1, steps)[:, None]
    lightness = LIGHTEST + (DARKEST - LIGHTEST) * np.abs(value)
    hue = np.where(value < 0, BLUE, ORANGE) * np.abs(value)
    linear = (np.hstack([lightness, hue]) @ TO_CONE_ROOTS.T) ** 3 @ TO_LINEAR_RGB.T
    linear = np.clip(linear, 0, 1)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return np.clip(encoded, 0, 1)
