"""The report of a fit: parameters with standard errors, and the misfit before and after."""

import itertools
from pathlib import Path
from typing import Any

import tomli_w

from knitlab.cube.schema import VARIABLES
from knitlab.fabric.stripe import Stripe
from knitlab.io.atomic_write import atomic_write
from knitlab.laboratory.fit import Fit, root_mean_square
from knitlab.laboratory.simulated_test import QUANTITIES
from knitlab.measure.stripe_file import ENTRY_UNITS, row_units, stripe_row
from knitlab.simulation.case import Case
from knitlab.simulation.sensitivity import STRIPE_PARAMETERS

HEADER = f"{'parameter':15s} {'table':>9s} {'fitted':>9s} {'±':>8s}  {'factor':>6s}  from test"
ALIKE = 0.9
"""Correlation above which two parameters are reported as hard to separate."""


def report(fit: Fit) -> list[str]:
    """The fit as lines of text."""
    lines = [HEADER]
    for name in fit.names:
        before, after = (_value(case, name) for case in (fit.before, fit.after))
        error = after * fit.standard_errors[name]
        unit = ENTRY_UNITS[STRIPE_PARAMETERS[name][1]]
        lines.append(
            f"{name:15s} {before:9.4g} {after:9.4g} {error:8.2g}  {fit.factors[name]:6.3f}"
            f"  {fit.learned[name]:4.0%}  [{unit}]"
        )
    for one, other in itertools.combinations(range(len(fit.names)), 2):
        if abs(fit.correlations[one, other]) > ALIKE:
            lines.append(
                f"{fit.names[one]} and {fit.names[other]} are hard to tell apart: correlation"
                f" {fit.correlations[one, other]:+.2f}"
            )
    first, last = (root_mean_square(curves, fit.target) for curves in fit.curves)
    for place, name in enumerate(QUANTITIES):
        if fit.target.measured[place].any():
            unit = VARIABLES[name].units
            lines.append(
                f"{VARIABLES[name].long_name}: RMS difference {first[name]:.3g} before,"
                f" {last[name]:.3g} after [{unit}]"
            )
    count = int(fit.target.measured.sum())
    lines.append(
        f"chi² {fit.chi_squared[0]:.4g} before, {fit.chi_squared[1]:.4g} after, over {count}"
        f" values; {fit.tests} tests"
    )
    return lines


def _value(case: Case, name: str) -> float:
    side, quantity = STRIPE_PARAMETERS[name]
    return float(getattr(getattr(case, side), quantity))


def write_stripes(path: Path, fit: Fit, experiment: Path) -> None:
    """Write both fitted stripes in the form of ``params/stripes.toml``, for ``stripe_files``.

    Args:
        path: the file.
        fit: the fit.
        experiment: the cube that it was fitted to, which is named as the source.
    """
    table: dict[str, Any] = {}
    for side in ("weft", "warp"):
        stripe: Stripe = getattr(fit.after, side)
        names = [name for name in fit.names if STRIPE_PARAMETERS[name][0] == side]
        errors = ", ".join(
            f"{STRIPE_PARAMETERS[name][1]} {fit.standard_errors[name]:.1%}" for name in names
        )
        warnings = "".join(f"; {warning}" for warning in fit.warnings)
        row = stripe_row(stripe)
        table[stripe.knit] = {
            "source": f"knitlab fit {experiment}; standard errors {errors or 'none'}{warnings}",
            "unit": row_units(row),
            "n": {str(stripe.n): row},
        }
    with atomic_write(path) as temporary:
        temporary.write_text(tomli_w.dumps(table), encoding="utf-8")
