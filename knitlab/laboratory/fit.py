"""Fit to a whole fabric: stripe parameters with which a simulated test matches a measured one.

The paper fits every stripe to the tension curve of its own pure fabric, and names the fit to whole
fabrics as the next step. Here the tables are the prior: least squares with a Gaussian prior lets a
parameter depart from its table value only if the match improves. Derivatives are exact, by one
adjoint solve for each quantity and strain.

A fabric has many equilibria. Every test of a search starts from the states of the previous one, so
that it stays on one branch and its curves change smoothly. The result is then tested from the flat
sheet, as in a sweep; if that test reaches other states, the search continues from those. If no
branch matches the test, the search is repeated from stripe parameters drawn from the prior.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import OptimizeResult, least_squares
from scipy.stats import norm, qmc

from knitlab.equilibrium.linear_response import NoDerivative
from knitlab.laboratory.simulated_test import (
    QUANTITIES,
    SimulatedTest,
    simulated_test,
    with_factors,
)
from knitlab.simulation.case import Case
from knitlab.simulation.sensitivity import STRIPE_PARAMETERS

FITTED = tuple(name for name in STRIPE_PARAMETERS if not name.endswith("period"))
"""Parameters fitted by default: all but the periods, which can be measured directly."""
LARGEST_FACTOR = 3.0
"""Largest ratio between a fitted and a tabulated parameter, or its inverse."""
LARGEST_REST_ANGLE = 3.0
"""Upper bound of a rest angle, below π, which is flat [rad]."""
MOST_TESTS = 25
"""Largest number of tests in a search on one branch."""
MOST_SEARCHES = 4
"""Largest number of branches searched from one start."""
GOOD_MATCH = 1.0
"""χ² per measured value up to which no other start is tried."""
SAME_STATES = 0.5
"""Difference of two tests, in standard errors, up to which they have the same states."""
TOLERANCE = 1e-3
"""Relative change of χ², and of a factor, that ends a search."""
POOR_FIT = 4.0
"""χ² per degree of freedom above which the fit is reported as poor."""
AT_BOUND = 1e-3
INSIDE = 0.9
"""Fraction of the distance to a bound within which starts are placed."""

Curves = Float[np.ndarray, "quantity strain"]
Factors = dict[str, float]
Step = Callable[[int, float], None]


@dataclass(frozen=True)
class MeasuredTest:
    """A measured test.

    Attributes:
        applied_strain: positive, ascending [1].
        values: values of :data:`~knitlab.laboratory.simulated_test.QUANTITIES`, NaN where not
            measured; the force is over the width of the simulated sample.
        errors: standard errors of the values, positive.
    """

    applied_strain: tuple[float, ...]
    values: Curves
    errors: Curves

    def __repr__(self) -> str:
        values, strains = int(self.measured.sum()), len(self.applied_strain)
        return f"<MeasuredTest: {values} values at {strains} strains>"

    @property
    def measured(self) -> Bool[np.ndarray, "quantity strain"]:
        """Whether each value is measured."""
        return np.isfinite(self.values)


@dataclass(frozen=True)
class Fit:
    """A fit to a whole fabric.

    Attributes:
        names: names of the fitted parameters.
        before: the case with the tabulated stripes.
        after: the case with the fitted stripes.
        factors: fitted over tabulated value, by parameter.
        standard_errors: standard errors of the logarithms of the factors, including the prior.
        learned: fraction of the prior variance that the test has removed, by parameter.
        correlations: correlations between the fitted parameters.
        target: the measured test.
        curves: curves of the tests with the tabulated and with the fitted stripes, each simulated
            from the flat sheet, as in a sweep.
        chi_squared: χ² before and after the fit.
        tests: number of simulated tests.
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
    target: MeasuredTest
    curves: tuple[Curves, Curves]
    chi_squared: tuple[float, float]
    tests: int
    converged: bool
    warnings: tuple[str, ...]

    def __repr__(self) -> str:
        factors = ", ".join(f"{name} {factor:.4g}" for name, factor in self.factors.items())
        return f"<Fit {self.after.label}: factors {factors}; {self.tests} tests>"


class NoFit(ValueError):
    """A fit that cannot be started, with the reason."""


