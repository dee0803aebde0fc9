"""The objective: distances of a trial from the targets, as residuals with their Jacobian."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any

import numpy as np
from jaxtyping import Float

from knitlab.cubes.strain_window import REDUCTIONS, gradient
from knitlab.cubes.target import Target, check_window
from knitlab.design.request import DesignRequest
from knitlab.design.trial import ALONG_STRAIN, OF_DESIGN, OVER_WIDTH, ShapeFunctions, Slopes, Trial
from knitlab.io.errors import ErrorCollector, Mistake, raise_if_any, unknown
from knitlab.observables.case_variables import variables_of
from knitlab.observables.of_cubes import CLOTH, DESIGN, STRIPES
from knitlab.observables.schema import STRAIN, VARIABLES
from knitlab.solvers.case import Case

PLANNED = (DESIGN, STRIPES, CLOTH)  # variables known without a simulation
INSET = 0.9  # fraction of an allowance that a search uses
INSIDE = 0.1  # fraction of the tolerance by which a search aims inside a range

Residuals = Float[np.ndarray, " row"]
Jacobian = Float[np.ndarray, "row variable"]


def tolerance(target: Target) -> float:
    """Unit of the distance from a target: its tolerance, which those of a request have."""
    assert target.tolerance is not None
    return target.tolerance


def all_met(targets: Sequence[Target], off_by: Sequence[float]) -> bool:
    """Whether all distances from targets are within their allowances."""
    return all(off <= target.allowance for off, target in zip(off_by, targets, strict=True))


def aimed(target: Target) -> Target:
    """The target that a search aims at: a narrower range, so that it ends within the bounds."""
    width = target.high - target.low
    if target.curve is not None or width == 0:
        return target
    inside = min(INSIDE * tolerance(target), width / 4)
    return replace(target, low=target.low + inside, high=target.high - inside)


@dataclass(frozen=True, eq=False)
class Objective:
    """Targets and constraints of a search, which may name the user's functions of shapes."""

    request: DesignRequest
    own: ShapeFunctions
    parameter_slopes: Float[np.ndarray, "parameter variable"]  # of logarithms

    @property
    def has_gradient(self) -> bool:
        """Whether all variables have derivatives."""
        names = {target.name for target in self.request.wanted}
        return names <= {*ALONG_STRAIN, *OF_DESIGN, *OVER_WIDTH, *dict(self.own)}

    def off_by(self, trial: Trial) -> list[float]:
        """Distance of a trial from each target and constraint, in the unit of its variable."""
        distances = []
        for target in self.request.wanted:
            at, values, _ = self._read(target, trial, None)
            departure = target.departure(values, at)
            distances.append(float(np.sqrt(_weights(at, len(values)) @ departure**2)))
        return distances

    def distance(self, off_by: Sequence[Any]) -> Any:
        """Root mean square of distances from the targets, over tolerances; numbers or arrays."""
        pairs = zip(off_by, self.request.targets, strict=False)
        return np.sqrt(np.mean(np.square([off / tolerance(each) for off, each in pairs]), axis=0))

    def violation(self, off_by: Sequence[Any]) -> Any:
        """Largest excess over the allowance of a constraint, in tolerances; 0 if all are met."""
        request = self.request
        pairs = zip(off_by[len(request.targets) :], request.subject_to, strict=True)
        excess = ((off - each.allowance) / tolerance(each) for off, each in pairs)
        return reduce(np.fmax, excess, 0.0)

    def slopes(self, trial: Trial) -> Slopes:
        """Derivatives of the variables that targets name; NoDerivative as at a snap."""
        needed = np.zeros(len(trial.strains), bool)
        for target in self.request.wanted:
            if target.window is not None:
                _, weights = target.window.read(trial.strains, np.eye(len(trial.strains)))
                needed |= (weights != 0).any(axis=1) | (target.name in OVER_WIDTH)
        names = tuple(dict.fromkeys(target.name for target in self.request.wanted))
        return trial.slopes(names, tuple(needed.tolist()))

    def residuals(self, trial: Trial, slopes: Slopes | None = None) -> tuple[Residuals, Jacobian]:
        """Residuals, whose squares sum to that of the distance from the aims, and derivatives."""
        rows = []
        by = []
        count = len(self.request.targets)
        for target in map(aimed, self.request.targets):
            at, values, by_variables = self._read(target, trial, slopes)
            weights = np.sqrt(_weights(at, len(values)) / count) / tolerance(target)
            departure = target.departure(values, at)
            rows.append(departure * weights)
            by.append(((departure != 0) * weights)[:, None] * by_variables)
        return np.concatenate(rows), np.concatenate(by)

    def constraints(self, trial: Trial, slopes: Slopes | None = None) -> tuple[Residuals, Jacobian]:
        """Constraint functions over their tolerances, not negative if met, and derivatives."""
        rows = [np.zeros(0)]
        by = [np.zeros((0, self.parameter_slopes.shape[1]))]
        for target in map(aimed, self.request.subject_to):
            at, values, by_variables = self._read(target, trial, slopes)
            for sign, bound in zip((1.0, -1.0), target.bounds(at), strict=True):
                if np.isfinite(bound).all():
                    room = sign * (values - bound) + INSET * target.allowance
                    rows.append(room / tolerance(target))
                    by.append(sign * by_variables / tolerance(target))
        return np.concatenate(rows), np.concatenate(by)

    def _read(
        self, target: Target, trial: Trial, slopes: Slopes | None
    ) -> tuple[Float[np.ndarray, " point"], Residuals, Jacobian]:
        """Strains of a window, none for a number; values at these; derivatives, or 0."""
        values = trial.values(target.name)
        slopes = slopes or {target.name: np.zeros((len(values), len(self.parameter_slopes)))}
        by = slopes[target.name] @ self.parameter_slopes
        if target.window is None:
            return np.zeros(0), values, by
        at, curve = target.window.read(trial.strains, values[None])
        by = target.window.read(trial.strains, by.T)[1].T
        if target.reduction is None:
            return at, curve[0], by
        reduced = REDUCTIONS[target.reduction](at, curve)
        return np.zeros(0), reduced, gradient(target.reduction, at, curve[0])[None] @ by


