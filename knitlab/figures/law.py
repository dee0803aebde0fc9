"""The law of a fabric: its energy over the strains, and the tests that it is fitted to."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from knitlab.export.laws.fitting import predicted
from knitlab.export.laws.strain_tests import A, B, C, ratio_of_pull
from knitlab.figures.style import MARKERS, SEQUENCE_COLOURS, TWO_COLUMNS, shades

if TYPE_CHECKING:
    from knitlab.export.laws.law import Law

POINTS = 161  # along a strain of the map


def law_figure(law: "Law") -> Figure:
    """Energy without shear, and where the tests are; forces and ν of the tests, and of the law."""
    figure = Figure(figsize=(TWO_COLUMNS, 5.8), layout="constrained")
    (over, pulls), (others, ratios) = figure.subplots(2, 2)
    _draw_energy(over, law)
    groups = [[test for test in law.tests if test.is_pull is pull] for pull in (True, False)]
    for axes, tests in zip((pulls, others), groups, strict=True):
        for test, colour, marker in zip(tests, shades(len(tests)), MARKERS * 9, strict=False):
            stretch, force = predicted(law.ridges, test)
            shear = test.prescribed == (C,)
            applied = test.stretch[:, C] if shear else test.stretch[:, B] - 1
            dots = {"marker": marker, "ms": 3.5, "mfc": "none", "ls": "", "color": colour}
            for part in test.prescribed:
                if np.abs(test.force[:, part]).max() > 0:
                    label = test.label if part != A else None
                    line = "--" if part == A else "-"
                    axes.plot(applied, test.force[:, part], label=label, **dots)
                    axes.plot(applied, force[:, part], line, color=colour, lw=0.9)
            if test.is_pull:
                ratios.plot(applied, ratio_of_pull(test.stretch), **dots)
                ratios.plot(applied, ratio_of_pull(stretch), color=colour, lw=0.9)
            over.plot(
                *test.strain[:, :2].T, **(dots | {"color": "white", "ms": 2, "clip_on": False})
            )
        axes.set(xlabel="applied strain [1]", ylabel="force over width [N/mm]")
    pulls.legend(fontsize=6, handletextpad=0.2)
    figure.legend(
        *others.get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=6
    )
    others.set_title("held both ways (dashed: across), sheared")
    pulls.set_title("pulls: tests (markers), law (lines)")
    ratios.set_title("Poisson's ratio of these pulls")
    ratios.set(xlabel="applied strain [1]", ylabel="Poisson's ratio [1]")
    return figure


def _draw_energy(axes: Axes, law: "Law") -> None:
    lowest, highest = law.range
    across, along = (np.linspace(lowest[i], highest[i], POINTS) for i in (0, 1))
    strain = np.stack([*np.meshgrid(across, along), np.zeros((POINTS, POINTS))], axis=-1)
    energy = np.where(law.covers(strain), 1000 * law.energy(strain), np.nan)
    shown = axes.contourf(across, along, energy, levels=12, cmap=SEQUENCE_COLOURS)
    axes.figure.colorbar(shown, ax=axes, label="energy [µJ/mm²]")
    axes.set_title("energy without shear; tests in white")
    axes.margins(0.04)
    axes.set(xlabel="strain along courses, $E_{xx}$ [1]", ylabel="along wales, $E_{yy}$ [1]")
