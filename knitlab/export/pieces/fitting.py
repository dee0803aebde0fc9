"""A piece is corrected, round by round, until it relaxes to its outline.

Each round simulates the whole piece. The sizes of its grid cells at every height, which edges and
neighbours change, are those by which the next piece is laid out.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from knitlab.design.trial import run_trial
from knitlab.export.pieces.outline import Outline
from knitlab.export.pieces.piece import (
    UNCHANGED,
    Along,
    Fabric,
    Scale,
    mean_of_rows,
    mm_of_cloth,
)
from knitlab.export.pieces.rows import Row, WantedWidening, chosen_rows
from knitlab.io.progress import report
from knitlab.model.pattern import Grading
from knitlab.solvers.case import Case

GAIN = 0.95  # of the error, above which a further round is not worth its time
WIDENING_TOLERANCE = 0.05  # of the strain along the courses


@dataclass(frozen=True, eq=False)
class Round:
    """A piece that was simulated.

    Attributes:
        case: the piece.
        test: its results, with the shape in mm of network; as of :func:`knitlab.simulate`.
        outline: what it relaxes to, or is pulled to, on the wanted outline; None if it did not
            converge [mm].
        scale: sizes of its grid cells in every row [mm].
        distance: Hausdorff distance of the outline from the wanted one [mm].
        cell: mean width and length of its unit cells [mm].
        rows: its rows of patches, from below.
        place: places along the relaxed piece, from 0 to 1.
        widening: strain along the courses at these, when it is stretched [1].
        widening_error: largest difference from the wanted one, but near the ends; 0 if none is
            wanted [1].
    """

    case: Case
    rows: Sequence[Row]
    test: xr.Dataset
    outline: Outline | None = None
    scale: Scale = UNCHANGED
    distance: float = np.nan
    cell: tuple[float, float] = (np.nan, np.nan)
    place: Along = field(default_factory=lambda: np.zeros(0))
    widening: Along = field(default_factory=lambda: np.zeros(0))
    widening_error: float = 0.0

    @property
    def error(self) -> float:
        """Distance and error of widening, the larger, in tolerances; infinite if none is known."""
        if self.outline is None:
            return np.inf
        return max(self.distance / min(self.cell), self.widening_error / WIDENING_TOLERANCE)


@dataclass(frozen=True, eq=False)
class Fit:
    """The rounds, and why there is no further one.

    Attributes:
        wanted: the wanted outline [mm].
        widening: the wanted widening, if any.
        rounds: the pieces, in order.
        ended: why the last round was the last.
    """

    wanted: Outline
    widening: WantedWidening | None
    rounds: tuple[Round, ...]
    ended: str

    @property
    def best(self) -> Round:
        """The round with the least error."""
        return min(self.rounds, key=lambda each: each.error)

    @property
    def met(self) -> bool:
        """Whether its outline is nearer than a unit cell, and its widening within the tolerance."""
        return self.best.error < 1

    @property
    def table(self) -> pd.DataFrame:
        """A row for every round: size of the grid and of the piece, and how far it is off."""
        return pd.DataFrame(
            {
                "round": number,
                "rows": each.case.mesh_shape.cells_y,
                "columns": each.case.mesh_shape.cells_x,
                "width": each.outline.size[0] if each.outline else np.nan,
                "length": each.outline.size[1] if each.outline else np.nan,
                "distance": each.distance,
                "widening_error": each.widening_error,
                "case_id": each.case.case_id,
            }
            for number, each in enumerate(self.rounds, start=1)
        )


@dataclass(eq=False)
class Fitting:
    """What all rounds share.

    Attributes:
        fabric: what the pieces are cut from.
        kinds: the kinds of rows that a piece may have; without a wanted widening the first alone.
        wanted: the wanted outline [mm].
        widening: the wanted widening of the relaxed piece, if any.
        strain: applied strain at which the piece is to have the outline, without a widening.
        folder: where case files are kept.
    """

    fabric: Fabric
    kinds: Sequence[Row]
    wanted: Outline
    widening: WantedWidening | None
    strain: float
    folder: Path

    def run(self, rounds: int) -> Fit:
        """Pieces until one is near enough, or does not come nearer."""
        done: list[Round] = []
        ended = f"the limit of rounds, {rounds}, was reached"
        factor, aim = UNCHANGED, self.widening
        # Without a widening the piece has the outline when it is stretched.
        strain = self.strain if aim is None else aim.stretch
        while len(done) < rounds:
            rows = self._rows(factor, aim)
            endless = self.fabric.endless(rows)
            case = self.fabric.piece(self.wanted, rows, endless.times(factor), strain)
            if case.case_id in [each.case.case_id for each in done]:
                ended = "its rows and columns no longer change"
                break
            report(len(done) / rounds, f"piece {len(done) + 1}")
            trial = run_trial(self.folder, case, self.fabric.gauge)
            if not trial.converged:
                done.append(Round(case, rows, trial.results))
                ended = f"a piece did not come to rest: {trial.results.attrs['reason']}"
                break
            done.append(last := self._round(case, rows, trial.results))
            window = 2 * self.fabric.patch
            factor = last.scale.smooth(window).over(endless.smooth(window))
            if aim is not None and done[-1].widening_error > WIDENING_TOLERANCE:
                aim = self._corrected(aim, done[-1])
            near_enough = min(each.error for each in done) < 1
            if near_enough and len(done) > 1 and done[-1].error > GAIN * done[-2].error:
                ended = "a further round gained less than 5 %"
                break
        return Fit(self.wanted, self.widening, tuple(done), ended)

    def _rows(self, factor: Scale, aim: WantedWidening | None) -> list[Row]:
        _, length = self.wanted.size
        if aim is None:
            return self.fabric.rows_of(self.kinds[0].stretched(self.strain), length, factor)

        def width(height: float) -> float:
            left, right = self.wanted.edges(np.array([height]))
            return float(right[0] - left[0])

        cells = self.fabric.case.options.cells_per_period
        shrinking = float(factor.height.mean())
        return chosen_rows(
            self.kinds, cells, length / shrinking, lambda y: width(y * shrinking), aim
        )

    def _round(self, case: Case, rows: Sequence[Row], test: xr.Dataset) -> Round:
        positions = test["position"].values
        at_rest, stretched = (self.fabric.view(case, positions[state]) for state in (0, -1))
        shaped = stretched if self.widening is None else at_rest
        outline = shaped.outline.centred_on(self.wanted)
        cells = 2 * self.fabric.patch
        scale = shaped.scale
        known = Round(
            case,
            rows,
            test,
            outline,
            scale,
            outline.distance(self.wanted),
            (cells * float(scale.width.mean()), cells * float(scale.height.mean())),
        )
        if self.widening is None:
            return known
        before, after = (mean_of_rows(each.widths, cells) for each in (at_rest, stretched))
        place = at_rest.places
        widening = after / before - 1
        off = np.abs(widening - self.widening.at(place))[self._inside(place, known.cell[1])]
        return replace(known, place=place, widening=widening, widening_error=float(off.max()))

    def _inside(self, place: Along, cell: float) -> np.ndarray:
        """Places farther from the clamped ends than a unit cell, if there are any."""
        _, length = self.wanted.size
        inside = np.minimum(place, 1 - place) * length > cell
        return inside if inside.any() else np.ones(len(place), bool)

    def _corrected(self, aim: WantedWidening, last: Round) -> WantedWidening:
        """What to aim at, so that the next piece has what this one lacks."""
        assert self.widening is not None
        lack = self.widening.at(last.place) - last.widening
        # Clamped ends cannot widen, whatever their rows are.
        lack[~self._inside(last.place, last.cell[1])] = 0.0
        return replace(aim, place=last.place, widening=aim.at(last.place) + lack)


def kind_of_row(
    fabric: Fabric, label: str, design: Case | None, strains: Sequence[float], folder: Path
) -> Row:
    """A kind of row between columns of a fabric, by simulation of endless fabric of it.

    Its garter stripe and height are those of a design, or it is plain knit without one. ``strains``
    ascend from 0.
    """
    own = fabric.case
    row = own if design is None else design
    grading = Grading((row.periods,) * 2, (own.periods,) * 2, (row.warp,) * 2, (own.weft,) * 2)
    case = fabric.in_equilibrium(
        pattern=own.pattern if design else ("PP", "PP"),
        grading=None if row is own and design else grading,
        plain=None if design else fabric.plain,
        unit_cells=(1, 1),
        options=replace(own.options, boundary="periodic"),
        applied_strain=tuple(strains),
    )
    results = run_trial(folder, case, fabric.gauge).results
    relaxed = np.array([float(results[f"relaxed_cell_{axis}"]) for axis in "xy"])
    known = np.flatnonzero(np.isfinite(results["mean_strain_xx"].values))
    across, along = (results[f"mean_strain_{part}"].values[known] for part in ("xx", "yy"))
    width, height = relaxed * [factor.mean() for factor in mm_of_cloth(case, fabric.gauge)]
    cells = np.array([own.periods, row.periods]) * 2 * own.options.cells_per_period
    return Row(
        label=label,
        stripe=row.warp,
        periods=row.periods,
        is_plain=design is None,
        cell=(float(width / cells[0]), float(height / cells[1])),
        strain=along,
        force=results["reaction_force"].values[known] / float(width),
        widening=across,
    )
