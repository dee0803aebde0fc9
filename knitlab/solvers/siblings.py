"""Siblings of a case, which differ from it slightly, and how far their results spread."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float

from knitlab.model.stripe import STRIPE_QUANTITIES, Stripe
from knitlab.solvers.case import Case
from knitlab.solvers.equilibrium.state import TensileTest

STRIPE_TOLERANCE = 0.02  # largest relative change of a stripe number of a sibling
SAME_BRANCH = 1e-6  # relative difference up to which two relaxed energies are of one branch
SPREAD = ("poisson_ratio", "reaction_force")  # results whose spread is taken


@dataclass(frozen=True)
class SiblingTest:
    """A sibling, its test, and the energy of the original relaxed from its shape, or NaN [N mm]."""

    case: Case
    test: TensileTest
    branch_energy: float


def sibling(case: Case, number: int) -> Case:
    """A sibling, from 1 on: stripes differ by up to 2 %, and every second has another start."""
    pair, second = divmod(number - 1, 2)
    changes = np.random.default_rng(pair).uniform(-1, 1, size=(2, len(STRIPE_QUANTITIES)))
    # The second of a pair differs the other way, so that a spread is not to one side by chance.
    rib, garter = 1 + STRIPE_TOLERANCE * (-changes if second else changes)
    solver = case.solver
    if case.options.boundary == "clamped" and number % 2 and case.method == "equilibrium":
        settings = case.equilibrium_solver
        solver = replace(settings, start="periodic" if settings.start == "flat" else "flat")
    scaled = case.with_stripes(partial(_scaled, factors=rib), partial(_scaled, factors=garter))
    plain_test = replace(scaled, sensitivities=False, unloading=False, capacitor=None, robustness=0)
    return replace(plain_test, solver=solver).without_unused()


def _scaled(stripe: Stripe, factors: Float[np.ndarray, " number"]) -> Stripe:
    numbers: dict[str, Any] = {
        name: float(getattr(stripe, name) * factor)
        for name, factor in zip(STRIPE_QUANTITIES, factors, strict=True)
    }
    # A rest angle next to flat must not pass it.
    numbers["theta_0"] = min(numbers["theta_0"], (np.pi + stripe.theta_0) / 2)
    return replace(stripe, **numbers)


def spread(
    values: dict[str, Any], siblings: Sequence[dict[str, Any]], energies: Sequence[float]
) -> dict[str, Any]:
    """Lowest and highest results of a case and its siblings, by the names of the schema.

    A sibling counts at the strains that it reached. Energies are the relaxed one of the case, then
    those that its siblings led it to, NaN if they did not converge [N mm].
    """
    spreads: dict[str, Any] = {"relaxed_branches": float(branches(energies))}
    for name in SPREAD:
        length = len(values[name])
        rows = np.full((1 + len(siblings), length), np.nan)
        for row, results in zip(rows, [values, *siblings], strict=True):
            reached = np.asarray(results.get(name, ()))[:length]
            row[: len(reached)] = reached
        spreads[f"{name}_low"] = np.fmin.reduce(rows)
        spreads[f"{name}_high"] = np.fmax.reduce(rows)
        spreads["siblings"] = np.isfinite(rows[1:]).sum(axis=0).astype(float)
    return spreads


def branches(energies: Sequence[float]) -> int:
    """How many distinct relaxed energies there are; what did not converge is not counted."""
    ordered = np.sort([energy for energy in energies if np.isfinite(energy)])
    if not len(ordered):
        return 0
    return 1 + int(np.count_nonzero(np.diff(ordered) > SAME_BRANCH * np.abs(ordered[1:])))
