"""Writing a calibrated stripe as an entry that workflows can use (``stripe_files``)."""

from pathlib import Path
from typing import Any

import tomli_w

from knitlab.fabric.settings import CellSize
from knitlab.fabric.stripe import Knit, Stripe
from knitlab.io.atomic_write import atomic_write
from knitlab.measure.calibration import UNITS, Calibration

DIGITS = 6
ENTRY_UNITS = {"period": "mm", **UNITS}


def stripe_row(stripe: Stripe) -> dict[str, Any]:
    """A stripe as the row of a table, its numbers to :data:`DIGITS` digits."""
    given = {name: getattr(stripe, name) for name in ENTRY_UNITS}
    row: dict[str, Any] = {
        name: float(f"{value:.{DIGITS}g}") for name, value in given.items() if value is not None
    }
    if stripe.spring_curve is not None:
        row["spring_curve"] = {
            "strain": list(stripe.spring_curve.strain),
            "force": list(stripe.spring_curve.force),
        }
    return row


def row_units(row: dict[str, Any]) -> dict[str, str]:
    """Units of the numbers of a row."""
    return {name: unit for name, unit in ENTRY_UNITS.items() if name in row}


def write_stripe_file(
    path: Path,
    knit: Knit,
    stitches: int,
    calibration: Calibration,
    curve: Path,
    cell_size: CellSize,
) -> None:
    """Write a fitted stripe in the form of ``params/stripes.toml``.

    The file of the curve is named as the source. The tabulated period depends on ``cell_size``.
    """
    errors = ", ".join(
        f"{name} {error:.2g} {UNITS[name]}" for name, error in calibration.standard_errors.items()
    )
    row = stripe_row(calibration.stripe(knit, stitches, cell_size))
    warned = "".join(f"; {warning}" for warning in calibration.warnings)
    source = (
        f"knitlab calibrate {curve.name}, relaxed period {calibration.period:g} mm, for cell_size"
        f" {cell_size}; standard errors {errors}{warned}"
    )
    table: dict[str, Any] = {
        knit: {"source": source, "unit": row_units(row), "n": {str(stitches): row}}
    }
    with atomic_write(path) as temporary:
        temporary.write_text(tomli_w.dumps(table), encoding="utf-8")
