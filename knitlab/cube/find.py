"""Finding the designs of cubes that come closest to targets, without simulation."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from jaxtyping import Float

from knitlab.cube.candidates import Candidates
from knitlab.cube.plain_cube import PlainCube
from knitlab.cube.strain_window import REDUCTIONS, root_mean_square
from knitlab.cube.target import Target, check_window
from knitlab.io.errors import fault

DISTANCE = "distance"
COVERED = {True: "yes", False: "no", None: "unknown"}
Numbers = Float[np.ndarray, " design"]


@dataclass(frozen=True)
class Reached:
    """Distances of the candidates from one target.

    Attributes:
        target: the target.
        at: strains at which the variable was evaluated; empty for a single number [1].
        values: values of the candidates at these, (design, strain), or (design, 1) for a number.
        obtained: one number for each candidate: the value, or the mean over the window.
        off_by: distance from the target, in the unit of the variable; for a curve the root mean
            square over the window.
        worst: the same for the worst fabric within the spread over a design's siblings; equal to
            ``off_by`` if the spread is unknown.
        covered: whether the spread over a design's siblings overlaps the target at every strain;
            ``None`` if the spread is unknown.
        band: lowest and highest values of the siblings, like ``values``; empty for a number.
    """

    target: Target
    at: np.ndarray
    values: Float[np.ndarray, "design strain"]
    obtained: Numbers
    off_by: Numbers
    worst: Numbers
    covered: tuple[bool | None, ...]
    band: tuple[np.ndarray, ...] = ()

    def __repr__(self) -> str:
        return f"<Reached {self.target.text}: {len(self.obtained)} designs, {len(self.at)} strains>"

    @property
    def scale(self) -> float:
        """Unit of distance: the tolerance, or the scatter among the candidates."""
        if self.target.tolerance is not None:
            return self.target.tolerance
        scatter = float(np.nanstd(self.obtained)) if np.isfinite(self.obtained).any() else 0.0
        wanted = [abs(bound) for bound in (self.target.low, self.target.high) if np.isfinite(bound)]
        return scatter or max(wanted) or 1.0


@dataclass(frozen=True)
class Found:
    """Designs by their distance from the targets, the nearest first.

    Attributes:
        table: one row for each design: labels, distance, and for the first target ``value_1``,
            the value or the mean over its window, ``off_by_1``, the distance in the unit of the
            variable, and ``in_spread_1``, whether the spread covers the target; and so on for the
            others. Then the values of the constraints.
        reached: distances from each target, in the order of the table.
        passed_over: designs that were not considered, by reason.
    """

    table: pd.DataFrame
    reached: tuple[Reached, ...]
    passed_over: dict[str, int]

    def __repr__(self) -> str:
        return f"<Found: {len(self.table)} designs, {len(self.reached)} targets>"


def find_designs(
    cubes: Sequence[PlainCube],
    targets: Sequence[Target],
    subject_to: Sequence[Target] = (),
    most: int | None = None,
) -> Found:
    """Rank the designs of cubes by their distance from targets.

    The distance is the root mean square of the distances from each target, each over its
    tolerance or, without one, over the scatter of that variable among the designs.

    Args:
        cubes: cubes of designs along the same dimensions.
        targets: the targets.
        subject_to: targets that must be met; other designs are left out.
        most: largest number of designs to return, all by default.

    Raises:
        BadInput: if there is no target, or if the cubes lack the variable of one.
    """
    if not targets:
        raise fault("targets", "none is given; give a target")
    candidates = Candidates.of(cubes)
    required = [reach(candidates, target) for target in subject_to]
    allowed = np.ones(len(candidates.table), bool)
    for constraint in required:
        allowed &= constraint.off_by == 0
    reached = [reach(candidates, target) for target in targets]
    parts = np.stack([each.off_by / each.scale for each in reached])
    distance = np.sqrt(np.mean(parts**2, axis=0))
    known = np.isfinite(distance)
    order = np.argsort(np.where(allowed & known, distance, np.inf), kind="stable")
    order = order[: int((allowed & known).sum())][:most]
    passed_over = {
        "not ok": candidates.passed_over,
        "do not meet what they are subject to": int((~allowed).sum()),
        "have no value at the strains of a target": int((allowed & ~known).sum()),
    }
    dims = [name for name in ("cube", "boundary") if name in candidates.table]
    table = candidates.table[[*cubes[0].design_dims, *dims]].iloc[order].reset_index(drop=True)
    table[DISTANCE] = distance[order]
    ordered = tuple(in_order(each, order) for each in reached)
    for number, each in enumerate(ordered, start=1):
        table[f"value_{number}"] = each.obtained
        table[f"off_by_{number}"] = each.off_by
        table[f"in_spread_{number}"] = [COVERED[covers] for covers in each.covered]
    for constraint in required:
        table[constraint.target.label] = constraint.obtained[order]
    return Found(table, ordered, {reason: count for reason, count in passed_over.items() if count})


def reach(candidates: Candidates, target: Target) -> Reached:
    """Distances of candidates from a target.

    Raises:
        BadInput: if the cubes lack its variable, or it needs a window of strain.
    """
    source = f"target {target.text}"
    check_window(target, candidates.lies_along_strain(target.name, source), source)
    if target.window is None:
        values = candidates.numbers(target.name)
        none = np.zeros(0)
        off_by = target.excess(values, none)
        covered = _covered(target, none, [], len(values))
        return Reached(target, none, values[:, None], values, off_by, off_by, covered)
    at, curves = candidates.curves(target.name, target.window)
    band = [
        candidates.curves(f"{target.name}_{side}", target.window)[1]
        for side in ("low", "high")
        if any(f"{target.name}_{side}" in cube.dims for cube in candidates.cubes)
    ]
    read = [curves, *band]
    if target.reduction is None:
        obtained = REDUCTIONS["mean"](at, curves)
        excess = [target.excess(item, at) for item in read]
        off_by, worst = (root_mean_square(at, item) for item in (excess[0], np.fmax.reduce(excess)))
    else:
        read = [REDUCTIONS[target.reduction](at, item)[:, None] for item in read]
        obtained = read[0][:, 0]
        excess = [target.excess(item, at)[:, 0] for item in read]
        off_by, worst = excess[0], np.fmax.reduce(excess)
    covered = _covered(target, at, read[1:], len(curves))
    return Reached(target, at, curves, obtained, off_by, worst, covered, tuple(band))


def _covered(
    target: Target, at: np.ndarray, band: Sequence[np.ndarray], designs: int
) -> tuple[bool | None, ...]:
    """Whether the bands of designs overlap the target at every strain."""
    if not band:
        return (None,) * designs
    lowest, highest = np.minimum(*band), np.maximum(*band)
    low, high = target.bounds(at)
    known = np.isfinite(lowest).all(axis=1)
    overlaps = ((lowest <= high) & (highest >= low)).all(axis=1)
    return tuple(bool(a) if b else None for a, b in zip(overlaps, known, strict=True))


def in_order(reached: Reached, order: np.ndarray) -> Reached:
    """The candidates in another order, or a subset of them."""
    return Reached(
        reached.target,
        reached.at,
        reached.values[order],
        reached.obtained[order],
        reached.off_by[order],
        reached.worst[order],
        tuple(reached.covered[place] for place in order),
        tuple(edge[order] for edge in reached.band),
    )
