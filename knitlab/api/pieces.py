"""Shaped pieces: from a wanted outline to a chart that relaxes to it."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from tqdm import tqdm

from knitlab.api.knitting import KnitSample, knit_sample
from knitlab.api.single_design import single_design
from knitlab.api.sweeps import RESULTS, one_of
from knitlab.export.knitting.stitch_chart import stitch_chart
from knitlab.export.pieces.fitting import Fit, fit
from knitlab.export.pieces.outline import Outline, read_outline
from knitlab.export.pieces.piece import Border, Fabric
from knitlab.figures.figure_files import draw_into
from knitlab.io.errors import invalid
from knitlab.io.names import named_folder
from knitlab.model.computing import computing
from knitlab.runs.figure_names import check_figure_suffix
from knitlab.runs.workflow_file import Overrides

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MAX_STRETCH = 1.0
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
            yield f"round {number}", f"{width:.4g} × {length:.4g} mm, {distance}"
        yield "ended", self.fit.ended
        width, length = best.cell
        reached = "below" if self.fit.met else "not below"
        cell = f"{reached} a unit cell ({width:.3g} × {length:.3g} mm)"
        yield "distance", f"{best.distance:.3g} mm, {cell}"
        yield "piece", chart.size
        wales = np.diff(chart.edges, axis=1)
        yield "wales", f"{wales.min()} to {wales.max()}"

    def figure(self) -> "Figure":
        """The wanted outline, and those of all rounds."""
        from knitlab.figures.piece import piece_figure

        return piece_figure(self.fit)

    def save_figure(self, path: str | Path) -> Path:
        """Write the figure; InputError if the suffix is not ``.pdf``, ``.svg`` or ``.png``."""
        path = Path(path)
        check_figure_suffix(path)
        draw_into(self.figure, path)
        return path


@computing()
def shape(
    target: str | Path | Outline,
    workflow: str | Path = "periodic",
    overrides: Sequence[str] = (),
    selections: Mapping[str, Any] = {},
    *,
    border: Border = "whole",
    stretch: float = 0.0,
    rounds: int = 4,
    machine: Overrides | None = None,
    results: str | Path = RESULTS,
    progress: bool = False,
    **settings: Any,
) -> ShapedPiece:
    """Find the chart of a piece that relaxes to a wanted outline, by simulation of the piece.

    The piece is laid out by the size of the unit cell in endless fabric. The whole piece is
    simulated from the flat sheet to equilibrium, with free edges, and laid out again by the sizes
    that its cells had, until its outline is nearer than a unit cell or does not come nearer.
    Finished simulations are kept, so that an interrupted search goes on when it is repeated.

    Args:
        target: a drawing (SVG, its size in mm) of one closed line; a table of ``length [mm]`` and
            ``width [mm]``; or an :class:`Outline`. The wales run along its length, y.
        workflow: the workflow with the model and the design; its tests are not run.
        overrides: settings of it as text: ``["n_stripe=4", "n_subunit=16"]``.
        selections: a value for each coordinate of the workflow, until one design is left.
        border: how patches end at the outline: ``"whole"``, none is cut; ``"cut"``, along the
            grid; ``"plain"``, those that it cuts are plain knit.
        stretch: applied strain at which the piece is to have the outline; 0 for the relaxed piece.
        rounds: largest number of pieces that are simulated.
        machine: as for :func:`knitlab.knit`.
        results: folder that holds the simulated pieces, in ``shape/``.
        progress: whether to draw a progress bar.
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
        (128, 1)
    """
    if not 0 <= stretch <= MAX_STRETCH:
        raise invalid("stretch", f"is {stretch:g}; give a strain from 0 to {MAX_STRETCH:g}")
    wanted = target if isinstance(target, Outline) else read_outline(Path(target))
    single = single_design(workflow, one_of(overrides, settings), selections)
    if border == "plain" and single.plain is None:
        message = f"takes plain knit, which the material {single.material!r} does not have"
        raise invalid("border plain", f"{message}; take whole or cut, or add it to the material")
    fabric = Fabric(single.case, single.gauge, single.plain, border)
    folder = named_folder(Path(results), FOLDER)
    with tqdm(total=rounds, unit="piece", disable=not progress) as bar:

        def report(number: int, states: float) -> None:
            bar.set_description("endless fabric" if number == 0 else f"piece {number}")
            bar.update(max(number - 1, 0) - bar.n)

        found = fit(fabric, wanted, folder, stretch, rounds, report)
    best = single._replace(case=found.best.case)
    return ShapedPiece(found, knit_sample(best, stitch_chart(best.case), machine))