def fit_stripes(
    case: Case,
    target: MeasuredTest,
    looseness: float,
    names: Sequence[str] = FITTED,
    starts: int = 4,
    step: Step = lambda tests, chi_squared: None,
) -> Fit:
    """Fit stripe parameters to a measured test.

    Args:
        case: the simulated sample, with the tabulated stripes.
        target: the measured test.
        looseness: relative standard deviation of the prior: 0.2 for 20 %.
        names: parameters to fit, of :data:`STRIPE_PARAMETERS`.
        starts: largest number of starts that are tried until the test is matched; the first is
            the tables.
        step: called after every test with the number of tests and χ² of the last.

    Raises:
        NoFit: if the test with the tabulated stripes does not converge.
    """
    search = _Search(case, target, looseness, tuple(names), step)
    first = search.begin(np.zeros(len(names)))
    if first is None:
        raise NoFit("the test with the tabulated stripes does not converge at every strain")
    lower, upper = search.bounds
    quantiles = qmc.Halton(len(names), rng=0).random(starts)
    others = np.clip(looseness * norm.ppf(quantiles[1:]), lower * INSIDE, upper * INSIDE)
    best: _Found | None = None
    for start in (np.zeros(len(names)), *others):
        if start.any() and search.begin(start) is None:
            continue
        found = search.found(start)
        if best is None or found.cost < best.cost:
            best = found
        if search.met(found.chi_squared):
            break
    if best is None:
        raise NoFit("no test from a start converged")
    return search.concluded(first, best)