def _weights(at: Float[np.ndarray, " point"], rows: int) -> Float[np.ndarray, " row"]:
    """Weights of the trapezoidal rule over a window, which sum to one."""
    many = len(at) > 1
    return np.trapezoid(np.eye(rows), at) / np.ptp(at) if many else np.full(rows, 1.0 / rows)


def check_targets(targets: Sequence[Target], own: ShapeFunctions, case: Case) -> None:
    """Raise InputError unless a case has the variables of targets, with windows where needed."""
    mistakes = ErrorCollector()
    stored = variables_of(case)
    known = {
        name: STRAIN in variable.dims
        for name, variable in VARIABLES.items()
        if set(variable.dims) <= {STRAIN} and (name in stored or variable.group in PLANNED)
    } | dict.fromkeys(dict(own), True)
    if {"reaction_force", "knit_cell_x"} <= known.keys():
        known |= dict.fromkeys(OVER_WIDTH, True)
    for target in targets:
        where = f"target {target.text}"
        if target.name not in known:
            mistakes.all.append(Mistake(where, unknown(target.name, sorted(known), "variable")))
        elif target.name.startswith("poisson_ratio") and case.all_corners_held:
            message = "a sample of one unit cell between clamps has none; add unit_cells"
            mistakes.all.append(Mistake(where, message))
        else:
            with mistakes:
                check_window(target, known[target.name], where)
                if target.window and target.name.startswith("poisson_ratio"):
                    target.window.check_start(case.applied_strain[1], target.name, where)
    raise_if_any(mistakes.all)
