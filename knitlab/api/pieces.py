"""Shaped pieces: from a wanted outline to a chart that relaxes to it."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import xarray as xr

from knitlab.api.knitting import KnitSample, knit_sample, machine_of
from knitlab.api.single_design import SingleDesign, single_design
from knitlab.api.sweeps import RESULTS, one_of
from knitlab.export.knitting.stitch_chart import stitch_chart
from knitlab.export.pieces.fitting import WIDENING_TOLERANCE, Fit, Fitting, kind_of_row
from knitlab.export.pieces.outline import Outline, read_outline
from knitlab.export.pieces.piece import Border, Fabric
from knitlab.export.pieces.rows import Row, WantedWidening
from knitlab.figures.figure_files import save_figure
from knitlab.io.errors import invalid, shown
from knitlab.io.names import named_folder
from knitlab.io.progress import Progress
from knitlab.model.computing import computing
from knitlab.runs.workflow_file import Overrides
from knitlab.solvers.case import Case

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MAX_STRETCH = 1.0
STRAINS = 9  # of tests of endless fabric
FARTHEST = 3.0  # largest strain of these, over that of the piece: soft rows stretch more
CHECKERBOARDS = (("GR", "RG"), ("RG", "GR"))
FOLDER = "shape"  # of case files, in the folder of results


@dataclass(frozen=True, eq=False)
class ShapedPiece:
    """A piece that is knitted to shape.

    Attributes:
        fit: the pieces that were simulated, and why there is no further one.
        sample: the nearest of them as it is knitted.
    """

    fit: Fit
    sample: KnitSample

    def __repr__(self) -> str:
        best = self.fit.best
        return f"<ShapedPiece {self.sample.chart.size}, {best.distance:.3g} mm from its outline>"

    @property
    def test(self) -> xr.Dataset:
        """Results and shape of the nearest piece, for :func:`knitlab.export` and own measures."""
        return self.fit.best.test

    def rows(self) -> Iterator[tuple[str, str]]:
        """Names and values of its lines."""
        best, chart = self.fit.best, self.sample.chart
        width, length = self.fit.wanted.size
        yield "target", f"{width:.4g} × {length:.4g} mm"
        for number, each in enumerate(self.fit.rounds, start=1):
            if each.outline is None:
                yield f"round {number}", "did not come to rest"
                continue
            width, length = each.outline.size
            distance = f"{each.distance:.3g} mm from the outline"
            if self.fit.widening is not None:
                distance += f", widening within {each.widening_error:.2g}"
            yield f"round {number}", f"{width:.4g} × {length:.4g} mm, {distance}"
        yield "ended", self.fit.ended
        width, length = best.cell
        reached = "below" if best.distance < min(best.cell) else "not below"
        cell = f"{reached} a unit cell ({width:.3g} × {length:.3g} mm)"
        yield "distance", f"{best.distance:.3g} mm, {cell}"
        if self.fit.widening is not None:
            tolerance = f"tolerance {WIDENING_TOLERANCE:g}"
            yield "widening", f"within {best.widening_error:.2g} of the wanted strain, {tolerance}"
            for row, group in groupby(best.rows[::-1], key=lambda row: row.label):
                yield "rows", f"{len(list(group))} × {row}"
        wales = np.diff(chart.edges, axis=1)
        of_course = f"{wales.min()} to {wales.max()}" if wales.min() < wales.max() else wales.max()
        yield "piece", f"{chart.title}: {chart.courses} courses, {of_course} wales"

    def figure(self) -> "Figure":
        """The wanted outline, and those of all rounds."""
        from knitlab.figures.piece import piece_figure

        return piece_figure(self.fit)

    def save_figure(self, path: str | Path) -> Path:
        """Write the figure; InputError if the suffix is not ``.pdf``, ``.svg`` or ``.png``."""
        return save_figure(self.figure, path)


@computing()
def shape(
    target: str | Path | Outline,
    workflow: str | Path = "periodic",
    overrides: Sequence[str] = (),
    selections: Mapping[str, Any] = {},
    *,
    border: Border = "cut",
    stretch: float = 0.0,
    rows: Sequence[tuple[int, int] | Literal["plain"]] = (),
    rounds: int = 4,
    machine: Overrides | None = None,
    results: str | Path = RESULTS,
    progress: bool = True,
    **settings: Any,
) -> ShapedPiece:
    """Find the chart of a piece that relaxes to a wanted outline, by simulation of the piece.

    The piece is laid out by the size of the unit cell in endless fabric. The whole piece is
    simulated from the flat sheet to equilibrium, with free edges, and laid out again by the sizes
    that its cells had, until its outline is nearer than a unit cell or does not come nearer.
    Finished simulations are kept, so that an interrupted search goes on when it is repeated.

    If the target has a ``widening``, the piece is to have the outline when it is relaxed, and to
    widen so when it is stretched: within 0.05, farther than a unit cell from its clamped ends. Each
    of its rows of patches is then of the kind that widens nearest to what is wanted there, under
    the force that all rows bear, corrected in every round by what the last piece lacked.

    Args:
        target: a drawing (SVG, its size in mm) of one closed line; a table of ``length [mm]`` and
            ``width [mm]``, and optionally ``widening [1]``, the wanted strain along the courses; or
            an :class:`Outline`. The wales run along its length, y.
        workflow: the workflow or the cube with the model and the design; tests are not run.
        overrides: settings of it as text: ``["n_stripe=4", "n_subunit=16"]``.
        selections: a value for each coordinate of the workflow, until one design is left.
        border: how patches end at the outline: ``"cut"``, along the grid, ``"whole"``, none
            is cut, or ``"plain"``, those that it cuts are plain knit.
        stretch: applied strain at which the piece is to have the outline, 0 for the relaxed piece,
            or the widening.
        rows: with a widening, the further kinds of rows that the piece may have, beside its own:
            designs (n_stripe, n_subunit) whose garter stripe and height they have, or ``"plain"``.
        rounds: largest number of pieces that are simulated.
        machine: as for :func:`knitlab.knit`.
        results: folder that holds the simulated pieces, in ``shape/``.
        progress: whether to show progress, after two seconds.
        settings: settings of the workflow as keywords: ``n_stripe=4``.

    Returns:
        The ``fit`` with its rounds, and the nearest piece as a ``sample`` that can be saved.

    Raises:
        InputError: if the target cannot be read or is no outline, if not one design is left, if
            the piece is too large, or if a machine cannot knit it.

    Example:
        >>> square = kl.Outline.of_widths([0, 40], [40, 40])
        >>> piece = kl.shape(square, n_stripe=2, n_subunit=8, rounds=1, results=folder)
        >>> piece.sample.chart.courses, len(piece.fit.rounds)
        (64, 1)
    """
    if not 0 <= stretch <= MAX_STRETCH:
        raise invalid("stretch", f"is {stretch:g}; give a strain from 0 to {MAX_STRETCH:g}")
    wanted = target if isinstance(target, Outline) else read_outline(Path(target))
    given = one_of(overrides, settings)
    single = single_design(workflow, given, selections)
    if border == "plain" and single.plain is None:
        message = f"takes plain knit, which the material {single.material!r} does not have"
        raise invalid("border plain", f"{message}; take whole or cut, or add it to the material")
    if single.case.pattern not in CHECKERBOARDS or single.case.grading is not None:
        message = f"is {shown([*single.case.pattern])}; a piece is cut from the plain checkerboard"
        raise invalid("pattern", f"{message} of rib and garter: leave it out")
    widening = None
    if wanted.widening is not None:
        if not (stretch and rows):
            message = "is wanted of the stretched piece, by rows of several kinds; give stretch and"
            raise invalid("widening", f"{message} rows")
        widening = WantedWidening(stretch, *wanted.widening)
    elif rows:
        raise invalid("rows", "are for a target with a widening; leave them out, or add it")
    if single.case.capacitor is not None:
        message = "has electrodes, which a piece cannot have yet; take a workflow without them"
        raise invalid(f"workflow {workflow}", message)
    if single.case.method != "equilibrium":
        message = f"is {single.case.method}, and a piece is simulated in equilibrium; set method ="
        raise invalid("method", f"{message} equilibrium, or take a cube of equilibria")
    # A machine that is not known is refused before minutes of simulation.
    needles = machine_of(single, machine).needles
    fabric = Fabric(single.case, single.gauge, single.plain, border)
    folder = named_folder(Path(results), FOLDER)
    strains = [0.0]
    if stretch:
        most = stretch if widening is None else FARTHEST * stretch
        strains = np.linspace(0, most, STRAINS).tolist()
    with Progress("endless fabric", progress):
        kinds = [
            kind_of_row(fabric, label, design, strains, folder)
            for label, design in _kinds(single, rows, workflow, given, selections)
        ]
        _check_size(wanted, fabric, kinds[0], needles)
        fitting = Fitting(fabric, kinds, wanted, widening, stretch, folder)
        found = fitting.run(rounds)
    best = single._replace(case=found.best.case)
    return ShapedPiece(found, knit_sample(best, stitch_chart(best.case), machine))


def _check_size(wanted: Outline, fabric: Fabric, kind: Row, needles: int) -> None:
    width, length = wanted.size
    cell_x, cell_y = (2 * fabric.patch * side for side in kind.cell)
    wales = width / cell_x * fabric.case.stitches.wales_in_cell
    if wales > needles:
        message = f"is {width:.3g} mm wide, for which some {wales:.0f} needles are needed, and the"
        hint = f"machine has {needles}; give a narrower one, or knit it in parts"
        raise invalid("target", f"{message} {hint}")
    if width < cell_x or length < cell_y:
        message = f"is {width:.3g} × {length:.3g} mm, less than a unit cell"
        hint = f"({cell_x:.3g} × {cell_y:.3g} mm); give a larger one, or a smaller n_subunit"
        raise invalid("target", f"{message} {hint}")


def _kinds(
    single: SingleDesign,
    rows: Sequence[tuple[int, int] | Literal["plain"]],
    workflow: str | Path,
    given: Overrides,
    selections: Mapping[str, Any],
) -> Iterator[tuple[str, Case | None]]:
    """The designs of the kinds of rows by their labels, the piece's own first; None is plain."""
    yield single.case.label, single.case
    of_design = ("n_stripe", "n_subunit")
    for row in rows:
        if row == "plain":
            if single.plain is None:
                message = f"is not known of the material {single.material!r}"
                raise invalid("rows plain", f"{message}; add it to its file, or leave them out")
            yield "plain", None
            continue
        own: Overrides
        if isinstance(given, Mapping):
            own = {**given, **dict(zip(of_design, row, strict=True))}
        else:
            others = [text for text in given if text.partition("=")[0].strip() not in of_design]
            own = [*others, *(f"{n}={value}" for n, value in zip(of_design, row, strict=True))]
        others_chosen = {name: value for name, value in selections.items() if name not in of_design}
        case = single_design(workflow, own, others_chosen).case
        yield case.label, case
