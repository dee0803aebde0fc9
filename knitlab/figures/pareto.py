"""Pareto figure: trials of a design by how far they are from two targets that pull apart."""

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float
from matplotlib.figure import Figure

from knitlab.figures.style import ONE_COLUMN

HEIGHT = 3.0
MARGIN = 0.3
"""Room around the front, in parts of its extent."""
FRONT, WITHIN = "#D55E00", "#009E73"


def non_dominated(off_by: Float[np.ndarray, "trial target"]) -> Bool[np.ndarray, " trial"]:
    """Which trials no other trial is nearer to all targets than."""
    one, other = off_by[:, None], off_by[None]
    no_worse = np.all(other <= one, axis=2)
    better = np.any(other < one, axis=2)
    return np.logical_not(np.any(no_worse & better, axis=1))


def pareto_figure(
    off_by: Float[np.ndarray, "trial 2"],
    labels: tuple[str, str],
    candidates: pd.Series,
) -> Figure:
    """Trials by their distances from two targets, the front, and the candidates.

    Args:
        off_by: distances, each over its tolerance; 1 is off by the tolerance.
        labels: of the targets.
        candidates: number of the candidate whose search each trial is of.
    """
    figure = Figure(figsize=(ONE_COLUMN * 1.4, HEIGHT), layout="constrained")
    axes = figure.subplots()
    front = non_dominated(off_by)
    for number in sorted(candidates.unique()):
        of_search = (candidates == number).to_numpy()
        axes.plot(*off_by[of_search].T, "o", ms=4, alpha=0.7, label=f"search {number}")
    order = np.argsort(off_by[front][:, 0])
    axes.plot(*off_by[front][order].T, "-", color=FRONT, lw=1, label="Pareto front", zorder=0)
    axes.axvspan(0, 1, color=WITHIN, alpha=0.1, lw=0)
    axes.axhspan(0, 1, color=WITHIN, alpha=0.1, lw=0)
    for axis, label, distances in zip("xy", labels, off_by[front].T, strict=True):
        getattr(axes, f"set_{axis}label")(f"off by, in tolerances:\n{label}", fontsize="small")
        # Trials far from the front would hide its shape.
        room = MARGIN * max(float(np.ptp(distances)), 1.0)
        limits = max(float(distances.min()) - room, -0.1), float(distances.max()) + room
        getattr(axes, f"set_{axis}lim")(*limits)
    axes.legend(fontsize="small", loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure
