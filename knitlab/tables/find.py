"""Finding: which designs of cubes come closest to wanted values, without a simulation."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from jaxtyping import Float

from knitlab.io.errors import fault
from knitlab.io.plain_cube import PlainCube
from knitlab.tables.candidates import Candidates
from knitlab.tables.strain_window import REDUCTIONS, root_mean_square
from knitlab.tables.target import Target

DISTANCE = "distance"
COVERED = {True: "yes", False: "no", None: "unknown"}
Numbers = Float[np.ndarray, " design"]


@dataclass(frozen=True)
class Reached:
    """How far the candidates are from one target.

    Attributes:
        target: the target.
        at: strains that it was read at, or none of a single number [1].
        values: what the candidates have there, (design, strain), or (design, 1) of a number.
        obtained: one number for each: the value, or the mean over the window.
        off_by: distance from what is wanted, in the variable's unit: of a curve the root mean
            square over the window.
        covered: whether the spread over a design's siblings overlaps what is wanted at every
            strain; ``None`` where the spread is not known.
    """

    target: Target
    at: np.ndarray
    values: Float[np.ndarray, "design strain"]
    obtained: Numbers
    off_by: Numbers
    covered: tuple[bool | None, ...]

    @property
    def scale(self) -> float:
        """Distance that counts as one: the tolerance, or the scatter among the candidates."""
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
            the value or the mean over its window, ``off_by_1``, how far that is off in the
            variable's unit, and ``in_spread_1``, whether the spread covers the target; likewise
            for the others. Then the values that were required.
        reached: how far from each target they are, in the order of the table.
        passed_over: designs that were not considered, by reason.
    """

    table: pd.DataFrame
    reached: tuple[Reached, ...]
    passed_over: dict[str, int]


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
        targets: what is wanted.
        subject_to: what must be met; designs that do not are left out.
        most: how many designs are kept, all by default.

    Raises:
        BadInput: if there is no target, or one names what the cubes do not have.
    """
    if not targets:
        raise fault("targets", "none is given; say what is wanted")
    candidates = Candidates.of(cubes)
    required = [reach(candidates, target) for target in subject_to]
    allowed = np.ones(len(candidates.table), bool)
    for its in required:
        allowed &= its.off_by == 0
    reached = [reach(candidates, target) for target in targets]
    parts = np.stack([its.off_by / its.scale for its in reached])
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
    ordered = tuple(_in_order(its, order) for its in reached)
    for number, its in enumerate(ordered, start=1):
        table[f"value_{number}"] = its.obtained
        table[f"off_by_{number}"] = its.off_by
        table[f"in_spread_{number}"] = [COVERED[covers] for covers in its.covered]
    for its in required:
        table[its.target.label] = its.obtained[order]
    return Found(table, ordered, {reason: count for reason, count in passed_over.items() if count})


def reach(candidates: Candidates, target: Target) -> Reached:
    """How far candidates are from a target.

    Raises:
        BadInput: if the target names what the cubes do not have, or needs a window of strain.
    """
    source = f"target {target.text}"
    if not candidates.lies_along_strain(target.name, source):
        if target.window is not None or target.reduction is not None:
            raise fault(source, f"{target.name} is one number of a design; leave out the window")
        values = candidates.numbers(target.name)
        covered = _covered(target, [], len(values))
        return Reached(target, np.zeros(0), values[:, None], values, target.excess(values), covered)
    if target.window is None:
        raise fault(source, f"{target.name} lies along applied_strain; add @ STRAIN or @ FROM:TO")
    at, curves = candidates.curves(target.name, target.window)
    band = [
        candidates.curves(f"{target.name}_{side}", target.window)[1]
        for side in ("low", "high")
        if any(f"{target.name}_{side}" in cube.dims for cube in candidates.cubes)
    ]
    if target.reduction is None:
        obtained = REDUCTIONS["mean"](at, curves)
        off_by = root_mean_square(at, target.excess(curves))
    else:
        reduce = REDUCTIONS[target.reduction]
        obtained = reduce(at, curves)
        off_by = target.excess(obtained)
        band = [reduce(at, side)[:, None] for side in band]
    return Reached(target, at, curves, obtained, off_by, _covered(target, band, len(curves)))


def _covered(target: Target, band: Sequence[np.ndarray], designs: int) -> tuple[bool | None, ...]:
    """Whether the bands of designs overlap what is wanted, at every strain."""
    if not band:
        return (None,) * designs
    lowest, highest = np.minimum(*band), np.maximum(*band)
    known = np.isfinite(lowest).all(axis=1)
    overlaps = ((lowest <= target.high) & (highest >= target.low)).all(axis=1)
    return tuple(bool(its) if there else None for its, there in zip(overlaps, known, strict=True))


def _in_order(reached: Reached, order: np.ndarray) -> Reached:
    return Reached(
        reached.target,
        reached.at,
        reached.values[order],
        reached.obtained[order],
        reached.off_by[order],
        tuple(reached.covered[place] for place in order),
    )
