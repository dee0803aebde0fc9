"""A search: one design is refined from its start, with gradients or, where these fail, without."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import compress
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter
from scipy.optimize import least_squares, minimize

from knitlab.design.objective import Jacobian, Objective, Residuals, all_met
from knitlab.design.search_space import DesignLabels, Point, SearchSpace
from knitlab.design.trial import Trial, run_trial
from knitlab.io.atomic_write import atomic_write
from knitlab.io.errors import InputError, Mistake
from knitlab.runs.workers import Task, worker_pool
from knitlab.solvers.case import Case
from knitlab.solvers.equilibrium.adjoint import NoDerivative
from knitlab.solvers.method import Progress

TRIALS, SEARCHES = "trials", "searches"  # folders of case files and of results
TOLERANCE = 1e-3  # relative change of squared distance or variables that ends a search
SMALL_DISTANCE = 0.1  # distance at which a search ends early
FAILED_DISTANCE = 1e3  # distance assigned to a trial that did not converge
SPREAD_OF_FIRST = 0.15  # standard deviation of first trials without gradients, in bounds 0 to 1
PENALTY = 10.0  # weight of a violated constraint relative to the distance, without gradients
INSET = 1e-3  # least distance of a start from the bounds, over their distance
MAX_FAILED = 3  # number of trials that may fail before gradients are given up
UNIFORM = 12**-0.5  # standard deviation of a uniform distribution from 0 to 1
WEAK = 0.5  # fraction of that above which a value counts as weakly determined
ATTEMPTS = 3  # how often a search is started if its worker dies


@dataclass(frozen=True)
class TrialRecord:
    """A trial in files of results; distances are those of the :class:`.Objective`."""

    point: list[float]
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
    """The result of a search from one start."""

    design: DesignLabels
    trials: list[TrialRecord]
    best: int | None  # index of the best trial; None if none converged
    ended: str  # why the search ended
    methods: list[str]
    held_by: list[str] = field(default_factory=list)  # active bounds, as rib_theta_0 <= 2.5
    # Relative change of a variable that increases the distance by one while others adapt.
    determined_to: dict[str, float] = field(default_factory=dict)
    undetermined: list[str] = field(default_factory=list)  # as others can compensate them

    def __repr__(self) -> str:
        return f"<SearchResult {self.design}: {len(self.trials)} trials, ended: {self.ended}>"

    @property
    def winner(self) -> TrialRecord | None:
        """The best trial, if any converged."""
        return None if self.best is None else self.trials[self.best]


RESULT = TypeAdapter(SearchResult)  # writes results into JSON files, and reads them


class SearchEnded(Exception):
    """Ends a search before its method does, with the reason."""


@dataclass(eq=False)
class DesignSearch:
    """The search from one design, and its trials so far."""

    space: SearchSpace
    objective: Objective
    design: DesignLabels
    folder: Path  # results folder of the request
    budget: int  # largest number of trials
    deadline: float = np.inf  # time after which no further trial starts, by time.time [s]
    report: Callable[[float], None] = field(init=False)  # called with the distance of each trial
    records: list[TrialRecord] = field(default_factory=list)
    rough: bool = False  # whether a trial snapped or failed, so that gradients may mislead
    _last: tuple[Trial, TrialRecord] | None = None

    def run(self, report: Callable[[float], None]) -> SearchResult:
        """Search from the tabulated values."""
        self.report = report
        # Inside the bounds, as a trust region cannot leave a bound that it starts on.
        start = np.clip(self.space.start(self.design), INSET, 1 - INSET)
        methods = list[str]()
        ended = "the search converged"
        try:
            self.trial(start)
            if len(start) and self.objective.has_gradient:
                constrained = bool(self.objective.request.subject_to)
                methods.append("SLSQP" if constrained else "least squares")
                try:
                    if self.records[0].distance is None:
                        raise NoDerivative("the start has no distance")
                    (self._constrained if constrained else self._unconstrained)(start)
                except NoDerivative:
                    self.rough = True
            stuck = self.rough and not any(record.met for record in self.records)
            if len(start) and (stuck or not self.objective.has_gradient):
                methods.append("CMA-ES")
                self._without_gradients()
        except SearchEnded as reason:
            ended = str(reason)
        best = self._best()
        conditions = {} if best is None else self._conditions(self.records[best])
        return SearchResult(self.design, self.records, best, ended, methods, **conditions)

    def trial(self, point: Point) -> tuple[Trial, TrialRecord]:
        """The trial at a point; SearchEnded if the targets are met closely or none is left."""
        # Rounded, as methods that shift a point back and forth change its last digits.
        point = np.round(np.clip(point, 0, 1), 12)
        if self._last is not None and self._last[1].point == point.tolist():
            return self._last
        if len(self.records) >= self.budget:
            raise SearchEnded("the budget is spent")
        if self.records and time.time() > self.deadline:
            raise SearchEnded("the time is up")
        objective = self.objective
        trial = run_trial(self.folder / TRIALS, *self.space.case(self.design, point), objective.own)
        off_by = objective.off_by(trial) if trial.converged else []
        known = trial.converged and bool(np.isfinite(off_by).all())
        record = TrialRecord(
            point=point.tolist(),
            values=self.space.values(point),
            case_id=trial.case.case_id,
            converged=trial.converged,
            snapped=bool((trial.results["snapped"] == 1).any()),
            off_by=[one if np.isfinite(one) else None for one in off_by],
            distance=float(objective.distance(off_by)) if known else None,
            violation=float(objective.violation(off_by)) if known else None,
            met=known and all_met(objective.request.wanted, off_by),
        )
        self.records.append(record)
        self.rough |= not record.converged or record.snapped
        self._last = trial, record
        self.report(np.inf if record.distance is None else record.distance)
        if record.met and (record.distance or 0.0) <= SMALL_DISTANCE:
            raise SearchEnded("the targets are met")
        return self._last

    def _unconstrained(self, start: Point) -> None:
        # Shifted by one, as the size of the first trust region is the norm of the start.
        def residuals(shifted: Point) -> Residuals:
            trial, record = self.trial(shifted - 1)
            rows, _ = self.objective.residuals(trial)
            # A step that cannot be simulated is rejected, and a shorter one is tried.
            return rows if record.distance is not None else np.full_like(rows, np.inf)

        def jacobian(shifted: Point) -> Jacobian:
            trial, _ = self.trial(shifted - 1)
            return self.objective.residuals(trial, self.objective.slopes(trial))[1]

        tolerances = {"ftol": TOLERANCE, "xtol": TOLERANCE, "gtol": None}
        most = self.budget + 1
        least_squares(residuals, start + 1, jacobian, (1, 2), max_nfev=most, **tolerances)

    def _constrained(self, start: Point) -> None:
        objective = self.objective

        def squared(point: Point) -> tuple[float, Point]:
            trial, record = self.trial(point)
            if record.distance is None:
                if sum(earlier.distance is None for earlier in self.records) >= MAX_FAILED:
                    raise NoDerivative("several trials do not converge")
                return FAILED_DISTANCE**2, np.zeros_like(point)
            residuals, jacobian = objective.residuals(trial, objective.slopes(trial))
            return float(residuals @ residuals), 2 * residuals @ jacobian

        def within(point: Point) -> Residuals:
            trial, record = self.trial(point)
            rows, _ = objective.constraints(trial)
            return rows if record.distance is not None else np.full_like(rows, -FAILED_DISTANCE)

        def within_jacobian(point: Point) -> Jacobian:
            trial, _ = self.trial(point)
            return objective.constraints(trial, objective.slopes(trial))[1]

        settings: dict[str, Any] = {
            "bounds": [(0.0, 1.0)] * len(start),
            "constraints": {"type": "ineq", "fun": within, "jac": within_jacobian},
            "options": {"ftol": TOLERANCE, "maxiter": self.budget},
        }
        minimize(squared, start, jac=True, method="SLSQP", **settings)

    def _without_gradients(self) -> None:
        """Sample around the best trial with an evolution strategy."""
        try:
            from cmaes import CMA
        except ImportError:
            hint = "pip install 'knitlab[design]' to continue without them"
            raise SearchEnded(f"gradients make no further progress; {hint}") from None

        def cost(point: Point) -> float:
            _, record = self.trial(point)
            if record.distance is None:
                return FAILED_DISTANCE
            return record.distance + PENALTY * (record.violation or 0.0)

        variables = len(self.space.names)
        best = self._best()
        mean = np.full(variables, 0.5) if best is None else np.array(self.records[best].point)
        strategy = CMA(mean, SPREAD_OF_FIRST, bounds=np.tile([0.0, 1.0], (variables, 1)), seed=0)
        while not strategy.should_stop():
            population = [strategy.ask() for _ in range(strategy.population_size)]
            strategy.tell([(point, cost(point)) for point in population])

    def _best(self) -> int | None:
        """Index of the best trial: the nearest of those that meet the constraints, if any does."""
        known = [
            (not record.met, record.violation or 0.0, record.distance, index)
            for index, record in enumerate(self.records)
            if record.distance is not None
        ]
        return min(known)[-1] if known else None

    def _conditions(self, best: TrialRecord) -> dict[str, Any]:
        """The active bounds of the best trial, and how well its values are determined."""
        objective = self.objective
        names = self.space.names
        point = np.array(best.point)
        trial = run_trial(self.folder / TRIALS, *self.space.case(self.design, point), objective.own)
        try:
            if not (objective.has_gradient and names):
                raise NoDerivative("the targets have none")
            slopes = objective.slopes(trial)
        except NoDerivative:
            return {"held_by": self.space.bounds_at(point, np.zeros_like(point))}
        residuals, jacobian = objective.residuals(trial, slopes)
        downhill = -(residuals @ jacobian)
        if best.violation:
            rows, rows_jacobian = objective.constraints(trial, slopes)
            downhill -= PENALTY * np.minimum(rows, 0) @ rows_jacobian
        # The prior of every value is uniform between its bounds.
        information = jacobian.T @ jacobian + np.eye(len(names)) / UNIFORM**2
        deviations = np.sqrt(np.diag(np.linalg.inv(information)))
        weak = deviations > WEAK * UNIFORM
        by = np.expm1(deviations * (self.space.width))
        return {
            "held_by": self.space.bounds_at(point, downhill) if downhill.any() else [],
            "determined_to": dict(zip(names, by.tolist(), strict=True)),
            "undetermined": list(compress(names, weak)),
        }


def run_searches(
    searches: Sequence[DesignSearch],
    folder: Path,
    workers: int,
    progress: Callable[[DesignLabels, float], None],
) -> list[SearchResult]:
    """Run searches, each in one worker; InputError with the reason of every one that failed."""
    first = (one.space.case(one.design, one.space.start(one.design))[0] for one in searches)
    starts = {case.case_id: case for case in first}
    by_start = dict(zip(starts, searches, strict=True))

    def report(case_id: str, distance: float) -> None:
        progress(by_start[case_id].design, distance)

    task = Task(partial(_run_search, by_start), folder)
    failed = dict[str, str]()
    pending = list(starts)
    with worker_pool(task, min(workers, len(searches)), None, False, report) as pool:
        for attempt in range(1, ATTEMPTS + 1):
            errors = {
                batch[0].case_id: error
                for batch, error in pool([(starts[case_id],) for case_id in pending])
                if error is not None
            }
            pending = [key for key, error in errors.items() if error.lost and attempt < ATTEMPTS]
            failed |= {key: error.reason for key, error in errors.items() if key not in pending}
    if failed:
        raise InputError(
            Mistake(f"search from {starts[key].label}", reason) for key, reason in failed.items()
        )
    files = [folder / SEARCHES / f"{case_id}.json" for case_id in by_start]
    return [RESULT.validate_json(file.read_bytes()) for file in files]


def _run_search(
    searches: dict[str, DesignSearch], folder: Path, batch: Sequence[Case], progress: Progress
) -> None:
    (start,) = batch
    result = searches[start.case_id].run(partial(progress, start.case_id))
    with atomic_write(folder / SEARCHES / f"{start.case_id}.json") as temporary:
        temporary.write_bytes(RESULT.dump_json(result, indent=1))
