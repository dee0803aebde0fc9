"""Fit to the whole fabric: the stripes with which a simulated test meets a measured one.

The paper fits every stripe to the tension curve of its own pure fabric, and names the fit to
whole fabrics as the next step. Here the tables are what is known before: a parameter may depart
from them, but has to earn it by a better match (least squares with a Gaussian prior). Derivatives
are exact, by one adjoint solve a quantity and strain.

A fabric has many states. Every test of a search starts from the states of the one before, so that
it stays on one branch and its curves change smoothly; where a test of the result from the start, as
a sweep runs it, comes to other states, the search goes on from those. Where no branch that it
comes to meets the test, it begins anew with stripes that are off the tables by as much as these
are trusted to.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import OptimizeResult, least_squares
from scipy.stats import norm, qmc

from knitlab.laboratory.simulated_test import (
    QUANTITIES,
    SimulatedTest,
    simulated_test,
    with_factors,
)
from knitlab.measure.sensitivity import STRIPE_PARAMETERS
from knitlab.mechanics.linear_response import NoDerivative
from knitlab.simulation.case import Case

FITTED = tuple(name for name in STRIPE_PARAMETERS if not name.endswith("period"))
"""What is fitted by default: all but the periods, which are measured by a ruler."""
LARGEST_FACTOR = 3.0
"""Largest ratio between a fitted and a tabulated parameter, or its inverse."""
LARGEST_REST_ANGLE = 3.0
"""Upper bound of a rest angle, below π, which is flat [rad]."""
MOST_TESTS = 25
"""Largest number of tests in a search on one branch."""
MOST_SEARCHES = 4
"""Largest number of branches searched from one start."""
WELL_MET = 1.0
"""χ² for each measured value up to which no other start is tried."""
SAME = 0.5
"""Difference of two tests, in standard errors, up to which they are of the same states."""
ENOUGH = 1e-3
"""Relative change of χ², and of a factor, that ends a search."""
MUCH_TOO_FAR = 4.0
"""χ² for each degree of freedom above which the fit is reported as poor."""
AT_BOUND = 1e-3
INSIDE = 0.9
"""Fraction of the way to a bound within which starts lie."""

Curves = Float[np.ndarray, "quantity strain"]
Factors = dict[str, float]
Step = Callable[[int, float], None]


@dataclass(frozen=True)
class Target:
    """A measured test.

    Attributes:
        applied_strain: above 0, ascending [1].
        values: of :data:`~knitlab.laboratory.simulated_test.QUANTITIES`, NaN where not measured;
            the force is over the width of the simulated sample.
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
        learned: part of the prior variance that the test has removed, by parameter.
        correlations: between the fitted.
        target: what was fitted to.
        curves: of the tests with the stripes of the tables, and with the fitted ones, each run
            from the start as a sweep does.
        chi_squared: sum of the squared misfits over their errors, before and after.
        tests: how many tests were simulated.
        converged: whether the search met its tolerances.
        warnings: reasons to doubt the fit.
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
    starts: int = 4,
    step: Step = lambda tests, chi_squared: None,
) -> Fit:
    """Fit stripe parameters to a measured test.

    Args:
        case: the simulated sample, with the stripes of the tables.
        target: the measured test.
        looseness: standard deviation that the tables are trusted to, relative: 0.2 for 20 %.
        names: of the parameters, of :data:`STRIPE_PARAMETERS`.
        starts: most starts that are tried until the test is met, the first from the tables.
        step: called after every test with the number of tests and χ² of the last.

    Raises:
        NoFit: if the sample with the stripes of the tables cannot be tested.
    """
    search = _Search(case, target, looseness, tuple(names), step)
    first = search.begin(np.zeros(len(names)))
    if first is None:
        raise NoFit("the sample with the stripes of the tables does not come to rest everywhere")
    lower, upper = search.bounds
    quantiles = qmc.Halton(len(names), rng=0).random(starts)
    others = np.clip(looseness * norm.ppf(quantiles[1:]), lower * INSIDE, upper * INSIDE)
    best: _Found | None = None
    for at in (np.zeros(len(names)), *others):
        if at.any() and search.begin(at) is None:
            continue
        found = search.found(at)
        if best is None or found.cost < best.cost:
            best = found
        if search.met(found.chi_squared):
            break
    if best is None:
        raise NoFit("no test from a start converged")
    return search.concluded(first, best)


