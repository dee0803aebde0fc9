"""A search: one design is refined from its start, with gradients or, where these fail, without."""

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares, minimize

from knitlab.equilibrium.linear_response import NoDerivative
from knitlab.inverse.objective import Objective
from knitlab.inverse.quantities import Measures
from knitlab.inverse.search_space import DesignLabels, Place, SearchSpace
from knitlab.inverse.trial import Trial, run_trial

TOLERANCE = 1e-3
"""Relative change of the squared distance, and of the variables, that ends a search."""
SMALL_DISTANCE = 0.1
"""Distance at which a search ends early."""
FAILED_DISTANCE = 1e3
"""Distance assigned to a trial that did not converge, for methods that need a finite one."""
SPREAD_OF_FIRST = 0.15
"""Standard deviation of the first trials without gradients, over the distance of the bounds."""
PENALTY = 10.0
"""Weight of a violated constraint relative to the distance, without gradients."""
INSET = 1e-3
"""Least distance of a start from the bounds, over their distance."""
PLACES = 12
"""Decimal places of a point."""
MOST_FAILED = 3
"""Number of trials that may fail before gradients are given up."""
UNIFORM = 12**-0.5
"""Standard deviation of a uniform distribution between the bounds, over their distance."""
HARDLY = 0.5
"""Fraction of that above which a value counts as hardly determined."""

Report = Callable[[float], None]


@dataclass(frozen=True)
class TrialRecord:
    """The record of a trial.

    Attributes:
        place: its point in the search space.
        values: values of the variables, in their units.
        case_id: identifier of its case.
        converged: whether its whole test converged.
        snapped: whether the fabric snapped.
        off_by: distance from each target and constraint, in the unit of the variable.
        distance: distance from the targets.
        violation: violation of the constraints.
        met: whether all targets and constraints are met.
    """

    place: list[float]
    values: dict[str, float]
    case_id: str
    converged: bool
    snapped: bool
    off_by: list[float | None]
    distance: float | None
    violation: float | None
    met: bool

    def __repr__(self) -> str:
        distance = "" if self.distance is None else f", distance {self.distance:.4g}"
        return f"<TrialRecord {self.case_id}: {len(self.values)} variables{distance}>"


@dataclass(frozen=True)
class SearchResult:
    """The result of a search from one start.

    Attributes:
        design: n_stripe and n_subunit.
        trials: all trials, in order.
        best: index of the best trial; ``None`` if none converged.
        ended: why the search ended.
        methods: methods of the search.
        held_by: active bounds, such as ``rib_theta_0 <= 2.5``.
        determined_to: relative change of each variable, with the others adapting, that increases
            the distance by one; at most that to its bounds.
        undetermined: variables that the targets hardly determine, as others can compensate them.
    """

    design: DesignLabels
    trials: list[TrialRecord]
    best: int | None
    ended: str
    methods: list[str]
    held_by: list[str] = field(default_factory=list)
    determined_to: dict[str, float] = field(default_factory=dict)
    undetermined: list[str] = field(default_factory=list)

    def __repr__(self) -> str:
        return f"<SearchResult {self.design}: {len(self.trials)} trials, ended: {self.ended}>"

    @property
    def winner(self) -> TrialRecord | None:
        """The best trial, if any converged."""
        return None if self.best is None else self.trials[self.best]

    def record(self) -> dict[str, Any]:
        """The result as a JSON object."""
        return asdict(self)


class SearchEnded(Exception):
    """Ends a search before its method does, with the reason."""


class _GradientsFail(Exception):
    """Gradients do not help a search."""


