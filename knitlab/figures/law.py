"""The law of a fabric: its energy over the strains, and the tests that it is fitted to."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from knitlab.export.laws.fitting import predicted
from knitlab.figures.style import MARKERS, TWO_COLUMNS, print_style, shades

if TYPE_CHECKING:
    from knitlab.export.laws.law import Law

POINTS = 121  # along a strain of the map


@print_style()
def law_figure(law: "Law") -> Figure:
    """Energy without shear and where the tests are; forces and ν of the tests, and of the law."""
    figure = Figure(figsize=(TWO_COLUMNS, 3.2), layout="constrained")
    over, forces, ratios = figure.subplots(1, 3, width_ratios=(1.25, 1, 1))
    lowest, highest = law.range
    across, along = (np.linspace(lowest[i], highest[i], POINTS) for i in (0, 1))
    strain = np.stack(np.meshgrid(across, along, indexing="xy"), axis=-1)
    strain = np.concatenate([strain, np.zeros((*strain.shape[:2], 1))], axis=-1)
    energy = np.where(law.covers(strain), 1000 * law.energy(strain), np.nan)
    shown = over.contourf(across, along, energy, levels=12, cmap="viridis")
    bar = figure.colorbar(shown, ax=over, location="bottom", label="energy without shear [µJ/mm²]")
    bar.ax.tick_params(labelsize=6)
    over.set(xlabel="strain along courses, $E_{xx}$ [1]", ylabel="along wales, $E_{yy}$ [1]")
    for test, colour, marker in zip(
        law.tests, shades(len(law.tests)), MARKERS * len(law.tests), strict=False
    ):
        stretch, force = predicted(law.ridges, test)
        part = test.prescribed[min(1, len(test.prescribed) - 1)]
        applied = test.stretch[:, part] - (part != 2)
        style = {"marker": marker, "ms": 3, "mfc": "none", "ls": "", "color": colour, "mew": 0.8}
        forces.plot(applied, test.force[:, part], label=test.label, **style)
        forces.plot(applied, force[:, part], color=colour, lw=0.9)
        if test.is_pull:
            ratios.plot(applied, test.poisson_ratio(test.stretch), **style)
            ratios.plot(applied, test.poisson_ratio(stretch), color=colour, lw=0.9)
        over.plot(*test.strain[:, :2].T, **(style | {"color": "white", "ms": 2}))
    forces.set(xlabel="applied strain [1]", ylabel="force over width [N/mm]")
    ratios.set(xlabel="applied strain [1]", ylabel="Poisson's ratio of pulls [1]")
    figure.legend(loc="outside lower right", ncols=4, title="tests (markers) and law (lines)")
    return figure
