"""Pareto figure: trials of a design by their distances from two conflicting targets."""

import numpy as np
import pandas as pd
from jaxtyping import Float
from matplotlib.figure import Figure

from knitlab.figures.style import ONE_COLUMN
from knitlab.figures.trade_off import non_dominated

HEIGHT = 3.0
MARGIN = 0.3
"""Margin around the front, as a fraction of its extent."""
FRONT, WITHIN = "#D55E00", "#009E73"


def pareto_figure(
    distances: Float[np.ndarray, "trial 2"],
    labels: tuple[str, str],
    candidates: pd.Series,
) -> Figure:
    """Trials by their distances from two targets, the front, and the candidates.

    Args:
        distances: distances from both targets, each over the tolerance of the target.
        labels: names of the targets.
        candidates: for each trial the number of the candidate whose search it belongs to.
    """
    figure = Figure(figsize=(ONE_COLUMN * 1.4, HEIGHT), layout="constrained")
    axes = figure.subplots()
    front = non_dominated(distances)
    for number in sorted(candidates.unique()):
        of_search = (candidates == number).to_numpy()
        axes.plot(*distances[of_search].T, "o", ms=4, alpha=0.7, label=f"search {number}")
    order = np.argsort(distances[front][:, 0])
    axes.plot(*distances[front][order].T, "-", color=FRONT, lw=1, label="Pareto front", zorder=0)
    axes.axvspan(0, 1, color=WITHIN, alpha=0.1, lw=0, label="within a tolerance")
    axes.axhspan(0, 1, color=WITHIN, alpha=0.1, lw=0)
    for axis, label, on_front in zip("xy", labels, distances[front].T, strict=True):
        getattr(axes, f"set_{axis}label")(f"off by, in tolerances:\n{label}", fontsize="small")
        # Trials far from the front would hide its shape.
        room = MARGIN * max(float(np.ptp(on_front)), 1.0)
        limits = max(float(on_front.min()) - room, -0.1), float(on_front.max()) + room
        getattr(axes, f"set_{axis}lim")(*limits)
    axes.legend(fontsize="small", loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure
