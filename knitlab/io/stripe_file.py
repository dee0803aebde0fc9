"""Writing a calibrated stripe as an entry that workflows can use (``stripe_files``)."""

from pathlib import Path
from typing import Any

import tomli_w

from knitlab.io.atomic_write import atomic_write
from knitlab.measure.calibration import UNITS, Calibration
from knitlab.model.options import CellSize
from knitlab.model.stripe import Knit

DIGITS = 6
ENTRY_UNITS = {"period": "mm", **UNITS}


def write_stripe_file(
    path: Path,
    knit: Knit,
    stitches: int,
    calibration: Calibration,
    curve: Path,
    cell_size: CellSize,
) -> None:
    """Write a fitted stripe in the form of ``params/stripes.toml``.

    Args:
        path: the file.
        knit: rib or garter.
        stitches: across a stripe, n.
        calibration: the fit.
        curve: the file that it was fitted to, which is named as the source.
        cell_size: the model option on which the tabulated period depends.
    """
    numbers = {"period": calibration.tabulated_period(cell_size), **calibration.values}
    errors = ", ".join(
        f"{name} {error:.2g} {UNITS[name]}" for name, error in calibration.standard_errors.items()
    )
    row = {name: float(f"{numbers[name]:.{DIGITS}g}") for name in ENTRY_UNITS}
    warned = "".join(f"; {warning}" for warning in calibration.warnings)
    source = (
        f"knitlab calibrate {curve.name}, relaxed period {calibration.period:g} mm, for cell_size"
        f" {cell_size}; standard errors {errors}{warned}"
    )
    table: dict[str, Any] = {
        knit: {"source": source, "unit": ENTRY_UNITS, "n": {str(stitches): row}}
    }
    with atomic_write(path) as temporary:
        temporary.write_text(tomli_w.dumps(table), encoding="utf-8")
