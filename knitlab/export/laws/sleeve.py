"""A sleeve on a limb: stretch, tension and pressure at every height, by the law of its fabric.

The courses run around the limb, x in the law, and the wales along it. Around a circumference C the
middle of a sleeve of thickness t and natural circumference C0 is stretched to a = (C + π t) / C0.
Along the limb it is free, so that no force acts there, or held at a ratio b of its relaxed length.
The tension over the length of the worn sleeve is T = a S_xx / b, and the pressure on a cylinder of
radius C / 2π is p = 2π T / C (Laplace).
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from jaxtyping import Float
from scipy.optimize import brentq

from knitlab.cubes.chosen_case import selected_case
from knitlab.cubes.cube_file import cube_name, design_dims
from knitlab.cubes.normalised import require
from knitlab.export.laws.law import Law
from knitlab.io.errors import InputError, invalid
from knitlab.io.table_file import read_columns
from knitlab.observables.schema import STRAIN

EXAMPLE = "write it as in 'height [mm],circumference [mm]'"
MMHG = 133.322e-6  # [N/mm²]
SIZES = ("knit_cell_x", "relaxed_cell_x", "flat_cell_x")
LEAST, MOST = 0.3, 3.0  # ratios of worn and relaxed length along the limb that are tried
UNSURE = 1 / 3
"""Part of half the thickness by which the surface that keeps its length when cloth is bent may lie
off the middle: then the error covers what networks that are rolled up press less or more."""


@dataclass(frozen=True, eq=False)
class Limb:
    """A limb by its circumferences."""

    height: Float[np.ndarray, " place"]  # [mm]
    circumference: Float[np.ndarray, " place"]  # [mm]
    unread: tuple[str, ...] = ()  # a sentence on what was not read of its file


@dataclass(frozen=True, eq=False)
class Knit:
    """What a sleeve is made of: the law, and the size of a unit cell around the limb."""

    law: Law
    wales: int  # needles that a unit cell takes
    width: float  # of a finished unit cell [mm]
    force_error: float  # of the law, relative
    thickness: float = 0.0  # of the folded cloth [mm]


def read_limb(path: Path) -> Limb:
    """The heights and circumferences of a limb in a table; InputError has every mistake."""
    columns, unread = read_columns(
        path, {"height": "mm", "circumference": "mm"}, EXAMPLE, converts=True
    )
    height, around = columns["height"], columns["circumference"]
    if not (around > 0).all():
        raise invalid(str(path), f"has a circumference of {around.min():g} mm; give all above 0")
    return Limb(height, around, unread)


def knit_of(law: Law, design: xr.Dataset, thickness: float) -> Knit:
    """The fabric of a law, with the size of its unit cell in the row of a cube."""
    require(design, SIZES, "a sleeve")
    cloth, relaxed, flat = (float(design[name]) for name in SIZES)
    wales = round(cloth / (relaxed / flat) / design.attrs["gauge_stitch_width"])
    errors = law.errors
    known = errors.loc[errors["between"], "force_error_left_out"]
    return Knit(law, wales, cloth, float(known.max()) if len(known) else math.nan, thickness)


def thickness_of(cube: xr.Dataset, design: xr.Dataset) -> float:
    """Height from the lowest to the highest node of relaxed cloth [mm]; InputError if unknown."""
    labels = {dim: design[dim].item() for dim in design_dims(cube)}
    try:
        relaxed = selected_case(cube, labels)["position"].isel({STRAIN: 0})
    except InputError as error:
        message = "has no shape of this design, which says how thick the cloth is"
        hint = "keep its case files beside it, or give thickness = MM"
        raise invalid(cube_name(cube), f"{message}; {hint}") from error
    return float(np.ptp(relaxed.sel(component="z").values))


def worn(knit: Knit, limb: Limb, needles: int, length_ratio: float | None = None) -> pd.DataFrame:
    """The sleeve of a number of needles at every height of a limb."""
    table = pd.DataFrame(
        {"height": height} | _place(knit, around, needles, length_ratio)
        for height, around in zip(limb.height, limb.circumference, strict=True)
    )
    table.attrs["unread"] = limb.unread
    table.attrs["units"] = {
        "height": "mm",
        "circumference": "mm",
        "stretch": "1",
        "length_ratio": "1",
        "tension": "N/mm",
        "pressure": "kPa",
    }
    return table


def needles_for(knit: Knit, limb: Limb, pressure: float, length_ratio: float | None = None) -> int:
    """Needles, in whole unit cells, whose pressure at the narrowest place is nearest [mmHg]."""
    around = float(limb.circumference.min())
    distances = dict[int, float]()
    for cells in range(1, math.ceil((around + math.pi * knit.thickness) / knit.width) + 1):
        place = _place(knit, around, cells * knit.wales, length_ratio)
        if place["between"]:
            distances[cells * knit.wales] = abs(place["pressure_mmHg"] - pressure)
    if not distances:
        message = f"has no sleeve of whole unit cells, of {knit.width:.3g} mm, whose stretch was"
        hint = "tested; give a cube of smaller cells or larger strains"
        raise invalid(f"limb, {around:g} mm around", f"{message} {hint}")
    return min(distances, key=lambda needles: distances[needles])


@dataclass(frozen=True)
class Stretched:
    """The fabric at a ratio of circumferences."""

    stretch: float
    length_ratio: float
    tension: float  # [N/mm]
    between: bool  # whether tests enclose the strain


def _place(knit: Knit, around: float, needles: int, length_ratio: float | None) -> dict[str, Any]:
    """The sleeve at a circumference."""
    natural = needles / knit.wales * knit.width
    a = (around + math.pi * knit.thickness) / natural
    off = math.pi * knit.thickness * UNSURE / natural
    place = _stretched(knit.law, a, length_ratio)
    tighter, looser = (_stretched(knit.law, a + d, length_ratio) for d in (off, -off))
    to_pressure = 2 * math.pi / around
    by_bending = (tighter.tension - looser.tension) / 2
    error = math.hypot(place.tension * knit.force_error, by_bending)
    return {
        "circumference": around,
        "stretch": place.stretch,
        "length_ratio": place.length_ratio,
        "tension": place.tension,
        "pressure": place.tension * to_pressure * 1000,
        "pressure_mmHg": place.tension * to_pressure / MMHG,
        "error_mmHg": error * to_pressure / MMHG,
        "between": place.between,
    }


def _stretched(law: Law, a: float, length_ratio: float | None) -> Stretched:
    is_loose = a <= 1
    b = length_ratio or (1.0 if is_loose else _free_length(law, a))
    strain = np.array([(a**2 - 1) / 2, (b**2 - 1) / 2, 0.0])
    tension = 0.0 if is_loose else float(a * law.stress(strain)[0] / b)
    is_between = is_loose or bool(np.isfinite(b) and law.covers(strain))
    return Stretched(a - 1, b, tension, is_between)


def _free_length(law: Law, around: float) -> float:
    """The ratio of lengths at which no force acts along the limb; NaN if there is none."""

    def force(along: float) -> float:
        return float(law.stress([(around**2 - 1) / 2, (along**2 - 1) / 2, 0.0])[1])

    if not force(LEAST) < 0 < force(MOST):
        return math.nan
    return float(brentq(force, LEAST, MOST))
