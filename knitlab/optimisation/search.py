"""A search: one design refined from its start, by gradients or, where these fail, without."""

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares, minimize

from knitlab.mechanics.linear_response import NoDerivative
from knitlab.optimisation.objective import Objective
from knitlab.optimisation.quantities import Measures
from knitlab.optimisation.search_space import DesignLabels, Place, SearchSpace
from knitlab.optimisation.trial import Trial, run_trial

ENOUGH = 1e-3
"""Relative change of the squared distance, and of the variables, that ends a search."""
WELL_MET = 0.1
"""Distance that ends a search at once."""
FAR = 1e3
"""Distance of a trial that did not converge, for a method that cannot take an infinite one."""
SPREAD_OF_FIRST = 0.15
"""Standard deviation of the first trials without gradients, in parts of the bounds."""
PENALTY = 10.0
"""Weight of a violated constraint beside the distance, without gradients."""
INSET = 1e-3
"""Distance of a start from the bounds, in parts of these."""
PLACES = 12
"""Decimal places of a place."""
MOST_FAILED = 3
"""Trials that may not converge before gradients are given up."""
UNIFORM = 12**-0.5
"""Standard deviation of a value of which only its bounds are known, in parts of these."""
HARDLY = 0.5
"""Part of that above which a value counts as hardly determined."""

Report = Callable[[float], None]


@dataclass(frozen=True)
class TrialRecord:
    """What is kept of a trial beside its case file.

    Attributes:
        place: of the variables between their bounds.
        values: of the variables, in their units.
        case_id: of its case file.
        converged: whether its whole test converged.
        snapped: whether the fabric snapped.
        off_by: how far it is from each target and constraint, in the variable's unit.
        distance: from the targets.
        violation: of the constraints.
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


@dataclass(frozen=True)
class SearchResult:
    """What a search from one start came to.

    Attributes:
        design: n_stripe and n_subunit.
        trials: all trials, in order.
        best: place of the best among them; ``None`` if none converged.
        ended: why it ended.
        methods: what it was searched by.
        held_by: bounds that hold it back, such as ``rib_theta_0 <= 2.5``.
        determined_to: how far each variable may change, the others following, until the distance
            has grown by one, relative; as far as its bounds along a valley.
        undetermined: variables that the targets hardly determine, as others make up for them.
    """

    design: DesignLabels
    trials: list[TrialRecord]
    best: int | None
    ended: str
    methods: list[str]
    held_by: list[str] = field(default_factory=list)
    determined_to: dict[str, float] = field(default_factory=dict)
    undetermined: list[str] = field(default_factory=list)

    @property
    def winner(self) -> TrialRecord | None:
        """The best trial, if any converged."""
        return None if self.best is None else self.trials[self.best]

    def record(self) -> dict[str, Any]:
        """The result as JSON holds it."""
        return asdict(self)


class SearchEnded(Exception):
    """A search that ends before its method would end it, with the reason."""


class _Rough(Exception):
    """A search that gradients lead nowhere."""


@dataclass
class Search:
    """Trials of one design.

    Attributes:
        space: what may vary.
        objective: what is wanted.
        design: n_stripe and n_subunit.
        folder: where case files of trials are kept.
        budget: most trials.
        deadline: time of the clock at which no further trial begins [s].
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
        """Search from the values of the tables.

        Raises:
            CannotWrite: if a trial cannot be written.
        """
        # Within the bounds, for on one there is no way back for a trust region.
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
        """The trial at a place.

        Raises:
            SearchEnded: if the targets are well met, or the budget is spent.
        """
        # What shifts a place back and forth rounds it.
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
        if record.met and (record.distance or 0.0) <= WELL_MET:
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
        """Descend by adjoint gradients until the method ends or a derivative is missing."""
        if self.records[-1].distance is None:
            self.rough = True
            return
        try:
            if self.objective.subject_to:
                self._constrained(start)
            else:
                # Shifted by one, as the first trust region is as large as the start.
                least_squares(
                    lambda shifted: self._residuals(shifted - 1),
                    start + 1,
                    jac=lambda shifted: self.objective.jacobian(self.trial(shifted - 1)[0]),
                    bounds=(1, 2),
                    ftol=ENOUGH,
                    xtol=ENOUGH,
                    gtol=None,
                    max_nfev=self.budget + 1,
                )
        except (NoDerivative, _Rough):
            self.rough = True

    def _residuals(self, place: Place) -> Float[np.ndarray, " row"]:
        found, record = self.trial(place)
        residuals = self.objective.residuals(found)
        # A step that cannot be simulated is refused, and a shorter one tried.
        return residuals if record.distance is not None else np.full_like(residuals, np.inf)

    def _constrained(self, start: Place) -> None:
        objective = self.objective

        def squared(place: Place) -> tuple[float, Place]:
            found, record = self.trial(place)
            if record.distance is None:
                if sum(its.distance is None for its in self.records) >= MOST_FAILED:
                    raise _Rough
                return FAR**2, np.zeros_like(place)
            residuals = objective.residuals(found)
            return float(residuals @ residuals), 2 * residuals @ objective.jacobian(found)

        def within(place: Place) -> Float[np.ndarray, " row"]:
            found, record = self.trial(place)
            rows = objective.constraints(found)
            return rows if record.distance is not None else np.full_like(rows, -FAR)

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
            options={"ftol": ENOUGH, "maxiter": self.budget},
        )

    def _without_gradients(self) -> None:
        """Sample around the best trial with an evolution strategy until the budget is spent.

        Raises:
            SearchEnded: if the library is not installed, or the budget is spent.
        """
        try:
            from cmaes import CMA
        except ImportError:
            remedy = "pip install 'knitlab[design]' to search on without them"
            raise SearchEnded(f"gradients lead no further here; {remedy}") from None
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
            asked = [strategy.ask() for _ in range(strategy.population_size)]
            strategy.tell([(place, self._cost(place)) for place in asked])

    def _cost(self, place: Place) -> float:
        _, record = self.trial(place)
        if record.distance is None:
            return FAR
        return record.distance + PENALTY * (record.violation or 0.0)

    def _met(self) -> bool:
        return any(record.met for record in self.records)

    def _best(self) -> int | None:
        """Place of the best trial: the nearest of those that meet the constraints, if any does."""
        known = [
            (not record.met, record.violation or 0.0, record.distance, place)
            for place, record in enumerate(self.records)
            if record.distance is not None
        ]
        return min(known)[-1] if known else None

    def _with_conditions(self, found: SearchResult, best: int) -> SearchResult:
        """With the bounds that hold the best trial back, and how well its values are determined."""
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
        # A value is known to lie within its bounds in any case: uniform between them.
        information = jacobian.T @ jacobian + np.eye(len(names)) / UNIFORM**2
        deviations = np.sqrt(np.diag(np.linalg.inv(information)))
        return replace(
            found,
            held_by=self.space.bounds_at(place, downhill) if downhill.any() else [],
            determined_to=dict(zip(names, np.expm1(deviations * spans).tolist(), strict=True)),
            undetermined=[
                name for name, its in zip(names, deviations, strict=True) if its > HARDLY * UNIFORM
            ],
        )