def _bounds(case: Case, names: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper bounds of the logarithms of the factors."""
    upper = np.full(len(names), np.log(LARGEST_FACTOR))
    for place, name in enumerate(names):
        side, quantity = STRIPE_PARAMETERS[name]
        if quantity == "theta_0":
            upper[place] = np.log(LARGEST_REST_ANGLE / getattr(getattr(case, side), quantity))
    return np.full(len(names), -np.log(LARGEST_FACTOR)), upper


@dataclass(frozen=True)
class _Found:
    """Result of a search from one start.

    Attributes:
        result: result of the last search on a branch.
        fitted: the test at its end.
        confirmed: the test repeated from the flat sheet; ``None`` if it did not converge.
        room: distance of every parameter from its nearest bound.
        chi_squared: χ² of the confirmed test, or infinite.
    """

    result: OptimizeResult
    fitted: SimulatedTest
    confirmed: SimulatedTest | None
    room: Float[np.ndarray, " name"]
    chi_squared: float

    @property
    def cost(self) -> float:
        """χ² including the prior."""
        prior = self.result.fun[-len(self.result.x) :]
        return self.chi_squared + float(prior @ prior)


class _Search:
    """Simulated tests of a search; the last one is kept for its derivatives."""

    def __init__(
        self, case: Case, target: MeasuredTest, looseness: float, names: tuple[str, ...], step: Step
    ) -> None:
        self.case = case
        self.target, self.looseness, self.names, self.step = target, looseness, names, step
        self.places = [list(STRIPE_PARAMETERS).index(name) for name in names]
        self.bounds = _bounds(case, names)
        self.tests = self.without_derivatives = 0
        self.near: SimulatedTest | None = None
        self.point = b""

    def begin(self, logarithms: Float[np.ndarray, " name"]) -> SimulatedTest | None:
        """Simulate a test from the relaxed state; the search continues from it."""
        self.near = simulated_test(with_factors(self.case, self.factors(logarithms)))
        self.point = logarithms.tobytes()
        self.tests += 1
        return self.near

    def found(self, point: Float[np.ndarray, " name"]) -> _Found:
        """Search from a start whose test is already simulated."""
        confirmed: SimulatedTest | None = None
        for _ in range(MOST_SEARCHES):
            result = self._on_branch(point)
            point, fitted = result.x, self.converged(result.x)
            confirmed = self.begin(point)
            chi_squared = np.inf if confirmed is None else self.chi_squared(confirmed)
            if confirmed is None or self.same(fitted, confirmed) or self.met(chi_squared):
                break
        lower, upper = self.bounds
        room = np.minimum(point - lower, upper - point)
        return _Found(result, fitted, confirmed, room, chi_squared)

    def _on_branch(self, point: Float[np.ndarray, " name"]) -> OptimizeResult:
        return least_squares(
            self.residuals,
            point,
            jac=self.jacobian,
            bounds=self.bounds,
            method="trf",
            x_scale=self.looseness,
            ftol=TOLERANCE,
            xtol=TOLERANCE,
            gtol=None,
            max_nfev=MOST_TESTS,
        )

    def same(self, one: SimulatedTest, other: SimulatedTest) -> bool:
        """Whether two tests have the same states."""
        difference = self.misfit(one.values) - self.misfit(other.values)
        return bool(np.abs(difference).max() < SAME_STATES)

    def factors(self, logarithms: Float[np.ndarray, " name"]) -> Factors:
        return dict(zip(self.names, np.exp(logarithms).tolist(), strict=True))

    def test(self, logarithms: Float[np.ndarray, " name"]) -> SimulatedTest | None:
        """The test with these logarithms of factors; if it converges, later ones start from it."""
        if logarithms.tobytes() == self.point:
            return self.near
        found = simulated_test(with_factors(self.case, self.factors(logarithms)), self.near)
        self.tests += 1
        if found is not None:
            self.near, self.point = found, logarithms.tobytes()
        return found

    def converged(self, logarithms: Float[np.ndarray, " name"]) -> SimulatedTest:
        """The test at a point where a test has already converged."""
        found = self.test(logarithms)
        if found is None:
            raise TypeError("the search reached a point where no test converged")
        return found

    def residuals(self, logarithms: Float[np.ndarray, " name"]) -> Float[np.ndarray, " row"]:
        found = self.test(logarithms)
        rows = int(self.target.measured.sum()) + len(self.names)
        if found is None:
            return np.full(rows, np.inf)
        misfit = self.misfit(found.values)
        self.step(self.tests, float(misfit @ misfit))
        return np.append(misfit, logarithms / self.looseness)

    def chi_squared(self, test: SimulatedTest) -> float:
        misfit = self.misfit(test.values)
        return float(misfit @ misfit)

    def met(self, chi_squared: float) -> bool:
        return chi_squared <= GOOD_MATCH * int(self.target.measured.sum())

    def misfit(self, values: Curves) -> Float[np.ndarray, " row"]:
        return ((values - self.target.values) / self.target.errors)[self.target.measured]

    def jacobian(self, logarithms: Float[np.ndarray, " name"]) -> Float[np.ndarray, "row name"]:
        found = self.converged(logarithms)
        try:
            slopes = found.slopes()[..., self.places]
        except NoDerivative:
            # The next step then depends on the prior alone, and the fit has a warning.
            self.without_derivatives += 1
            slopes = np.zeros((*found.values.shape, len(self.names)))
        rows = (slopes / self.target.errors[..., None])[self.target.measured]
        return np.concatenate([rows, np.eye(len(self.names)) / self.looseness])

    def concluded(self, first: SimulatedTest, best: _Found) -> Fit:
        """The fit of the best search.

        Args:
            first: the test with the tabulated stripes.
            best: the best result.
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
            yield f"the search did not converge in {self.tests} tests; do not use it"
        for name, left in zip(self.names, best.room, strict=True):
            if left < AT_BOUND:
                yield f"{name} is at a bound of the search"
        if self.without_derivatives:
            yield f"{self.without_derivatives} tests had a state without derivatives, at a snap"
        if best.confirmed is None:
            yield "the fitted fabric, tested from the flat sheet, does not converge; do not use it"
        elif not (self.same(best.fitted, best.confirmed) or self.met(best.chi_squared)):
            yield (
                f"the fabric has several states, and {MOST_SEARCHES} searches reached others than"
                " a test of their result; the match is that of the test, and the standard errors"
                " are not reliable"
            )
        freedom = max(int(self.target.measured.sum()) - len(self.names), 1)
        if (spread := chi_squared / freedom) > POOR_FIT:
            yield (
                f"the difference from the test is {np.sqrt(spread):.1f} times its errors; the"
                " standard errors do not include this"
            )


def root_mean_square(curves: Curves, target: MeasuredTest) -> dict[str, float]:
    """Root mean square difference from a measured test, by quantity, in its unit."""
    difference = np.where(target.measured, curves - target.values, 0.0)
    count = np.maximum(target.measured.sum(axis=1), 1)
    mean_square = (difference**2).sum(axis=1) / count
    return dict(zip(QUANTITIES, np.sqrt(mean_square).tolist(), strict=True))
