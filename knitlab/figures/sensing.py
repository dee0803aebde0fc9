"""Capacitances of several electrodes, cross-talk, and gauge factors of strain and bending."""

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from knitlab.figures.cells import number_table
from knitlab.figures.design_map import draw_map
from knitlab.figures.style import CATEGORY_COLOURS, ONE_COLUMN, name_rows, number, subplots
from knitlab.observables.schema import DESIGN_DIMS, STRAIN
from knitlab.observables.status import Status

MAX_BARS = 6  # designs up to which bars are drawn in place of maps


def matrix_figure(matrix: xr.Dataset) -> Figure:
    """The capacitance matrix of electrodes, in the first state."""
    first = matrix["capacitance"].isel({STRAIN: 0})
    side = max(ONE_COLUMN, 1.2 + 0.45 * len(first))
    figure, axes = subplots(0.85 * side, width=side)
    number_table(axes, first, "electrode", "to")
    axes.set_title("charge of an electrode [pF] by the voltage of another", fontsize=7)
    figure.suptitle(
        f"{matrix.attrs['design']}; strain {float(first[STRAIN]):.0%}", fontsize="small"
    )
    return figure


def cross_talk_figure(table: xr.Dataset) -> Figure:
    """What each sensor reads while another is pulled, and how they are coupled by charge."""
    figure, (left, right) = subplots(1.6 + 0.4 * table.sizes["sensor"], 1, 2)
    number_table(left, table["cross_talk"], "sensor", "pulled")
    left.set_title("reading, over that of its own strain [1]")
    number_table(right, table["coupling"], "sensor", "pulled")
    right.set(title="mutual capacitance over reading [1]", xlabel="other")
    said = f"pulled along the {table.attrs['pull']}, other electrodes {table.attrs['others']}"
    figure.suptitle(f"{table.attrs['design']}; {said}", fontsize="small")
    return figure


def selectivity_figure(selectivity: xr.Dataset) -> Figure:
    """Gauge factors of strain and bending at the first strain: maps of designs, or bars of few."""
    along = selectivity.attrs["along"]
    across = "weft" if along == "warp" else "warp"
    first = selectivity.isel({STRAIN: 0}).sel(sides="held")
    state = first[["selectivity"]].assign(
        {
            label: first[name].sel(direction=direction, drop=True)
            for label, name, direction in (
                (f"strain along the {along}: gauge factor [1]", "strain_gauge", along),
                (f"strain across, along the {across} [1]", "strain_gauge", across),
                (f"bending along the {along} [mm]", "bending_gauge", along),
                (f"bending across, along the {across} [mm]", "bending_gauge", across),
            )
        }
    )
    known = int(np.isfinite(state["selectivity"]).sum())
    if known > MAX_BARS and state["selectivity"].dims == DESIGN_DIMS:
        present = xr.where(first["sensing_status"] == "", int(Status.excluded), int(Status.ok))
        figure = _maps(state.assign(status=present))
    else:
        figure = _bars(state)
    figure.suptitle(
        f"change of ln C by strain and curvature, sides held; at {float(state[STRAIN]):.0%} strain",
        fontsize="small",
    )
    return figure


def _maps(state: xr.Dataset) -> Figure:
    def text(value: float, design: xr.Dataset) -> str:
        shown = f"\nS {number(float(design['selectivity']))}" if axes is grid[0, 0] else ""
        return number(value) + shown

    figure, grid = subplots(1.6 + 1.2 * state.sizes["n_stripe"], 2, 2)
    labels = [str(name) for name in state.data_vars if name not in ("selectivity", "status")]
    for axes, label in zip(grid.flat, labels, strict=True):
        draw_map(axes, [state], label, "", text, signed=True)
        axes.set(title=label, ylabel="n_stripe", xlabel="P = n_subunit / (2 n_stripe)")
    figure.supxlabel("S: gauge factor along over that across; white: not known", fontsize=7)
    return figure


def _bars(state: xr.Dataset) -> Figure:
    dims = [str(dim) for dim in state["selectivity"].dims]
    flat = state.stack(design=dims) if dims else state.expand_dims("design")
    flat = flat.isel(design=np.flatnonzero(np.isfinite(flat["selectivity"])))
    names = [
        (f"({', '.join(f'{one[dim].item():g}' for dim in dims)})\n" if dims else "")
        + f"selectivity {number(float(one['selectivity']), '.2g')}"
        for one in map(flat.isel, ({"design": k} for k in range(flat.sizes["design"])))
    ]
    names = names or ["none is known"]
    figure, panels = subplots(1.4 + 0.45 * len(names), 1, 2)
    _, *labels = map(str, state.data_vars)
    for panel, pair in zip(panels, (labels[:2], labels[2:]), strict=True):
        for k, label in enumerate(pair):
            place = np.arange(flat.sizes["design"]) + (k - 0.5) * 0.36
            panel.barh(place, flat[label], height=0.34, color=CATEGORY_COLOURS[k], label=label)
        panel.axvline(0, color="0.3", lw=0.6)
        panel.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0))
        name_rows(panel, names if panel is panels[0] else [""] * len(names))
    return figure
