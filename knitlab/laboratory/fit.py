"""Fit to the whole fabric: the stripes with which a simulated test meets a measured one.

The paper fits every stripe to the tension curve of its own pure fabric, and names the fit to
whole fabrics as the next step. Here the tables are what is known before: a parameter may depart
from them, but has to earn it by a better match (least squares with a Gaussian prior). Derivatives
are exact, by one adjoint solve a quantity and strain.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import OptimizeResult, least_squares

from knitlab.laboratory.virtual_test import QUANTITIES, VirtualTest, virtual_test, with_factors
from knitlab.measure.sensitivity import STRIPE_PARAMETERS
from knitlab.mechanics.response import NoDerivative
from knitlab.sweep.case import Case

FITTED = tuple(name for name in STRIPE_PARAMETERS if not name.endswith("period"))
"""What is fitted by default: all but the periods, which are measured by a ruler."""
LARGEST_FACTOR = 3.0
"""By which a parameter may grow or shrink."""
LARGEST_REST_ANGLE = 3.0
"""Rest angle that a stripe may come to, short of flat [rad]."""
MOST_TESTS = 40
ENOUGH = 1e-4
"""Relative change of the misfit, and of a factor, that ends the search."""
AT_BOUND = 1e-3

Curves = Float[np.ndarray, "quantity strain"]
Factors = dict[str, float]
Step = Callable[[int, float], None]


@dataclass(frozen=True)
class Target:
    """A measured test.

    Attributes:
        applied_strain: above 0, ascending [1].
        values: of :data:`~knitlab.laboratory.virtual_test.QUANTITIES`, NaN where not measured; the
            force is over the width of the simulated sample.
        errors: standard errors of the values, above 0.
    """

    applied_strain: tuple[float, ...]
    values: Curves
    errors: Curves

    @property
    def there(self) -> Bool[np.ndarray, "quantity strain"]:
        """Which values are measured."""
        return np.isfinite(self.values)


@dataclass(frozen=True)
class Fit:
    """A fit to a whole fabric.

    Attributes:
        names: of the parameters that were fitted.
        before: the case with the stripes of the tables.
        after: with the fitted ones.
        factors: fitted over tabulated.
        standard_errors: of the factors' logarithms, with what the tables say taken for data.
        learned: part of what was not known before that the test has told, by parameter.
        correlations: between the fitted.
        target: what was fitted to.
        curves: of the test with the stripes of the tables, and with the fitted ones.
        confirmed: those of the fitted test, run from the start; ``None`` if it did not converge.
        chi_squared: sum of the squared misfits over their errors, before and after.
        tests: how many tests were simulated.
        converged: whether the search met its tolerances.
        warnings: what to beware of.
    """

    names: tuple[str, ...]
    before: Case
    after: Case
    factors: Factors
    standard_errors: Factors
    learned: Factors
    correlations: Float[np.ndarray, "name name"]
    target: Target
    curves: tuple[Curves, Curves]
    confirmed: Curves | None
    chi_squared: tuple[float, float]
    tests: int
    converged: bool
    warnings: tuple[str, ...]


class NoFit(ValueError):
    """A fit that cannot begin, with the reason."""


def fit_stripes(
    case: Case,
    target: Target,
    looseness: float,
    names: Sequence[str] = FITTED,
    step: Step = lambda tests, chi_squared: None,
) -> Fit:
    """Fit stripe parameters to a measured test.

    Args:
        case: the simulated sample, with the stripes of the tables.
        target: the measured test.
        looseness: standard deviation that the tables are trusted to, relative: 0.2 for 20 %.
        names: of the parameters, of :data:`STRIPE_PARAMETERS`.
        step: told after every test how many there were, and χ² of the last.

    Raises:
        NoFit: if the sample with the stripes of the tables cannot be tested.
    """
    search = _Search(case, target, looseness, tuple(names), step)
    if search.first is None:
        raise NoFit("the sample with the stripes of the tables does not come to rest everywhere")
    upper = np.full(len(names), np.log(LARGEST_FACTOR))
    for place, name in enumerate(names):
        side, of = STRIPE_PARAMETERS[name]
        if of == "theta_0":
            upper[place] = np.log(LARGEST_REST_ANGLE / getattr(getattr(case, side), of))
    lower = np.full(len(names), -np.log(LARGEST_FACTOR))
    found = least_squares(
        search.residuals,
        np.zeros(len(names)),
        jac=search.jacobian,
        bounds=(lower, upper),
        method="trf",
        x_scale=looseness,
        ftol=ENOUGH,
        xtol=ENOUGH,
        gtol=None,
        max_nfev=MOST_TESTS,
    )
    return search.concluded(found, lower, upper)


class _Search:
    """The tests of a search; the last of them is kept for its derivatives."""

    def __init__(
        self, case: Case, target: Target, looseness: float, names: tuple[str, ...], step: Step
    ) -> None:
        self.case = case
        self.target, self.looseness, self.names, self.step = target, looseness, names, step
        self.places = [list(STRIPE_PARAMETERS).index(name) for name in names]
        self.first = virtual_test(case)
        self.tests = 1
        self.near = self.first
        self.at = np.zeros(len(names)).tobytes()
        self.underivable = 0

    def factors(self, logarithms: Float[np.ndarray, " name"]) -> Factors:
        return dict(zip(self.names, np.exp(logarithms).tolist(), strict=True))

    def test(self, logarithms: Float[np.ndarray, " name"]) -> VirtualTest | None:
        """The test at some logarithms of factors; its neighbours start from it if it converged."""
        if logarithms.tobytes() == self.at:
            return self.near
        found = virtual_test(with_factors(self.case, self.factors(logarithms)), self.near)
        self.tests += 1
        if found is not None:
            self.near, self.at = found, logarithms.tobytes()
        return found

    def residuals(self, logarithms: Float[np.ndarray, " name"]) -> Float[np.ndarray, " row"]:
        found = self.test(logarithms)
        there = self.target.there
        rows = int(there.sum()) + len(self.names)
        if found is None:
            return np.full(rows, np.inf)
        misfit = self.misfit(found.values)
        self.step(self.tests, float(misfit @ misfit))
        return np.append(misfit, logarithms / self.looseness)

    def misfit(self, values: Curves) -> Float[np.ndarray, " row"]:
        there = self.target.there
        return ((values - self.target.values) / self.target.errors)[there]

    def jacobian(self, logarithms: Float[np.ndarray, " name"]) -> Float[np.ndarray, "row name"]:
        found = self.test(logarithms)
        if found is None:
            raise TypeError("a derivative is asked for where no test converged")
        try:
            slopes = found.slopes()[..., self.places]
        except NoDerivative:
            # The next step then follows the tables alone, and the search says that it was so.
            self.underivable += 1
            slopes = np.zeros((*found.values.shape, len(self.names)))
        rows = (slopes / self.target.errors[..., None])[self.target.there]
        return np.concatenate([rows, np.eye(len(self.names)) / self.looseness])

    def concluded(self, found: OptimizeResult, lower: np.ndarray, upper: np.ndarray) -> Fit:
        best, covariance = found.x, np.linalg.inv(found.jac.T @ found.jac)
        errors = np.sqrt(np.diag(covariance))
        after = with_factors(self.case, self.factors(best))
        fitted, confirmed = self.test(best), virtual_test(after)
        if fitted is None or self.first is None:
            raise TypeError("the best of the tests did not converge")
        misfits = [self.misfit(its.values) for its in (self.first, fitted)]
        said = []
        if not found.success:
            said.append(f"the search ended after {self.tests} tests without an end; do not use it")
        for name, low, high, at in zip(self.names, lower, upper, best, strict=True):
            if min(at - low, high - at) < AT_BOUND:
                said.append(f"{name} is at the end of where it was looked for")
        if self.underivable:
            said.append(
                f"{self.underivable} of the tests had a state without derivatives, at a snap"
            )
        if confirmed is None:
            said.append("the fitted fabric, tested from the start, does not converge")
        elif np.abs(self.misfit(confirmed.values) - misfits[1]).max() > 1:
            said.append(
                "the fitted fabric, tested from the start, comes to other states: it has several"
            )
        freedom = max(len(misfits[1]) - len(self.names), 1)
        if (spread := float(misfits[1] @ misfits[1]) / freedom) > MUCH_TOO_FAR:
            said.append(
                f"the fit is {np.sqrt(spread):.1f} times as far from the test as its errors say;"
                " the standard errors do not cover that"
            )
        named: dict[str, Any] = {
            "factors": self.factors(best),
            "standard_errors": dict(zip(self.names, errors.tolist(), strict=True)),
            "learned": dict(
                zip(self.names, (1 - (errors / self.looseness) ** 2).tolist(), strict=True)
            ),
        }
        return Fit(
            names=self.names,
            before=self.case,
            after=after,
            **named,
            correlations=covariance / np.outer(errors, errors),
            target=self.target,
            curves=(self.first.values, fitted.values),
            confirmed=None if confirmed is None else confirmed.values,
            chi_squared=(float(misfits[0] @ misfits[0]), float(misfits[1] @ misfits[1])),
            tests=self.tests,
            converged=bool(found.success),
            warnings=tuple(said),
        )


MUCH_TOO_FAR = 4.0
"""χ² a degree of freedom above which the model does not meet the test."""


def root_mean_square(curves: Curves, target: Target) -> dict[str, float]:
    """Root of the mean square difference from a measured test, by quantity, in its unit."""
    apart = np.where(target.there, curves - target.values, 0.0)
    count = np.maximum(target.there.sum(axis=1), 1)
    return dict(zip(QUANTITIES, np.sqrt((apart**2).sum(axis=1) / count).tolist(), strict=True))