def _bounds(case: Case, names: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """How far the logarithms of the factors may go."""
    upper = np.full(len(names), np.log(LARGEST_FACTOR))
    for place, name in enumerate(names):
        side, of = STRIPE_PARAMETERS[name]
        if of == "theta_0":
            upper[place] = np.log(LARGEST_REST_ANGLE / getattr(getattr(case, side), of))
    return np.full(len(names), -np.log(LARGEST_FACTOR)), upper


@dataclass(frozen=True)
class _Found:
    """Result of a search from one start.

    Attributes:
        result: of the last search on a branch.
        fitted: the test that it ended with.
        confirmed: the same from the start; ``None`` if that did not converge.
        room: between every parameter and the end of where it was looked for.
        chi_squared: of the confirmed test, or infinite.
    """

    result: OptimizeResult
    fitted: SimulatedTest
    confirmed: SimulatedTest | None
    room: Float[np.ndarray, " name"]
    chi_squared: float

    @property
    def cost(self) -> float:
        """χ², what the tables say included."""
        prior = self.result.fun[-len(self.result.x) :]
        return self.chi_squared + float(prior @ prior)


class _Search:
    """Simulated tests of a search; the last is kept for its derivatives."""

    def __init__(
        self, case: Case, target: Target, looseness: float, names: tuple[str, ...], step: Step
    ) -> None:
        self.case = case
        self.target, self.looseness, self.names, self.step = target, looseness, names, step
        self.places = [list(STRIPE_PARAMETERS).index(name) for name in names]
        self.bounds = _bounds(case, names)
        self.tests = self.underivable = 0
        self.near: SimulatedTest | None = None
        self.at = b""

    def begin(self, logarithms: Float[np.ndarray, " name"]) -> SimulatedTest | None:
        """Simulate a test from the relaxed state; the search continues from it."""
        self.near = simulated_test(with_factors(self.case, self.factors(logarithms)))
        self.at = logarithms.tobytes()
        self.tests += 1
        return self.near

    def found(self, at: Float[np.ndarray, " name"]) -> _Found:
        """Search from a start whose test is already simulated."""
        confirmed: SimulatedTest | None = None
        for _ in range(MOST_SEARCHES):
            result = self._on_branch(at)
            at, fitted = result.x, self.converged(result.x)
            confirmed = self.begin(at)
            chi_squared = np.inf if confirmed is None else self.chi_squared(confirmed)
            if confirmed is None or self.same(fitted, confirmed) or self.met(chi_squared):
                break
        lower, upper = self.bounds
        room = np.minimum(at - lower, upper - at)
        return _Found(result, fitted, confirmed, room, chi_squared)

    def _on_branch(self, at: Float[np.ndarray, " name"]) -> OptimizeResult:
        return least_squares(
            self.residuals,
            at,
            jac=self.jacobian,
            bounds=self.bounds,
            method="trf",
            x_scale=self.looseness,
            ftol=ENOUGH,
            xtol=ENOUGH,
            gtol=None,
            max_nfev=MOST_TESTS,
        )

    def same(self, one: SimulatedTest, other: SimulatedTest) -> bool:
        """Whether two tests are of the same states."""
        apart = self.misfit(one.values) - self.misfit(other.values)
        return bool(np.abs(apart).max() < SAME)

    def factors(self, logarithms: Float[np.ndarray, " name"]) -> Factors:
        return dict(zip(self.names, np.exp(logarithms).tolist(), strict=True))

    def test(self, logarithms: Float[np.ndarray, " name"]) -> SimulatedTest | None:
        """The test at some logarithms of factors; its neighbours start from it if it converged."""
        if logarithms.tobytes() == self.at:
            return self.near
        found = simulated_test(with_factors(self.case, self.factors(logarithms)), self.near)
        self.tests += 1
        if found is not None:
            self.near, self.at = found, logarithms.tobytes()
        return found

    def converged(self, logarithms: Float[np.ndarray, " name"]) -> SimulatedTest:
        """The test at some logarithms where one has converged before."""
        found = self.test(logarithms)
        if found is None:
            raise TypeError("a search went to where no test converged")
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

    def chi_squared(self, test: SimulatedTest) -> float:
        misfit = self.misfit(test.values)
        return float(misfit @ misfit)

    def met(self, chi_squared: float) -> bool:
        return chi_squared <= WELL_MET * int(self.target.there.sum())

    def misfit(self, values: Curves) -> Float[np.ndarray, " row"]:
        there = self.target.there
        return ((values - self.target.values) / self.target.errors)[there]

    def jacobian(self, logarithms: Float[np.ndarray, " name"]) -> Float[np.ndarray, "row name"]:
        found = self.converged(logarithms)
        try:
            slopes = found.slopes()[..., self.places]
        except NoDerivative:
            # The next step then follows the tables alone, and the search says that it was so.
            self.underivable += 1
            slopes = np.zeros((*found.values.shape, len(self.names)))
        rows = (slopes / self.target.errors[..., None])[self.target.there]
        return np.concatenate([rows, np.eye(len(self.names)) / self.looseness])

    def concluded(self, first: SimulatedTest, best: _Found) -> Fit:
        """The fit of the best search.

        Args:
            first: the test with the stripes of the tables.
            best: what was found.
        """
        slopes = best.result.jac
        covariance = np.linalg.inv(slopes.T @ slopes)
        errors = np.sqrt(np.diag(covariance))
        after = best.confirmed or best.fitted
        factors = self.factors(best.result.x)
        learned = 1 - (errors / self.looseness) ** 2
        return Fit(
            names=self.names,
            before=self.case,
            after=with_factors(self.case, factors),
            factors=factors,
            standard_errors=dict(zip(self.names, errors.tolist(), strict=True)),
            learned=dict(zip(self.names, learned.tolist(), strict=True)),
            correlations=covariance / np.outer(errors, errors),
            target=self.target,
            curves=(first.values, after.values),
            chi_squared=(self.chi_squared(first), self.chi_squared(after)),
            tests=self.tests,
            converged=bool(best.result.success and best.confirmed is not None),
            warnings=tuple(self._warnings(best, self.chi_squared(after))),
        )

    def _warnings(self, best: _Found, chi_squared: float) -> Iterator[str]:
        if not best.result.success:
            yield f"the search was given up after {self.tests} tests; do not use it"
        for name, left in zip(self.names, best.room, strict=True):
            if left < AT_BOUND:
                yield f"{name} is at the end of where it was looked for"
        if self.underivable:
            yield f"{self.underivable} tests had a state without derivatives, at a snap"
        if best.confirmed is None:
            yield "the fitted fabric, tested from the start, does not converge; do not use it"
        elif not (self.same(best.fitted, best.confirmed) or self.met(best.chi_squared)):
            yield (
                f"the fabric has several states, and {MOST_SEARCHES} searches came to others than"
                " a test of their result; the match is that of the test, the standard errors are"
                " not to be trusted"
            )
        freedom = max(int(self.target.there.sum()) - len(self.names), 1)
        if (spread := chi_squared / freedom) > MUCH_TOO_FAR:
            yield (
                f"the fit is {np.sqrt(spread):.1f} times as far from the test as its errors say;"
                " the standard errors do not cover that"
            )


def root_mean_square(curves: Curves, target: Target) -> dict[str, float]:
    """Root of the mean square difference from a measured test, by quantity, in its unit."""
    apart = np.where(target.there, curves - target.values, 0.0)
    count = np.maximum(target.there.sum(axis=1), 1)
    return dict(zip(QUANTITIES, np.sqrt((apart**2).sum(axis=1) / count).tolist(), strict=True))
