"""A piece is corrected, round by round, until it relaxes to its outline.

Each round simulates the whole piece. The sizes of its grid cells at every height, which edges and
neighbours change, are those by which the next piece is laid out.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from knitlab.design.trial import run_trial
from knitlab.export.pieces.outline import Outline
from knitlab.export.pieces.piece import Fabric, Scale, finished
from knitlab.solvers.case import Case

GAIN = 0.95  # of the distance, above which a further round is not worth its time

Report = Callable[[int, float], None]
"""Called with the number of a round, from 0 for endless fabric, and the part that is done."""


@dataclass(frozen=True, eq=False)
class Round:
    """A piece that was simulated.

    Attributes:
        case: the piece.
        outline: what it relaxes to, or is pulled to, on the wanted outline; None if it did not
            converge [mm].
        distance: Hausdorff distance of the outline from the wanted one [mm].
        cell: mean width and length of its unit cells [mm].
    """

    case: Case
    outline: Outline | None
    distance: float
    cell: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Fit:
    """The rounds, and why there is no further one.

    Attributes:
        wanted: the wanted outline [mm].
        rounds: the pieces, in order.
        ended: why the last round was the last.
    """

    wanted: Outline
    rounds: tuple[Round, ...]
    ended: str

    @property
    def best(self) -> Round:
        """The round whose outline is nearest; the last if none converged."""
        known = [each for each in self.rounds if each.outline is not None]
        return min(known, key=lambda each: each.distance) if known else self.rounds[-1]

    @property
    def met(self) -> bool:
        """Whether the outline is nearer than a unit cell is long and wide."""
        best = self.best
        return best.outline is not None and best.distance < min(best.cell)

    @property
    def table(self) -> pd.DataFrame:
        """A row for every round: size of the grid and of the piece, and the distance [mm]."""
        return pd.DataFrame(
            {
                "round": number,
                "rows": each.case.mesh_shape.cells_y,
                "columns": each.case.mesh_shape.cells_x,
                "width": each.outline.size[0] if each.outline else np.nan,
                "length": each.outline.size[1] if each.outline else np.nan,
                "distance": each.distance,
                "case_id": each.case.case_id,
            }
            for number, each in enumerate(self.rounds, start=1)
        )


def fit(
    fabric: Fabric, wanted: Outline, folder: Path, strain: float, rounds: int, report: Report
) -> Fit:
    """Pieces of a fabric, until one has the outline; their case files are kept in a folder."""
    done: list[Round] = []
    ended = f"the limit of {rounds} rounds was reached"
    scale = _endless(fabric, folder, strain, partial(report, 0))
    while len(done) < rounds:
        case = fabric.piece(wanted, scale, strain)
        if case.case_id in [each.case.case_id for each in done]:
            ended = "its rows and columns no longer change"
            break
        trial = run_trial(folder, case, fabric.gauge, progress=partial(report, len(done) + 1))
        if not trial.converged:
            done.append(Round(case, None, np.nan, (np.nan, np.nan)))
            ended = f"a piece did not come to rest: {trial.results.attrs['reason']}"
            break
        positions = trial.results["position"].values[-1]
        outline, scale = finished(case, positions, fabric.mm_of_cloth)
        outline = outline.centred_on(wanted)
        cells = 2 * fabric.patch
        cell = cells * float(scale.width.mean()), cells * float(scale.height.mean())
        done.append(Round(case, outline, outline.distance(wanted), cell))
        if len(done) > 1 and done[-1].distance > GAIN * done[-2].distance:
            ended = "a further round gained less than 5 %"
            if min(each.distance for each in done) < min(cell):
                break
    return Fit(wanted, tuple(done), ended)


def _endless(fabric: Fabric, folder: Path, strain: float, report: Callable[[float], None]) -> Scale:
    """The sizes of grid cells in endless fabric."""
    case = replace(
        fabric.case,
        unit_cells=(1, 1),
        options=replace(fabric.case.options, boundary="periodic"),
        applied_strain=(0.0, strain) if strain else (0.0,),
        sensitivities=False,
        robustness=0,
        capacitor=None,
    ).without_unused()
    results = run_trial(folder, case, fabric.gauge, progress=report).results
    relaxed = np.array([float(results[f"relaxed_cell_{axis}"]) for axis in "xy"])
    strains = [float(results[f"mean_strain_{part}"][-1]) for part in ("xx", "yy")]
    cells = np.array([2 * fabric.patch, 2 * fabric.patch])
    width, height = relaxed * (1 + np.array(strains)) * fabric.mm_of_cloth / cells
    return Scale.even(float(width), float(height))
