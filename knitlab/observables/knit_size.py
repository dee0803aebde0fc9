"""Knit size: finished sizes in cloth, from simulated contractions and the gauge.

Samples in the paper's tables are several times smaller than in cloth. Simulations predict the
contraction, relaxed over flat; the gauge gives the flat size of a stitch.
"""

from collections.abc import Mapping

import numpy as np

from knitlab.model.stitches import Gauge, Stitches

ALONG_X = ("knit_cell_x", "knit_wavelength_x", "knit_width")
ALONG_Y = ("knit_cell_y", "knit_wavelength_y", "knit_length")


def knit_sizes(
    lengths: Mapping[str, float], stitches: Stitches, periodic: bool, gauge: Gauge
) -> dict[str, float]:
    """Finished sizes in cloth of a fabric of patches: contraction × stitches × stitch size [mm].

    By :data:`ALONG_X` and :data:`ALONG_Y` they are those of a unit cell, of the wave of its
    boundary, and of the sample, NaN if periodic.
    """
    sizes: dict[str, float] = {}
    for axis, names, in_cell, whole, stitch in (
        ("x", ALONG_X, stitches.wales_in_cell, stitches.wales, gauge.stitch_width),
        ("y", ALONG_Y, stitches.courses_in_cell, stitches.courses, gauge.stitch_height),
    ):
        relaxed, flat = lengths[f"relaxed_cell_{axis}"], lengths[f"flat_cell_{axis}"]
        cell = relaxed / flat * in_cell * stitch
        wavelength = lengths[f"wavelength_{axis}"] * cell / relaxed
        sample = float("nan") if periodic else whole / in_cell * cell
        sizes |= dict(zip(names, (cell, wavelength, sample), strict=True))
    return sizes


def at_gauge(sizes: Mapping[str, np.ndarray], before: Gauge, now: Gauge) -> dict[str, np.ndarray]:
    """Sizes of :func:`knit_sizes` at another gauge; bitwise unchanged if it is the same [mm]."""
    factors = dict.fromkeys(ALONG_X, now.stitch_width / before.stitch_width)
    factors |= dict.fromkeys(ALONG_Y, now.stitch_height / before.stitch_height)
    return {name: size * factors[name] for name, size in sizes.items()}
