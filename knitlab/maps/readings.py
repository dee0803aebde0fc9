"""Readings against claims: which of the paper's statements hold under each choice of the model."""

import itertools

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from knitlab.maps.cells import cell
from knitlab.maps.claims import Claim, read_claims
from knitlab.maps.margin import Verdict
from knitlab.maps.style import TWO_COLUMNS
from knitlab.sweep.cube_file import swept_dims
from knitlab.sweep.faults import fault

LOOKS = {
    Verdict.holds: ("#0072B2", "+", "white"),
    Verdict.fails: ("#E69F00", "−", "black"),
    Verdict.not_measured: ("white", "", "black"),
}
NAMES = {
    Verdict.holds: "+ holds",
    Verdict.fails: "− fails",
    Verdict.not_measured: "not measured: a design did not converge, or is not in the cube",
}


def readings_figure(cube: xr.Dataset) -> Figure:
    """A row for every claim that some reading decides, a column for every reading.

    Readings are ordered by how many claims hold, the best first; the head of a column says how
    many.

    Raises:
        BadInput: if the cube lies along no setting, or decides no claim.
    """
    dims = swept_dims(cube)
    if not dims:
        raise fault("readings", "the cube lies along no setting; give some a list of values")
    readings = {
        labels: cube.sel(dict(zip(dims, labels, strict=True)))
        for labels in itertools.product(*(cube[dim].values.tolist() for dim in dims))
    }
    claims, verdicts = verdicts_of(readings)
    if not claims:
        raise fault("readings", "no claim can be judged by this cube; run more of its designs")
    holding = (verdicts == Verdict.holds).sum(axis=0)
    order = np.argsort(-holding, kind="stable")
    figure = Figure(figsize=(TWO_COLUMNS, 1.9 + 0.19 * len(claims)), layout="constrained")
    axes = figure.add_subplot()
    for row, line in enumerate(verdicts[:, order]):
        for column, verdict in enumerate(line):
            colour, sign, ink = LOOKS[Verdict(verdict)]
            edge = "0.8" if verdict == Verdict.not_measured else "white"
            cell(axes, row, column, facecolor=colour, edgecolor=edge, linewidth=0.8)
            axes.text(column, row, sign, ha="center", va="center", color=ink, fontsize=7)
    names = list(readings)
    heads = [
        "\n".join([*(_short(label) for label in names[k]), f"{holding[k]} hold"]) for k in order
    ]
    axes.set(
        xlim=(-0.5, len(heads) - 0.5),
        ylim=(len(claims) - 0.5, -0.5),
        xticks=range(len(heads)),
        yticks=range(len(claims)),
    )
    axes.set_xticklabels(heads, fontsize=4.5 if len(heads) > 10 else 6)
    axes.set_yticklabels([claim.name.replace("_", " ") for claim in claims], fontsize=6)
    axes.xaxis.tick_top()
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    axes.set_title(", ".join(dims) + "; from above", fontsize=7)
    handles = [
        Patch(facecolor=LOOKS[verdict][0], edgecolor="0.7", label=label)
        for verdict, label in NAMES.items()
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False)
    return figure


def verdicts_of(
    readings: dict[tuple[str | float, ...], xr.Dataset],
) -> tuple[list[Claim], np.ndarray]:
    """The claims that some reading decides, and every reading's verdict on each.

    Args:
        readings: slices of a cube, by the values of its settings.
    """
    claims = read_claims()
    verdicts = np.array(
        [[claim.test.finding(reading).verdict for reading in readings.values()] for claim in claims]
    )
    decided = (verdicts != Verdict.not_measured).any(axis=1)
    return [claim for claim, its in zip(claims, decided, strict=True) if its], verdicts[decided]


def _short(label: str | float) -> str:
    return str(label).replace("stripe_", "").replace("per_", "").replace("_", " ")
