"""Fit to a whole fabric: stripe parameters with which a simulated test matches a measured one.

The tables are a Gaussian prior of least squares with exact derivatives. Every test of a search
starts from the states of the previous one, so that it stays on one branch. The result is tested
from the flat sheet; if that reaches other states, the search continues from those. If no branch
matches, the search is repeated from stripe parameters drawn from the prior.
"""

import itertools
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.optimize import OptimizeResult, least_squares
from scipy.stats import norm, qmc

from knitlab.io.atomic_write import atomic_write
from knitlab.io.checksum import append_checksum, has_checksum
from knitlab.io.errors import invalid
from knitlab.io.provenance import MODEL_VERSION
from knitlab.lab.calibration import ENTRY_UNITS
from knitlab.lab.curves import (
    QUANTITIES,
    Curves,
    MeasuredTest,
    SimulatedTest,
    simulated_test,
    with_factors,
)
from knitlab.observables.case_variables import STRIPE_PARAMETERS
from knitlab.observables.schema import VARIABLES
from knitlab.runs.material import Material
from knitlab.solvers.case import Case
from knitlab.solvers.equilibrium.adjoint import NoDerivative

FITTED = tuple(name for name in STRIPE_PARAMETERS if not name.endswith("period"))
"""Fitted parameters: all but the periods, which can be measured directly."""
MAX_FACTOR = 3.0  # largest ratio of a fitted and a tabulated parameter, or its inverse
MAX_REST_ANGLE = 3.0  # upper bound of a rest angle, below π, which is flat [rad]
MAX_TESTS = 25  # in a search on one branch
MAX_SEARCHES = 4  # branches searched from one start
GOOD_MATCH = 1.0  # χ² per measured value up to which no other start is tried
SAME_STATES = 0.5  # difference, in standard errors, up to which two tests have the same states
TOLERANCE = 1e-3  # relative change of χ², and of a factor, that ends a search
POOR_FIT = 4.0  # χ² per degree of freedom above which the fit is reported as poor
AT_BOUND = 1e-3
INSIDE = 0.9  # fraction of the distance to a bound within which starts are placed
ALIKE = 0.9  # correlation above which parameters are reported as hard to separate

Factors = dict[str, float]
Logarithms = Float[np.ndarray, " name"]  # logarithms of the factors on the parameters
Step = Callable[[int, float], None]


@dataclass(frozen=True)
class Fit:
    """A fit to a whole fabric."""

    before: Case  # with the tabulated stripes
    after: Case  # with the fitted stripes
    factors: Factors  # fitted over tabulated value, by parameter
    standard_errors: Factors  # of the logarithms of the factors, including the prior
    learned: Factors  # fraction of the prior variance that the test has removed
    correlations: Float[np.ndarray, "name name"]  # between the fitted parameters
    target: MeasuredTest
    curves: tuple[Curves, Curves]  # of tests from the flat sheet, before and after the fit
    chi_squared: tuple[float, float]  # before and after the fit
    tests: int  # number of simulated tests
    converged: bool  # whether the search met its tolerances
    warnings: tuple[str, ...]  # reasons to doubt the fit

    def __repr__(self) -> str:
        factors = ", ".join(f"{name} {factor:.4g}" for name, factor in self.factors.items())
        return f"<Fit {self.after.label}: factors {factors}; {self.tests} tests>"

    @property
    def report(self) -> list[str]:
        """The fit as lines of text."""
        lines = ["parameter           table    fitted        ±  factor  from test"]
        for name, factor in self.factors.items():
            side, quantity = STRIPE_PARAMETERS[name]
            table = getattr(getattr(self.before, side), quantity)
            fitted = getattr(getattr(self.after, side), quantity)
            errors = f"{fitted * self.standard_errors[name]:8.2g}  {factor:6.3f}"
            learned = f"{self.learned[name]:4.0%}  [{ENTRY_UNITS[quantity]}]"
            lines.append(f"{name:15s} {table:9.4g} {fitted:9.4g} {errors}  {learned}")
        for (row, one), (column, other) in itertools.combinations(enumerate(self.factors), 2):
            if abs(correlation := self.correlations[row, column]) > ALIKE:
                cannot = f"{one} and {other} are hard to separate"
                lines.append(f"{cannot}: correlation {correlation:+.2f}")
        first, last = map(self.target.root_mean_square, self.curves)
        for name, measured in zip(QUANTITIES, self.target.measured, strict=True):
            if measured.any():
                rms = f"RMS difference {first[name]:.3g} before, {last[name]:.3g} after"
                lines.append(f"{VARIABLES[name].long_name}: {rms} [{VARIABLES[name].units}]")
        before, after = self.chi_squared
        count = f"over {int(self.target.measured.sum())} values; {self.tests} tests"
        return [*lines, f"chi² {before:.4g} before, {after:.4g} after, {count}"]

    def material(self, experiment: Path) -> Material:
        """Both fitted stripes, as a material with the lengths of the sample that was simulated."""
        sheet, sources = self.after.sheet, [f"knitlab fit {experiment}"]
        for knit in ("rib", "garter"):
            errors = [
                f"{name.removeprefix(f'{knit}_')} {error:.1%}"
                for name, error in self.standard_errors.items()
                if name.startswith(knit)
            ]
            sources.append(f"{knit}: standard errors {', '.join(errors)}")
        return Material(
            (self.after.weft, self.after.warp),
            name=f"fit of {experiment.name}",
            cell_size=self.after.options.cell_size,
            z_max=sheet.z_max,
            thickness=sheet.thickness,
            # Without them, walls and thickness are lengths of the network.
            stitch_width=sheet.cloth_stitch_width or None,
            stitch_height=sheet.cloth_stitch_height or None,
            source="; ".join([*sources, *self.warnings]),
        )


