"""Curves of a tensile test against applied strain: strains, force, and tension of pure stripes.

Curves are dashed if they were measured, and break where the fabric snaps.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from knitlab.cubes.cube_file import is_measured, source_of
from knitlab.figures.cells import designs_of
from knitlab.figures.kinds import FigureKind
from knitlab.figures.style import Look, shades, subplots
from knitlab.io.errors import invalid
from knitlab.observables.schema import RUN, STRIPE_DIMS, Status

BAND = 0.25  # opacity of a band
BREAK = "break: the fabric snaps there"
ENDED = "the test did not converge beyond"
ROWS = {
    "mean_strain_xx": "strain along the weft\nmean $\\varepsilon_{xx}$ [1]",
    "mean_strain_yy": "strain along the warp\nmean $\\varepsilon_{yy}$ [1]",
    "poisson_ratio": "Poisson's ratio\n$\\nu$ [1]",
}
FORCE_ROWS = {
    "force_per_width": "force over width\n[N/cm]",
    "tangent_stiffness": "tangent stiffness\n[N/cm]",
    "stretch_energy": "energy to stretch\n[mJ/cm²]",
}
IN_FIGURE = {"force_per_width": 10.0, "tangent_stiffness": 10.0, "stretch_energy": 100.0}
"""Factors from N/mm, or mJ/mm², to the units of these labels."""
SHEETS: dict[str, Look] = {
    "periodic": {"marker": "o", "ms": 2.5, "fillstyle": "full", "ls": ""},
    "clamped": {"marker": "s", "ms": 5, "fillstyle": "none", "ls": ""},
}
"""Marks of the sheets, by their boundary."""


def tension_curves(cubes: Sequence[xr.Dataset]) -> Figure:
    """ε_xx, ε_yy and ν against applied strain (paper, Fig. "tension plots").

    Colour encodes P, the periods in a patch, in every column of n_stripe.
    """
    if not any(name in cube for cube in cubes for name in ROWS):
        raise invalid("curves", "shows strains, and no cube has any; import markers")
    return _curves(cubes, ROWS)


def force_curves(cubes: Sequence[xr.Dataset]) -> Figure:
    """Force over the width of the cloth, tangent stiffness and energy, against applied strain.

    The width is that of the relaxed fabric, in cloth by the gauge; the energy is that over its
    area.
    """
    if not any("force_per_width" in cube for cube in cubes):
        raise invalid("force", "shows force over width, and no cube has any; simulate patches")
    return _curves(cubes, FORCE_ROWS)


def _curves(cubes: Sequence[xr.Dataset], rows: Mapping[str, str]) -> Figure:
    """A row of curves for each variable, with its label."""
    designs = [one for cube in cubes for one in designs_of(cube) if int(one["status"]) in RUN]
    if not designs:
        raise invalid("designs", "none of this selection has been simulated; run it first")
    stripes = sorted({int(n) for cube in cubes for n in cube["n_stripe"].values})
    periods = np.unique([float(design["periods"]) for design in designs])
    colours = dict(zip(periods, shades(len(periods)), strict=True))
    figure, grid = subplots(4.9, len(rows), len(stripes), sharex=True, sharey="row", squeeze=False)
    # Axial strain follows the diagonal and energy rises from 0, so that this corner is free.
    row, corner = (1, "lower right") if rows is ROWS else (2, "upper left")
    for column, n_stripe in zip(grid.T, stripes, strict=True):
        for design in designs:
            if int(design["n_stripe"]) == n_stripe:
                _draw_design(column, rows, design, colours[float(design["periods"])])
        column[0].set_title(f"n_stripe = {n_stripe}")
        if column[row].lines:
            small: Look = {"fontsize": 6, "title_fontsize": 6, "borderpad": 0, "labelspacing": 0.15}
            small["handlelength"] = 1.6 if any(map(is_measured, cubes)) else 1
            column[row].legend(title="n_subunit", loc=corner, **small)
        column[-1].set_xlabel("applied strain [1]")
    for axes, label in zip(grid[:, 0], rows.values(), strict=True):
        axes.set_ylabel(label)
    for axes in (*grid[0], *grid[-1]):
        axes.axhline(0, color="0.7", lw=0.6, zorder=0)
    figure.align_ylabels(list(grid[:, 0]))
    if notes := _notes(designs, rows):
        figure.legend(handles=notes, loc="outside lower center", ncols=2)
    return figure


def _notes(designs: Sequence[xr.Dataset], rows: Iterable[str]) -> list[Artist]:
    """Legend entries of what the curves show besides their colour."""
    names = {str(name) for design in designs for name in design.data_vars}
    band: Look = {"facecolor": "0.3", "alpha": BAND, "lw": 0}
    spread = Patch(label="band: range over slightly different fabrics", **band)
    measured = Line2D([], [], color="0.3", ls="--", label="measured")
    error = Patch(label="band of a measured curve: two standard errors", **band)
    ended = Line2D([], [], color="0.3", marker="x", ms=6, ls="", label=ENDED)
    return [
        *([spread] if any(f"{name}_low" in names for name in rows) else []),
        *([measured] if any(map(is_measured, designs)) else []),
        *([error] if any(f"{name}_error" in names for name in rows) else []),
        *break_note(designs),
        *([ended] if any(int(one["status"]) == Status.not_converged for one in designs) else []),
    ]


def _draw_design(
    column: Iterable[Axes], rows: Iterable[str], design: xr.Dataset, colour: Any
) -> None:
    measured = is_measured(design)
    label = f"{int(design['n_subunit'])} (P = {int(design['periods'])})"
    label += f", {source_of(design)}" if measured else ""
    look: Look = {"color": colour, "ls": "--" if measured else "-", "label": label}
    strains, snapped = design["applied_strain"].values, snapped_before(design)
    for axes, name in zip(column, rows, strict=True):
        if name not in design:
            continue
        curves = [design[name]]
        if f"{name}_error" in design:
            curves += [design[name] + factor * design[f"{name}_error"] for factor in (-2, 2)]
        elif f"{name}_low" in design:
            curves += [design[f"{name}_{end}"] for end in ("low", "high")]
        recorded = np.isfinite(design[name].values)
        scaled = [IN_FIGURE.get(name, 1.0) * curve.values[recorded] for curve in curves]
        strain, value, *band = broken(snapped[recorded], strains[recorded], *scaled)
        axes.plot(strain, value, marker="" if measured else ".", ms=3, **look)
        if band:
            axes.fill_between(strain, band[0], band[1], color=colour, alpha=BAND, lw=0)
        if int(design["status"]) == Status.not_converged and recorded.any():
            axes.plot(strain[-1], value[-1], "x", ms=6, color=colour)


def snapped_before(design: xr.Dataset) -> Bool[np.ndarray, " strain"]:
    """Whether a design snapped on the way to each applied strain; nowhere if it is not recorded."""
    if "snapped" not in design:
        return np.zeros(design.sizes["applied_strain"], bool)
    return np.asarray(design["snapped"].values == 1)


def broken(
    snapped: Bool[np.ndarray, " strain"], *curves: Float[np.ndarray, " strain"]
) -> list[Float[np.ndarray, " point"]]:
    """Curves that break as lines, by a missing value, on the way to every strain that snapped."""
    before = np.flatnonzero(snapped)
    before = before[before > 0]
    return [np.insert(np.asarray(curve, float), before, np.nan) for curve in curves]


def break_note(designs: Iterable[xr.Dataset]) -> list[Line2D]:
    """Legend entry of the breaks, if there are any."""
    if not any(snapped_before(design)[1:].any() for design in designs):
        return []
    # A piece of line, a gap and a piece of line in the width of a handle.
    return [Line2D([], [], color="0.3", ls=(0, (4.2, 3.3)), label=BREAK)]


def stripe_tension(cube: xr.Dataset) -> Figure:
    """Tension curves of pure stripes: zigzag as lines, sheet as points (paper, Fig. 1D, E)."""
    figure, panels = stripe_panels(cube)
    sheets = {boundary: SHEETS[boundary] for boundary in cube["boundary"].values}
    for axes, knit in zip(panels, cube["knit"].values, strict=True):
        for colour, stripe in coloured_stripes(cube, knit):
            zigzag = stripe["zigzag_force"].max("boundary")
            axes.plot(cube["applied_strain"], zigzag, color=colour, label=str(int(stripe["n"])))
            for boundary, look in sheets.items():
                points = stripe["row_force"].sel(boundary=boundary)[::4]
                axes.plot(points["applied_strain"], points, color=colour, **look)
        axes.set(ylabel="force for one row [N]", ylim=(0, None))
        axes.legend(title="stripe $n$", loc="upper left")
    looks: dict[str, Look] = {"2D zigzag": {}}
    looks |= {f"3D sheet, {boundary}": look for boundary, look in sheets.items()}
    handles = [Line2D([], [], color="0.3", label=label, **look) for label, look in looks.items()]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles))
    return figure


def stripe_panels(cube: xr.Dataset) -> tuple[Figure, Sequence[Axes]]:
    """A figure with one panel for each knit of a cube of pure stripes."""
    knits = cube["knit"].values
    figure, (panels,) = subplots(3.2, 1, len(knits), squeeze=False)
    for axes, knit in zip(panels, knits, strict=True):
        axes.set(title=f"$n \\times n$ {knit}", xlabel="applied strain [1]")
    return figure, panels


def coloured_stripes(cube: xr.Dataset, knit: str) -> Iterator[tuple[Any, xr.Dataset]]:
    """The stripes of a knit that have results, each with a colour."""
    family = cube.sel(knit=knit).transpose("n", "boundary", ...)
    family = family.isel(n=family["status"].isin(RUN).any("boundary").values)
    for n, colour in zip(family["n"].values, shades(family.sizes["n"]), strict=True):
        yield colour, family.sel(n=n)


SLICED = ("applied_strain",)
FIGURES = {
    "curves": FigureKind(tension_curves, coordinates=SLICED, several="experiments"),
    "force": FigureKind(force_curves, coordinates=SLICED, several="experiments"),
    "stripes": FigureKind(stripe_tension, STRIPE_DIMS, coordinates=SLICED),
}
