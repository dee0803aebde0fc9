"""Capacitances of several electrodes, cross-talk, and gauge factors of strain and bending."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from knitlab.cube.schema import STRAIN, Status
from knitlab.figures.kinds.design_map import draw_map
from knitlab.figures.style import (
    CATEGORY_COLOURS,
    ONE_COLUMN,
    TWO_COLUMNS,
    ink_on,
    name_rows,
    number,
    print_style,
    value_colours,
)

MOST_BARS = 6  # designs up to which bars are drawn in place of maps
DESIGN = ("n_stripe", "n_subunit")


@print_style()
def matrix_figure(matrix: xr.Dataset) -> Figure:
    """The capacitance matrix of electrodes, in the first state."""
    first = matrix["capacitance"].isel({STRAIN: 0})
    side = max(ONE_COLUMN, 1.2 + 0.45 * len(first))
    figure = Figure(figsize=(side, 0.85 * side), layout="constrained")
    axes = figure.add_subplot()
    _table(axes, first, "electrode", "to")
    axes.set_title("charge of an electrode [pF] by the voltage of another", fontsize=7)
    figure.suptitle(
        f"{matrix.attrs['design']}; strain {float(first[STRAIN]):.0%}", fontsize="small"
    )
    return figure


@print_style()
def cross_talk_figure(table: xr.Dataset) -> Figure:
    """What each sensor reads while another is pulled, and how they are coupled by charge."""
    figure = Figure(figsize=(TWO_COLUMNS, 1.6 + 0.4 * table.sizes["sensor"]), layout="constrained")
    left, right = figure.subplots(1, 2)
    _table(left, table["cross_talk"], "sensor", "pulled")
    left.set_title("reading, over that of its own strain [1]")
    _table(right, table["coupling"], "sensor", "pulled")
    right.set(title="mutual capacitance over reading [1]", xlabel="other")
    said = f"pulled along the {table.attrs['pull']}, other electrodes {table.attrs['others']}"
    figure.suptitle(f"{table.attrs['design']}; {said}", fontsize="small")
    return figure


def _table(axes: Axes, values: xr.DataArray, rows: str, columns: str) -> None:
    """A square table of numbers on colours."""
    numbers = values.transpose(rows, columns).values
    colours = value_colours(numbers, signed=True)
    axes.imshow(colours.to_rgba(numbers))
    for row, column in np.ndindex(numbers.shape):
        value = float(numbers[row, column])
        ink = ink_on(colours.to_rgba(np.array(value))[:3])
        axes.text(column, row, number(value, ".3g"), ha="center", va="center", color=ink)
    name_rows(axes, [str(name) for name in values[rows].values])
    axes.set_xticks(range(len(numbers)), [str(name) for name in values[columns].values])
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    axes.set(xlabel=columns, ylabel=rows)


@print_style()
def selectivity_figure(selectivity: xr.Dataset) -> Figure:
    """Gauge factors of strain along and across, and of bending: maps of designs, or bars of few.

    Of cloth that follows a skin, at the first selected strain. The selectivity, along over across,
    is stated beside the first.
    """
    along = selectivity.attrs["along"]
    across = "weft" if along == "warp" else "warp"
    state = selectivity.isel({STRAIN: 0}).sel(sides="held")
    values = {
        f"strain along the {along}: gauge factor [1]": state["strain_gauge"].sel(direction=along),
        f"strain across, along the {across} [1]": state["strain_gauge"].sel(direction=across),
        f"bending along the {along} [mm]": state["bending_gauge"].sel(direction=along),
        f"bending across, along the {across} [mm]": state["bending_gauge"].sel(direction=across),
    }
    known = int(np.isfinite(state["selectivity"]).sum())
    maps = known > MOST_BARS and state["selectivity"].dims == DESIGN
    figure = (_maps if maps else _bars)(state, values)
    figure.suptitle(
        f"change of ln C by strain and curvature, sides held; at {float(state[STRAIN]):.0%} strain",
        fontsize="small",
    )
    return figure


def _maps(state: xr.Dataset, values: dict[str, xr.DataArray]) -> Figure:
    """A map over n_stripe and n_subunit for each value."""
    figure = Figure(
        figsize=(TWO_COLUMNS, 1.6 + 1.2 * state.sizes["n_stripe"]), layout="constrained"
    )
    present = xr.where(state["sensing_status"] == "", int(Status.excluded), int(Status.ok))
    panels = figure.subplots(2, 2).flat
    for axes, (label, each) in zip(panels, values.items(), strict=True):
        cube = xr.Dataset({"value": each.drop_vars("direction"), "status": present})
        cube["selectivity"] = state["selectivity"]
        text = _with_selectivity if label.startswith("strain along") else _plain
        draw_map(axes, [cube], "value", "", text, signed=True)
        axes.set_title(label)
        axes.set(ylabel="n_stripe", xlabel="P = n_subunit / (2 n_stripe)")
    figure.supxlabel("S: gauge factor along over that across; white: not known", fontsize=7)
    return figure


def _with_selectivity(value: float, design: xr.Dataset) -> str:
    return f"{number(value)}\nS {number(float(design['selectivity']))}"


def _plain(value: float, design: xr.Dataset) -> str:
    return number(value)


def _bars(state: xr.Dataset, values: dict[str, xr.DataArray]) -> Figure:
    """Bars of the values of designs, strains on the left and curvatures on the right."""
    dims = [str(dim) for dim in state["selectivity"].dims]
    flat = state.stack(design=dims) if dims else state.expand_dims("design")
    flat = flat.isel(design=np.flatnonzero(np.isfinite(flat["selectivity"])))
    labels = list(values)
    names = _names(flat, dims) or ["none is known"]
    figure = Figure(figsize=(TWO_COLUMNS, 1.4 + 0.45 * len(names)), layout="constrained")
    panels = figure.subplots(1, 2)
    for panel, pair in zip(panels, (labels[:2], labels[2:]), strict=True):
        for k, label in enumerate(pair):
            each = values[label].stack(design=dims) if dims else values[label].expand_dims("design")
            each = each.isel(design=np.flatnonzero(np.isfinite(each)))
            place = np.arange(len(each)) + (k - 0.5) * 0.36
            colour = CATEGORY_COLOURS[k]
            panel.barh(place, each.values, height=0.34, color=colour, label=label)
        panel.axvline(0, color="0.3", lw=0.6)
        panel.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0))
        name_rows(panel, names if panel is panels[0] else [""] * len(names))
    return figure


def _names(flat: xr.Dataset, dims: list[str]) -> list[str]:
    """Names of designs, each with its selectivity."""
    names = []
    for design in range(flat.sizes["design"]):
        one = flat.isel(design=design)
        values = ", ".join(f"{one[dim].item():g}" for dim in dims)
        name = f"({values})\n" if dims else ""
        names.append(f"{name}selectivity {number(float(one['selectivity']), '.2g')}")
    return names
