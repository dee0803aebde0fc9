"""The objective: how far a trial is from the targets, as least-squares residuals with Jacobian."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from knitlab.io.errors import BadInput, ErrorCollector, Fault
from knitlab.io.schema import VARIABLES
from knitlab.io.suggestions import unknown
from knitlab.optimisation.quantities import ALONG_STRAIN, OF_DESIGN
from knitlab.optimisation.trial import Slopes, Trial
from knitlab.simulation.case import Case
from knitlab.simulation.measurement import variables_of
from knitlab.tables.strain_window import REDUCTIONS, STRAIN, gradient
from knitlab.tables.target import Target, check_window

OF_PLANS = ("design", "stripes", "cloth")
"""Kinds of variables that follow from a case without its file."""
INSET = 0.9
"""Part of an allowance that a search makes use of."""
INSIDE = 0.1
"""Part of the tolerance by which a search aims inside a wanted range, to end within it."""

Residuals = Float[np.ndarray, " row"]
Jacobian = Float[np.ndarray, "row variable"]


def scale_of(target: Target) -> float:
    """Distance from a target that counts as one: its tolerance.

    Raises:
        TypeError: if it has none.
    """
    if target.tolerance is None:
        raise TypeError(f"target {target.text} has no tolerance")
    return target.tolerance


def distance_of(targets: Sequence[Target], off_by: Sequence[Any]) -> Any:
    """Root mean square of distances from targets, each over its tolerance.

    Args:
        targets: the targets.
        off_by: distance from each, in the unit of its variable: numbers, or arrays over trials.
    """
    scaled = [off / scale_of(its) for off, its in zip(off_by, targets, strict=True)]
    return np.sqrt(np.mean(np.square(scaled), axis=0))


def all_met(targets: Sequence[Target], off_by: Sequence[float]) -> bool:
    """Whether distances from targets are allowed, each in the unit of its variable."""
    return all(off <= its.allowance for off, its in zip(off_by, targets, strict=True))


def violation_of(targets: Sequence[Target], off_by: Sequence[float]) -> float:
    """Largest of distances from targets, past what is allowed, over its tolerance; 0 if met."""
    past = zip(off_by, targets, strict=True)
    return max((max(off - its.allowance, 0.0) / scale_of(its) for off, its in past), default=0.0)


def aimed(target: Target) -> Target:
    """What a search aims at: a range is made narrower, that its bounds are met in the end."""
    width = target.high - target.low
    if target.curve is not None or width == 0:
        return target
    inside = min(INSIDE * scale_of(target), width / 4)
    return replace(target, low=target.low + inside, high=target.high - inside)


@dataclass(frozen=True)
class Reading:
    """A variable of a trial over the window of a target.

    Attributes:
        at: strains of the window; none of a single number.
        values: there, or reduced to one.
        slopes: their derivatives by what varies.
    """

    at: Float[np.ndarray, " point"]
    values: Float[np.ndarray, " row"]
    slopes: Jacobian


@dataclass(frozen=True, eq=False)
class Objective:
    """Targets and constraints of a search.

    Attributes:
        targets: what is wanted.
        subject_to: what must be met.
        own: names of own measures.
        acts_on: how the logarithm of each parameter follows each variable.
    """

    targets: tuple[Target, ...]
    subject_to: tuple[Target, ...]
    own: tuple[str, ...]
    acts_on: Float[np.ndarray, "parameter variable"]

    @property
    def names(self) -> tuple[str, ...]:
        """Variables that it reads."""
        return tuple(dict.fromkeys(its.name for its in (*self.targets, *self.subject_to)))

    @property
    def has_gradient(self) -> bool:
        """Whether all that it reads has derivatives."""
        return set(self.names) <= {*ALONG_STRAIN, *OF_DESIGN, *self.own}

    def off_by(self, trial: Trial) -> list[float]:
        """How far a trial is from each target and constraint, in the unit of its variable."""
        found = []
        for target in (*self.targets, *self.subject_to):
            read = self._read(target, trial, None)
            weights = _weights(read.at, len(read.values))
            excess = target.excess(read.values, read.at)
            found.append(float(np.sqrt(weights @ excess**2)))
        return found

    def distance(self, off_by: Sequence[float]) -> float:
        """Distance of what is so far off from the targets, see :func:`distance_of`."""
        return float(distance_of(self.targets, off_by[: len(self.targets)]))

    def violation(self, off_by: Sequence[float]) -> float:
        """Violation of the constraints, see :func:`violation_of`."""
        return violation_of(self.subject_to, off_by[len(self.targets) :])

    def met(self, off_by: Sequence[float]) -> bool:
        """Whether all is within a tolerance of each wanted value, and within each range."""
        return all_met((*self.targets, *self.subject_to), off_by)

    def residuals(self, trial: Trial) -> Residuals:
        """Rows whose sum of squares is the squared distance of what the search aims at."""
        return self._stacked(trial, None)[0]

    def jacobian(self, trial: Trial) -> Jacobian:
        """Derivatives of :meth:`residuals` by what varies.

        Raises:
            NoDerivative: if a state is no stable equilibrium, as at a snap.
        """
        return self._stacked(trial, self._slopes(trial))[1]

    def constraints(self, trial: Trial) -> Residuals:
        """What must not be negative, over the scale of its constraint."""
        return self._constrained(trial, None)[0]

    def constraints_jacobian(self, trial: Trial) -> Jacobian:
        """Derivatives of :meth:`constraints` by what varies.

        Raises:
            NoDerivative: if a state is no stable equilibrium, as at a snap.
        """
        return self._constrained(trial, self._slopes(trial))[1]

    def _slopes(self, trial: Trial) -> dict[str, Slopes]:
        needed = np.zeros(len(trial.strains), bool)
        for target in (*self.targets, *self.subject_to):
            if target.window is not None:
                _, weights = target.window.read(trial.strains, np.eye(len(trial.strains)))
                needed |= (weights != 0).any(axis=1)
        # What has no value at zero strain has that of the next there.
        needed[1:2] |= needed[:1]
        return trial.slopes(self.names, needed)

    def _stacked(
        self, trial: Trial, slopes: dict[str, Slopes] | None
    ) -> tuple[Residuals, Jacobian]:
        rows, by = [], []
        for target in map(aimed, self.targets):
            read = self._read(target, trial, slopes)
            share = np.sqrt(_weights(read.at, len(read.values)) / len(self.targets))
            departure = target.departure(read.values, read.at)
            outside = (departure != 0) * share / scale_of(target)
            rows.append(departure * share / scale_of(target))
            by.append(outside[:, None] * read.slopes)
        return np.concatenate(rows), np.concatenate(by)

    def _constrained(
        self, trial: Trial, slopes: dict[str, Slopes] | None
    ) -> tuple[Residuals, Jacobian]:
        rows, by = [np.zeros(0)], [np.zeros((0, self.acts_on.shape[1]))]
        for target in map(aimed, self.subject_to):
            read, scale = self._read(target, trial, slopes), scale_of(target)
            low, high = target.bounds(read.at)
            for sign, bound in ((1.0, low), (-1.0, high)):
                if np.isfinite(bound).all():
                    rows.append((sign * (read.values - bound) + INSET * target.allowance) / scale)
                    by.append(sign * read.slopes / scale)
        return np.concatenate(rows), np.concatenate(by)

    def _read(self, target: Target, trial: Trial, slopes: dict[str, Slopes] | None) -> Reading:
        values, by = trial.values(target.name), np.zeros((1, self.acts_on.shape[1]))
        if slopes is not None:
            by = slopes[target.name] @ self.acts_on
        if target.window is None:
            return Reading(np.zeros(0), values, by)
        at, curve = target.window.read(trial.strains, values[None])
        if slopes is not None:
            by = target.window.read(trial.strains, by.T)[1].T
        else:
            by = np.broadcast_to(by, (len(at), by.shape[1]))
        if target.reduction is None:
            return Reading(at, curve[0], by)
        reduced = REDUCTIONS[target.reduction](at, curve)
        return Reading(np.zeros(0), reduced, gradient(target.reduction, at, curve[0])[None] @ by)


def _weights(at: Float[np.ndarray, " point"], rows: int) -> Float[np.ndarray, " row"]:
    """Weights of values over a window, by the trapezoidal rule, that sum to one."""
    if len(at) < 2:
        return np.full(rows, 1.0 / rows)
    parts = np.diff(at)
    weights = (np.append(parts, 0.0) + np.append(0.0, parts)) / 2
    return weights / (at[-1] - at[0])


def check_targets(targets: Sequence[Target], measures: Sequence[str], case: Case) -> None:
    """Refuse targets of variables that a test does not have, or without their window.

    Args:
        targets: targets and constraints.
        measures: names of own measures.
        case: one of the cases.

    Raises:
        BadInput: with all of them.
    """
    faults = ErrorCollector()
    there = variables_of(case)
    known = {
        name: STRAIN in its.dims
        for name, its in VARIABLES.items()
        if set(its.dims) <= {STRAIN} and (name in there or its.of in OF_PLANS)
    } | dict.fromkeys(measures, True)
    for target in targets:
        place = f"target {target.text}"
        if target.name not in known:
            faults.all.append(Fault(place, unknown(target.name, sorted(known), "variable")))
        elif target.name.startswith("poisson_ratio") and case.all_corners_held:
            problem = "a sample of one unit cell between clamps has none; add unit_cells"
            faults.all.append(Fault(place, problem))
        else:
            with faults:
                check_window(target, known[target.name], place)
    if faults.all:
        raise BadInput(faults.all)