@dataclass
class DesignSearch:
    """Trials of one design.

    Attributes:
        space: the search space.
        objective: the objective.
        design: n_stripe and n_subunit.
        folder: folder of the case files of trials.
        budget: largest number of trials.
        deadline: time after which no further trial starts, by :func:`time.time` [s].
        report: called after each trial with its distance.
        measures: own measures of shapes.
    """

    space: SearchSpace
    objective: Objective
    design: DesignLabels
    folder: Path
    budget: int
    deadline: float = np.inf
    report: Report = lambda distance: None
    measures: Measures = ()
    records: list[TrialRecord] = field(default_factory=list)
    rough: bool = False
    _last: tuple[bytes, Trial, TrialRecord] | None = None

    def run(self) -> SearchResult:
        """Search from the tabulated values.

        Raises:
            CannotWrite: if a trial cannot be written.
        """
        # Inside the bounds, as a trust region cannot leave a bound that it starts on.
        start = np.clip(self.space.start(self.design), INSET, 1 - INSET)
        methods, ended = list[str](), "the search converged"
        try:
            self.trial(start)
            if len(start):
                if self.objective.has_gradient:
                    methods.append("SLSQP" if self.objective.subject_to else "least squares")
                    self._by_gradients(start)
                if not self.objective.has_gradient or (self.rough and not self._met()):
                    methods.append("CMA-ES")
                    self._without_gradients()
        except SearchEnded as reason:
            ended = str(reason)
        found = SearchResult(self.design, self.records, self._best(), ended, methods)
        return found if found.best is None else self._with_conditions(found, found.best)

    def trial(self, place: Place) -> tuple[Trial, TrialRecord]:
        """The trial at a point.

        Raises:
            SearchEnded: if the targets are met closely, or the budget is spent.
        """
        # Rounded, as methods that shift a point back and forth change its last digits.
        place = np.round(np.clip(place, 0, 1), PLACES)
        key = place.tobytes()
        if self._last is not None and self._last[0] == key:
            return self._last[1:]
        values = self.space.values(place)
        case, gauge = self.space.case(self.design, place)
        if len(self.records) >= self.budget:
            raise SearchEnded("the budget is spent")
        if self.records and time.time() > self.deadline:
            raise SearchEnded("the time is up")
        found = run_trial(self.folder, case, gauge, self.measures)
        record = self._record(found, place, values)
        self.records.append(record)
        self.rough |= not record.converged or record.snapped
        self._last = key, found, record
        self.report(np.inf if record.distance is None else record.distance)
        if record.met and (record.distance or 0.0) <= SMALL_DISTANCE:
            raise SearchEnded("the targets are met")
        return found, record

    def _record(self, trial: Trial, place: Place, values: dict[str, float]) -> TrialRecord:
        known = trial.converged
        off_by = self.objective.off_by(trial) if known else []
        known = known and bool(np.isfinite(off_by).all())
        return TrialRecord(
            place=place.tolist(),
            values=values,
            case_id=trial.case.case_id,
            converged=trial.converged,
            snapped=trial.snapped,
            off_by=[float(one) if np.isfinite(one) else None for one in off_by],
            distance=self.objective.distance(off_by) if known else None,
            violation=self.objective.violation(off_by) if known else None,
            met=known and self.objective.met(off_by),
        )

    def _by_gradients(self, start: Place) -> None:
        """Search with adjoint gradients until the method ends or a derivative is missing."""
        if self.records[-1].distance is None:
            self.rough = True
            return
        try:
            if self.objective.subject_to:
                self._constrained(start)
            else:
                # Shifted by one, as the size of the first trust region is the norm of the start.
                least_squares(
                    lambda shifted: self._residuals(shifted - 1),
                    start + 1,
                    jac=lambda shifted: self.objective.jacobian(self.trial(shifted - 1)[0]),
                    bounds=(1, 2),
                    ftol=TOLERANCE,
                    xtol=TOLERANCE,
                    gtol=None,
                    max_nfev=self.budget + 1,
                )
        except (NoDerivative, _GradientsFail):
            self.rough = True

    def _residuals(self, place: Place) -> Float[np.ndarray, " row"]:
        found, record = self.trial(place)
        residuals = self.objective.residuals(found)
        # A step that cannot be simulated is rejected, and a shorter one is tried.
        return residuals if record.distance is not None else np.full_like(residuals, np.inf)

    def _constrained(self, start: Place) -> None:
        objective = self.objective

        def squared(place: Place) -> tuple[float, Place]:
            found, record = self.trial(place)
            if record.distance is None:
                if sum(earlier.distance is None for earlier in self.records) >= MOST_FAILED:
                    raise _GradientsFail
                return FAILED_DISTANCE**2, np.zeros_like(place)
            residuals = objective.residuals(found)
            return float(residuals @ residuals), 2 * residuals @ objective.jacobian(found)

        def within(place: Place) -> Float[np.ndarray, " row"]:
            found, record = self.trial(place)
            rows = objective.constraints(found)
            return rows if record.distance is not None else np.full_like(rows, -FAILED_DISTANCE)

        minimize(
            squared,
            start,
            jac=True,
            method="SLSQP",
            bounds=[(0.0, 1.0)] * len(start),
            constraints=[
                {
                    "type": "ineq",
                    "fun": within,
                    "jac": lambda place: objective.constraints_jacobian(self.trial(place)[0]),
                }
            ],
            options={"ftol": TOLERANCE, "maxiter": self.budget},
        )

    def _without_gradients(self) -> None:
        """Sample around the best trial with an evolution strategy until the budget is spent.

        Raises:
            SearchEnded: if the library is not installed, or the budget is spent.
        """
        try:
            from cmaes import CMA
        except ImportError:
            remedy = "pip install 'knitlab[design]' to continue without them"
            raise SearchEnded(f"gradients make no further progress; {remedy}") from None
        variables = len(self.space.names)
        best = self._best()
        at = np.array(self.records[best].place) if best is not None else None
        strategy = CMA(
            mean=np.full(variables, 0.5) if at is None else at,
            sigma=SPREAD_OF_FIRST,
            bounds=np.tile([0.0, 1.0], (variables, 1)),
            seed=0,
        )
        while not strategy.should_stop():
            population = [strategy.ask() for _ in range(strategy.population_size)]
            strategy.tell([(place, self._cost(place)) for place in population])

    def _cost(self, place: Place) -> float:
        _, record = self.trial(place)
        if record.distance is None:
            return FAILED_DISTANCE
        return record.distance + PENALTY * (record.violation or 0.0)

    def _met(self) -> bool:
        return any(record.met for record in self.records)

    def _best(self) -> int | None:
        """Index of the best trial: the nearest of those that meet the constraints, if any does."""
        known = [
            (not record.met, record.violation or 0.0, record.distance, place)
            for place, record in enumerate(self.records)
            if record.distance is not None
        ]
        return min(known)[-1] if known else None

    def _with_conditions(self, found: SearchResult, best: int) -> SearchResult:
        """Add the active bounds of the best trial, and how well its values are determined."""
        names, spans = self.space.names, self.space.upper - self.space.lower
        place = np.array(self.records[best].place)
        case, gauge = self.space.case(self.design, place)
        trial = run_trial(self.folder, case, gauge, self.measures)
        anywhere = self.space.bounds_at(place, np.zeros_like(place))
        if not (self.objective.has_gradient and names):
            return replace(found, held_by=anywhere)
        try:
            residuals, jacobian = self.objective.residuals(trial), self.objective.jacobian(trial)
        except NoDerivative:
            return replace(found, held_by=anywhere)
        downhill = -(residuals @ jacobian)
        if self.records[best].violation:
            broken = np.minimum(self.objective.constraints(trial), 0)
            downhill -= PENALTY * broken @ self.objective.constraints_jacobian(trial)
        # The prior of every value is uniform between its bounds.
        information = jacobian.T @ jacobian + np.eye(len(names)) / UNIFORM**2
        deviations = np.sqrt(np.diag(np.linalg.inv(information)))
        return replace(
            found,
            held_by=self.space.bounds_at(place, downhill) if downhill.any() else [],
            determined_to=dict(zip(names, np.expm1(deviations * spans).tolist(), strict=True)),
            undetermined=[
                name for name, sd in zip(names, deviations, strict=True) if sd > HARDLY * UNIFORM
            ],
        )
