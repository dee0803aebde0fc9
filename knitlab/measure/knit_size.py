"""Knit size: finished sizes in cloth, from simulated contractions and the gauge.

Lengths of the network are those of the paper's tables, and its samples are several times smaller
than the cloth. Simulations predict the contraction, relaxed over flat; the gauge gives the flat
size: the number of stitches times the size of a stitch. The shipped gauge is that of the paper's
finished samples, about 200 mm wide on 360 needles, used for the stitch before the fabric folds:
absolute sizes are therefore indicative, while ratios between designs do not depend on it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

from pydantic import PositiveFloat

from knitlab.model.setting_types import Unit
from knitlab.model.stripe import GARTER_STITCHES_PER_RIB_STITCH

ALONG_X = ("knit_cell_x", "knit_wavelength_x", "knit_width")
ALONG_Y = ("knit_cell_y", "knit_wavelength_y", "knit_length")


@dataclass(frozen=True)
class Gauge:
    """Size of a stitch before the fabric folds.

    Attributes:
        stitch_width: width along the course [mm].
        stitch_height: height along the wale [mm].
    """

    stitch_width: Annotated[PositiveFloat, Unit("mm")]
    stitch_height: Annotated[PositiveFloat, Unit("mm")]


def stitches_of_cell(patches: tuple[int, int], n_subunit: int) -> tuple[int, int]:
    """Courses and wales of a unit cell (paper, Fig. "knit stitches").

    A patch is ``n_subunit`` stitches wide and, as a stitch is about twice as wide as high, twice
    as many stitches high.

    Args:
        patches: patches of a unit cell along (y, x).
        n_subunit: stitches along a garter stripe.

    Returns:
        Stitches along (y, x): (64, 32) for the checkerboard of n_subunit 16.
    """
    patches_y, patches_x = patches
    return patches_y * GARTER_STITCHES_PER_RIB_STITCH * n_subunit, patches_x * n_subunit


def knit_cell(relaxed: float, flat: float, stitches: int, stitch: float) -> float:
    """Finished length of a unit cell in cloth: contraction × stitches × stitch size.

    Args:
        relaxed: length of the relaxed cell of the network [mm].
        flat: length of the same cell flat [mm].
        stitches: number of stitches across the cell.
        stitch: size of a stitch in the same direction [mm].

    Returns:
        The length [mm]; NaN if the relaxed one is.
    """
    return relaxed / flat * stitches * stitch


def knit_sizes(
    lengths: Mapping[str, float],
    patches: tuple[int, int],
    n_subunit: int,
    unit_cells: tuple[int, int] | None,
    gauge: Gauge,
) -> dict[str, float]:
    """Finished sizes in cloth of a fabric of rib and garter patches.

    Args:
        lengths: relaxed_cell, flat_cell and wavelength of the network along x and y, by variable
            name; NaN where missing [mm].
        patches: patches of a unit cell along (y, x).
        n_subunit: stitches along a garter stripe.
        unit_cells: unit cells of the sample along (y, x), or None for periodic fabric.
        gauge: size of a stitch.

    Returns:
        The variables of :data:`ALONG_X` and :data:`ALONG_Y`: size of a unit cell, wavelength of the
        boundary, and size of the sample, which is NaN for periodic fabric [mm].
    """
    courses, wales = stitches_of_cell(patches, n_subunit)
    cells_y, cells_x = unit_cells or (float("nan"), float("nan"))
    sizes: dict[str, float] = {}
    for axis, names, stitches, stitch, cells in (
        ("x", ALONG_X, wales, gauge.stitch_width, cells_x),
        ("y", ALONG_Y, courses, gauge.stitch_height, cells_y),
    ):
        relaxed = lengths[f"relaxed_cell_{axis}"]
        cell = knit_cell(relaxed, lengths[f"flat_cell_{axis}"], stitches, stitch)
        wavelength = lengths[f"wavelength_{axis}"] * cell / relaxed
        sizes |= dict(zip(names, (cell, wavelength, cells * cell), strict=True))
    return sizes


def at_gauge(sizes: Mapping[str, float], before: Gauge, now: Gauge) -> dict[str, float]:
    """The same finished sizes at another gauge.

    Args:
        sizes: sizes of :func:`knit_sizes` [mm].
        before: the gauge that they were computed with.
        now: the requested gauge.

    Returns:
        The sizes, unchanged to the last bit if the gauge is the same [mm].
    """
    factors = dict.fromkeys(ALONG_X, now.stitch_width / before.stitch_width)
    factors |= dict.fromkeys(ALONG_Y, now.stitch_height / before.stitch_height)
    return {name: size * factors[name] for name, size in sizes.items()}
