"""Finding the designs of cubes that come closest to targets, without simulation."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
import xarray as xr
from jaxtyping import Float
from pandas.api.types import is_numeric_dtype

from knitlab.cubes.condition import computed
from knitlab.cubes.cube_file import design_dims
from knitlab.cubes.model_line import model_lines
from knitlab.cubes.probability import (
    DEVIATES,
    check_tolerance,
    column,
    freedoms_of,
    is_met,
    numbers_of,
    with_deviations,
)
from knitlab.cubes.query import designs_of_all, marks_of_all, with_marks
from knitlab.cubes.strain_window import REDUCTIONS, StrainWindow, root_mean_square, with_columns
from knitlab.cubes.target import MAX_TARGETS, Target, check_window
from knitlab.cubes.uncertainty import Stripes
from knitlab.io.errors import invalid, unknown
from knitlab.observables.schema import STRAIN
from knitlab.observables.status import Status

Numbers = Float[np.ndarray, " design"]

CROSSINGS = "intersections_at_min"


@dataclass(frozen=True)
class Reached:
    """Distances of the candidates from one target."""

    target: Target
    at: np.ndarray  # strains of the values; empty for a variable that is one number
    values: Float[np.ndarray, "design strain"]  # (design, 1) if it is one number
    obtained: Numbers  # the value, or the mean over the window
    off_by: Numbers  # distance in the unit of the variable; of a curve the root mean square
    worst: Numbers  # the same of the worst of a design's perturbed copies, if these are known
    in_spread: np.ndarray  # whether these overlap the target at every strain: yes, no, or unknown
    band: tuple[np.ndarray, ...] = ()  # their lowest and highest values; empty for one number
    met: Float[np.ndarray, "design sample"] | None = None  # whether samples of stripes meet it

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

    def in_order(self, order: np.ndarray) -> "Reached":
        """The candidates in another order, or a subset of them."""
        names = ["values", "obtained", "off_by", "worst", "in_spread"]
        names += [] if self.met is None else ["met"]
        ordered = {name: getattr(self, name)[order] for name in names}
        return replace(self, **ordered, band=tuple(edge[order] for edge in self.band))


@dataclass(frozen=True)
class Found:
    """Designs by their distance from the targets, the nearest first.

    ``table`` has one row for each design: labels, distance, for each target its ``value_1``,
    ``off_by_1`` (the distance) and ``in_spread_1`` (whether the spread covers the target), and the
    values of the constraints.
    """

    table: pd.DataFrame
    reached: tuple[Reached, ...]  # for each target, in the order of the table
    excluded: dict[str, int]  # designs that were not considered, by reason
    marks: tuple[str, ...] = ()  # of the rows of the table: the signs of what not to rely on
    uncertainty: str = ""  # what probabilities are of, in a sentence

    def __repr__(self) -> str:
        return f"<Found: {len(self.table)} designs, {len(self.reached)} targets>"

    @property
    def passed_over(self) -> dict[str, int]:
        """Deprecated: :attr:`excluded`."""
        return self.excluded

    @property
    def marked_table(self) -> pd.DataFrame:
        """The table with its marks as the last column, if there are any."""
        return with_marks(self.table, self.marks)


def find_designs(
    cubes: Sequence[xr.Dataset],
    targets: Sequence[Target],
    subject_to: Sequence[Target] = (),
    most: int | None = None,
    stripes: Stripes | None = None,
) -> Found:
    """Rank the designs of cubes along the same dimensions by their distance from targets.

    The distance is the root mean square of the distances from each target, each over its
    tolerance or else the scatter of that variable among the designs. With uncertain ``stripes``
    they are ranked by the probability that they meet all targets and ``subject_to``.
    """
    if not targets:
        raise invalid("targets", "none is given; give a target")
    if (number := len(targets) + len(subject_to)) > MAX_TARGETS:
        raise invalid("targets", f"are {number:,} with subject_to; give at most {MAX_TARGETS}")
    if not cubes:
        raise invalid("cubes", "none is given; name a cube or its results folder")
    if stripes is not None:
        for target in (*targets, *subject_to):
            check_tolerance(target)
        cubes = with_deviations(cubes, stripes)
    expressions = [target for target in (*targets, *subject_to) if not target.name.isidentifier()]
    known = with_columns(cubes, [target.name for target in expressions])
    designs = designs_of_all(known)
    windows = [(each.name, each.window) for each in (*targets, *subject_to)]
    columns = [f"mean({name}, {at.start}:{at.stop})" if at else name for name, at in windows]
    marks = marks_of_all(cubes, {}, columns)
    ok = (designs["status"] == Status.ok.name).to_numpy()
    if not ok.any():
        raise invalid("cubes", "hold no design that is ok; run a workflow first")
    designs = designs[ok].reset_index(drop=True)
    for target in expressions:
        designs[target.name] = computed(target.name, designs, f"target {target.text}")
    sampled = stripes is not None
    required = [_reached(cubes, designs, target, sampled) for target in subject_to]
    reached = [_reached(cubes, designs, target, sampled) for target in targets]
    allowed = np.all([constraint.off_by == 0 for constraint in required], axis=0)
    distances = np.stack([each.off_by / each.scale for each in reached])
    distance = np.sqrt(np.mean(distances**2, axis=0))
    known = np.isfinite(distance)
    probability = np.zeros(len(designs))
    if stripes is not None:
        met = [each.met for each in (*reached, *required) if each.met is not None]
        probability = np.prod(met, axis=0).mean(axis=1)
        allowed = np.full(len(designs), True)
    ranked = np.lexsort((np.where(allowed & known, distance, np.inf), -probability))
    order = ranked[(allowed & known)[ranked]][:most]
    excluded = {
        "not ok": int((~ok).sum()),
        "do not meet a constraint": int((~allowed).sum()),
        "have no value at the strains of a target": int((allowed & ~known).sum()),
    }
    labels = [*design_dims(cubes[0]), *(name for name in ("cube", "boundary") if name in designs)]
    nearest = designs.iloc[order].reset_index(drop=True)
    ranked_by = {} if stripes is None else {"probability": probability[order]}
    table = nearest[labels].assign(**ranked_by, distance=distance[order])
    if CROSSINGS in nearest and nearest[CROSSINGS].fillna(0).any():
        table[CROSSINGS] = nearest[CROSSINGS]  # no real fabric passes through itself
    ordered = tuple(each.in_order(order) for each in reached)
    for number, each in enumerate(ordered, start=1):
        table[f"value_{number}"] = each.obtained
        table[f"off_by_{number}"] = each.off_by
        table[f"in_spread_{number}"] = each.in_spread
    for constraint in required:
        table[constraint.target.label] = constraint.obtained[order]
    table.attrs["units"] = _units(designs.attrs["units"], targets, subject_to)
    table.attrs["models"] = model_lines(cubes)
    counted = {reason: count for reason, count in excluded.items() if count}
    note = "" if stripes is None else stripes.note
    return Found(table, ordered, counted, tuple(marks[ok].iloc[order]), note)


def _units(
    known: dict[str, str], targets: Sequence[Target], subject_to: Sequence[Target]
) -> dict[str, str]:
    """Units of the columns of a ranking, by those of the variables."""
    units = dict(known)
    columns = [[f"value_{number}", f"off_by_{number}"] for number in range(1, len(targets) + 1)]
    columns += [[target.label] for target in subject_to]
    for target, names in zip([*targets, *subject_to], columns, strict=True):
        if target.name in known and target.reduction != "linearity":
            units |= dict.fromkeys(names, known[target.name])
    return units


def _reached(
    cubes: Sequence[xr.Dataset], designs: pd.DataFrame, target: Target, sampled: bool
) -> Reached:
    source = f"target {target.text}"
    check_window(target, _lies_along_strain(cubes, designs, target.name, source), source)
    if target.window is None:
        if not is_numeric_dtype(designs[target.name]):
            raise invalid(source, f"{target.name} is not a number; give a variable that is one")
        # NaN where a cube does not have it.
        values = designs[target.name].to_numpy(float, na_value=np.nan)
        none = np.zeros(0)
        off_by = abs(target.departure(values, none))
        in_spread = np.full(len(values), "unknown")
        met = None
        if sampled:
            changes = numbers_of(designs, target.name)
            met = is_met(target, none, values[:, None], changes, freedoms_of(designs))
        return Reached(target, none, values[:, None], values, off_by, off_by, in_spread, (), met)
    target.window.check_within(cubes, target.name, source)
    at, curves = _curves(cubes, target.name, target.window)
    band = [
        _curves(cubes, name, target.window)[1]
        for name in (f"{target.name}_low", f"{target.name}_high")
        if any(name in cube for cube in cubes)
    ]
    read = [curves, *band]
    obtained = REDUCTIONS[target.reduction or "mean"](at, curves)
    if target.reduction is not None:
        read = [REDUCTIONS[target.reduction](at, item)[:, None] for item in read]
    distances = [abs(target.departure(item, at)) for item in read]
    off_by, worst = (
        root_mean_square(at, item) if target.reduction is None else item[:, 0]
        for item in (distances[0], np.fmax.reduce(distances))
    )
    in_spread = np.full(len(curves), "unknown")
    if band:
        lowest, highest = np.minimum(*read[1:]), np.maximum(*read[1:])
        low, high = target.bounds(at)
        overlaps = ((lowest <= high) & (highest >= low)).all(axis=1)
        known = np.isfinite(lowest).all(axis=1)
        in_spread = np.select([~known, overlaps], ["unknown", "yes"], "no")
    met = None
    if sampled:
        names = [column(target.name, number) for number in range(DEVIATES)]
        changes = np.zeros((DEVIATES, *curves.shape))
        if any(names[0] in cube for cube in cubes):
            changes = np.array([_curves(cubes, name, target.window)[1] for name in names])
        met = is_met(target, at, curves, changes, freedoms_of(designs))
    return Reached(target, at, curves, obtained, off_by, worst, in_spread, tuple(band), met)


def _lies_along_strain(
    cubes: Sequence[xr.Dataset], designs: pd.DataFrame, name: str, source: str
) -> bool:
    dims = [set(cube[name].dims) - set(design_dims(cube)) for cube in cubes if name in cube]
    if not dims and name not in designs:
        known = {str(variable) for cube in cubes for variable in cube.data_vars}
        raise invalid(source, unknown(name, sorted(known), "variable"))
    if further := set().union(*dims) - {STRAIN}:
        along = ", ".join(sorted(map(str, further)))
        raise invalid(source, f"{name} has the dimension {along}; give a variable of whole designs")
    return any(STRAIN in along for along in dims)


def _curves(
    cubes: Sequence[xr.Dataset], name: str, window: StrainWindow
) -> tuple[np.ndarray, np.ndarray]:
    """Strains of a window, and the curves of all designs that are ok (design, strain) at these."""
    read = []
    for cube in cubes:
        ok = cube["status"].values == Status.ok
        strains = cube[STRAIN].values
        values = np.full((int(ok.sum()), len(strains)), np.nan)
        if name in cube:
            values = cube[name].values[ok]
        read.append(window.read(strains, values))
    at = np.unique(np.concatenate([strains for strains, _ in read]))
    # Curves are linear between the strains at which they were read, so interpolation is exact.
    curves = [np.interp(at, strains, row) for strains, rows in read for row in rows]
    return at, np.array(curves)