def fit_stripes(
    case: Case,
    target: MeasuredTest,
    prior_std: float,
    starts: int = 4,
    step: Step = lambda tests, chi_squared: None,
    kept: Path | None = None,
) -> Fit:
    """Fit the stripes of a case to a measured test, at its strains; see :func:`knitlab.fit`."""
    search = _Search(case, target, prior_std, step, kept)
    tables = np.zeros(len(FITTED))
    first = search.test(tables, flat=True)
    if first is None:
        message = "the test with the tabulated stripes does not converge at every strain; choose a"
        raise invalid(case.label, f"{message} smaller strain_max, or another sample")
    quantiles = qmc.Halton(len(FITTED), rng=0).random(starts)
    others = np.clip(prior_std * norm.ppf(quantiles[1:]), *(INSIDE * search.bounds))
    best = last = search.from_start(tables)
    for start in others:
        if search.is_met(last.chi_squared):
            break
        if search.test(start, flat=True) is not None:
            last = search.from_start(start)
            best = min(best, last, key=attrgetter("cost"))
    return search.concluded(first, best)


class _Optimum(NamedTuple):
    result: OptimizeResult
    fitted: SimulatedTest
    confirmed: SimulatedTest | None  # the same from the flat sheet, if it converges
    chi_squared: float  # of the confirmed test, or infinite
    cost: float  # χ² and the prior


def _by_name(values: Float[np.ndarray, " name"]) -> Factors:
    return dict(zip(FITTED, values.tolist(), strict=True))


