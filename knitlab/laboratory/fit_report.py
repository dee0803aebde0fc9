"""The report of a fit: parameters with standard errors, and the misfit before and after."""

import itertools
from pathlib import Path

from knitlab.cube.schema import VARIABLES
from knitlab.laboratory.fit import Fit
from knitlab.laboratory.simulated_test import QUANTITIES
from knitlab.measure.calibration import ENTRY_UNITS, write_stripe_table
from knitlab.simulation.sensitivity import STRIPE_PARAMETERS

HEADER = f"{'parameter':15s} {'table':>9s} {'fitted':>9s} {'±':>8s}  {'factor':>6s}  from test"
ALIKE = 0.9
"""Correlation above which two parameters are reported as hard to separate."""


def report(fit: Fit) -> list[str]:
    """The fit as lines of text."""
    lines = [HEADER]
    for name, factor in fit.factors.items():
        side, quantity = STRIPE_PARAMETERS[name]
        before, after = (getattr(getattr(case, side), quantity) for case in (fit.before, fit.after))
        lines.append(
            f"{name:15s} {before:9.4g} {after:9.4g} {after * fit.standard_errors[name]:8.2g}"
            f"  {factor:6.3f}  {fit.learned[name]:4.0%}  [{ENTRY_UNITS[quantity]}]"
        )
    for (row, one), (column, other) in itertools.combinations(enumerate(fit.factors), 2):
        if abs(correlation := fit.correlations[row, column]) > ALIKE:
            lines.append(
                f"{one} and {other} are hard to tell apart: correlation {correlation:+.2f}"
            )
    first, last = map(fit.target.root_mean_square, fit.curves)
    for name, measured in zip(QUANTITIES, fit.target.measured, strict=True):
        if measured.any():
            lines.append(
                f"{VARIABLES[name].long_name}: RMS difference {first[name]:.3g} before,"
                f" {last[name]:.3g} after [{VARIABLES[name].units}]"
            )
    before, after = fit.chi_squared
    count = int(fit.target.measured.sum())
    lines.append(
        f"chi² {before:.4g} before, {after:.4g} after, over {count} values; {fit.tests} tests"
    )
    return lines


def write_stripes(path: Path, fit: Fit, experiment: Path) -> None:
    """Write both fitted stripes in the form of ``params/stripes.toml``, for ``stripe_files``.

    The cube of the experiment is named as their source.
    """
    stripes = []
    for side in ("weft", "warp"):
        errors = ", ".join(
            f"{STRIPE_PARAMETERS[name][1]} {error:.1%}"
            for name, error in fit.standard_errors.items()
            if STRIPE_PARAMETERS[name][0] == side
        )
        warnings = "".join(f"; {warning}" for warning in fit.warnings)
        source = f"knitlab fit {experiment}; standard errors {errors or 'none'}{warnings}"
        stripes.append((getattr(fit.after, side), source))
    write_stripe_table(path, stripes)