@dataclass
class _Search:
    """Simulated tests of a search; the last one is kept for its derivatives."""

    case: Case
    target: MeasuredTest
    prior_std: float
    step: Step
    kept: Path | None
    tests: int = 0
    without_derivatives: int = 0
    near: SimulatedTest | None = None
    point: bytes = b""  # parameters of the test that is near

    @property
    def bounds(self) -> Float[np.ndarray, "2 name"]:
        """Lower and upper bounds of the logarithms."""
        largest = dict.fromkeys(FITTED, MAX_FACTOR)
        for name, stripe in (("rib", self.case.weft), ("garter", self.case.warp)):
            largest[f"{name}_theta_0"] = MAX_REST_ANGLE / stripe.theta_0
        return np.log([[1 / MAX_FACTOR] * len(FITTED), [*largest.values()]])

    def with_parameters(self, logarithms: Logarithms) -> Case:
        return with_factors(self.case, _by_name(np.exp(logarithms)))

    def test(self, logarithms: Logarithms, *, flat: bool = False) -> SimulatedTest | None:
        """A test from the last one that converged, or from the flat sheet; later ones follow it."""
        if logarithms.tobytes() == self.point and not flat:
            return self.near
        test = self._simulated(self.with_parameters(logarithms), None if flat else self.near)
        if test is not None or flat:
            self.near, self.point = test, logarithms.tobytes()
        return test

    def converged(self, logarithms: Logarithms) -> SimulatedTest:
        test = self.test(logarithms)
        assert test is not None  # as it has converged there already
        return test

    def _simulated(self, case: Case, near: SimulatedTest | None) -> SimulatedTest | None:
        """A test, or the kept one of an interrupted fit, which a search repeats exactly."""
        self.tests += 1
        if self.kept is None:
            return simulated_test(case, near)
        path = self.kept / f"{self.tests:03d}-{case.case_id}-{MODEL_VERSION}.npy"
        with suppress(OSError, ValueError):  # it is not there, or damaged
            if has_checksum(path):
                states = np.load(path)
                return SimulatedTest(case, states) if states.size else None
        test = simulated_test(case, near)
        with atomic_write(path) as temporary:
            # The unknowns of its states, none if it did not converge.
            np.save(temporary, np.zeros(0) if test is None else test.unknowns)
            append_checksum(temporary)
        return test

    def from_start(self, point: Logarithms) -> _Optimum:
        """Search from a start whose test is already simulated."""
        for _ in range(MAX_SEARCHES):
            rules = {"ftol": TOLERANCE, "xtol": TOLERANCE, "gtol": None, "max_nfev": MAX_TESTS}
            scaled = {"bounds": self.bounds, "x_scale": self.prior_std}
            result = least_squares(self.residuals, point, self.jacobian, **scaled, **rules)
            point, fitted = result.x, self.converged(result.x)
            confirmed = self.test(point, flat=True)
            chi_squared = np.inf if confirmed is None else self.target.chi_squared(confirmed.values)
            if confirmed is None or self.is_same(fitted, confirmed) or self.is_met(chi_squared):
                break
        prior = result.fun[-len(point) :]
        return _Optimum(result, fitted, confirmed, chi_squared, chi_squared + float(prior @ prior))

    def residuals(self, logarithms: Logarithms) -> Float[np.ndarray, " row"]:
        test = self.test(logarithms)
        if test is None:
            return np.full(int(self.target.measured.sum()) + len(FITTED), np.inf)
        self.step(self.tests, self.target.chi_squared(test.values))
        return np.append(self.target.misfit(test.values), logarithms / self.prior_std)

    def jacobian(self, logarithms: Logarithms) -> Float[np.ndarray, "row name"]:
        test = self.converged(logarithms)
        try:
            slopes = test.slopes()[..., [name in FITTED for name in STRIPE_PARAMETERS]]
        except NoDerivative:
            # The next step then depends on the prior alone, and the fit has a warning.
            self.without_derivatives += 1
            slopes = np.zeros((*test.values.shape, len(FITTED)))
        rows = (slopes / self.target.errors[..., None])[self.target.measured]
        return np.concatenate([rows, np.eye(len(FITTED)) / self.prior_std])

    def is_same(self, one: SimulatedTest, other: SimulatedTest) -> bool:
        difference = self.target.misfit(one.values) - self.target.misfit(other.values)
        return bool(np.abs(difference).max() < SAME_STATES)

    def is_met(self, chi_squared: float) -> bool:
        return chi_squared <= GOOD_MATCH * int(self.target.measured.sum())

    def concluded(self, first: SimulatedTest, best: _Optimum) -> Fit:
        """The fit of the best search, after the first test, with the tabulated stripes."""
        covariance = np.linalg.inv(best.result.jac.T @ best.result.jac)
        errors = np.sqrt(np.diag(covariance))
        curves = first.values, (best.confirmed or best.fitted).values
        before, after = map(self.target.chi_squared, curves)
        return Fit(
            before=self.case,
            after=self.with_parameters(best.result.x),
            factors=_by_name(np.exp(best.result.x)),
            standard_errors=_by_name(errors),
            learned=_by_name(1 - (errors / self.prior_std) ** 2),
            correlations=covariance / np.outer(errors, errors),
            target=self.target,
            curves=curves,
            chi_squared=(before, after),
            tests=self.tests,
            converged=bool(best.result.success and best.confirmed is not None),
            warnings=tuple(self._warnings(best, after)),
        )

    def _warnings(self, best: _Optimum, chi_squared: float) -> Iterator[str]:
        if not best.result.success:
            yield f"the search did not converge in {self.tests} tests; do not use it"
        for name, left in zip(FITTED, np.abs(best.result.x - self.bounds).min(axis=0), strict=True):
            if left < AT_BOUND:
                yield f"{name} is at a bound of the search"
        if self.without_derivatives:
            yield f"{self.without_derivatives} tests had a state without derivatives, at a snap"
        if best.confirmed is None:
            yield "the fitted fabric, tested from the flat sheet, does not converge; do not use it"
        elif not (self.is_same(best.fitted, best.confirmed) or self.is_met(best.chi_squared)):
            yield (
                f"the fabric has several states, and {MAX_SEARCHES} searches reached others than a"
                " test of their result; the match is that of the test, and the standard errors are"
                " not reliable"
            )
        freedom = max(int(self.target.measured.sum()) - len(FITTED), 1)
        if (spread := chi_squared / freedom) > POOR_FIT:
            difference = f"the difference from the test is {np.sqrt(spread):.1f} times its errors"
            yield f"{difference}; the standard errors do not include this"
