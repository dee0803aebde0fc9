"""Shapes in case files: by height, with electrodes, while relaxing, and stretched samples."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MultipleLocator
from mpl_toolkits.mplot3d import Axes3D
from scipy.interpolate import RegularGridInterpolator

from knitlab.cubes.case_file import length_unit
from knitlab.export.meshes.fabric import closed_nodes, is_periodic, on_grid_cells
from knitlab.figures import sheets, style
from knitlab.figures.cells import design_name
from knitlab.figures.kinds import FigureKind
from knitlab.figures.kinds.tension import PAPER_DESIGNS, SHOWN_STRAIN
from knitlab.figures.style import CATEGORY_COLOURS, ONE_COLUMN, SEQUENCE_COLOURS, TWO_COLUMNS, Look
from knitlab.io.errors import invalid
from knitlab.observables.schema import DESIGN_DIMS

if TYPE_CHECKING:
    from knitlab.model.pattern import PatchGrid
    from knitlab.solvers.case import Case

MOST_NAMES = 4  # patches along a side that are named; where there are more they have a letter each
LETTERS = "R rib, G garter, P plain"
COLOURS = {"A": "#D55E00", "B": "#0072B2"}  # of the electrodes
SHADES = {"R": "0.82", "G": "0.94", "P": "1.0"}  # grey of every knit, by its letter
CELLS_PER_TICK, MOST_TICKS = 4, 12
CONTRACTED = (0.0, 0.15, 0.5)  # fractions of the in-plane contraction at the first snapshots
FINE, COARSE, FEW_CELLS = 4, 2, 24  # subdivisions of a grid cell: fine up to so many cells


def fabric_shape(case: xr.Dataset) -> Figure:
    """Shape of a fabric seen from the technical face; relaxed, or at ``applied_strain``.

    Colour is height, white lines are patch borders.
    """
    from knitlab.cubes.recorded_case import recorded_case

    recorded = recorded_case(case)
    repeats = 2 if is_periodic(case) else 1
    nodes = closed_nodes(case.isel(applied_strain=[0]), (repeats, repeats))[0]
    along_y, along_x = recorded.unit_cells
    repeat = len(recorded.pattern), len(recorded.pattern[0])
    cells = repeats * along_y, repeats * along_x
    sample = replace(recorded, unit_cells=cells).sample
    faces = sheets.faces_of(nodes)
    heights = faces[:, :, 2].mean(axis=1)
    colours = ScalarMappable(Normalize(heights.min(), heights.max()), SEQUENCE_COLOURS)
    extent = np.ptp(nodes[..., :2], axis=(0, 1))
    height = ONE_COLUMN * min(1.6, 0.8 * extent[1] / extent[0]) + 0.7
    figure, axes = style.subplots(height, width=ONE_COLUMN * 1.2)
    unit = length_unit(case)
    sheets.draw_faces(axes, faces, colours.to_rgba(heights), unit)
    borders = (*nodes[sample.row_borders], *nodes[:, sample.column_borders].swapaxes(0, 1))
    lines = LineCollection([line[:, :2] for line in borders], colors="white", lw=0.6)
    axes.add_collection(lines)
    _name_patches(axes, nodes, sample, repeat)
    notes = ["white lines: patch borders", *([LETTERS] if max(repeat) > MOST_NAMES else [])]
    if "self_intersections" in case and (crossing := int(case["self_intersections"][0])):
        notes.insert(0, f"passes through itself: {crossing} pairs of cells")
    state = "periodic, " if is_periodic(case) else ""
    state += sheets.state_text(float(case["applied_strain"][0]))
    axes.set_title("\n".join([sheets.design_text(case), state, "; ".join(notes)]), fontsize=7)
    figure.colorbar(colours, ax=axes, label=f"height z [{unit}]", shrink=0.8)
    return figure


def _name_patches(
    axes: Axes, nodes: np.ndarray, sample: "PatchGrid", repeat: tuple[int, int]
) -> None:
    """Write the knit on the patches of the repeat of the pattern nearest the middle."""
    from knitlab.model.pattern import KNIT_OF_LETTER

    large = max(repeat) <= MOST_NAMES
    look: Look = {"ha": "center", "va": "center", "color": "white", "fontsize": 8 if large else 6}
    look["path_effects"] = [withStroke(linewidth=2, foreground="black")]
    counts = np.array(sample.knit.shape)
    rows, columns = (
        (borders[:-1] + borders[1:]) // 2 for borders in (sample.row_borders, sample.column_borders)
    )
    for at in np.ndindex(repeat):
        row, column = at + repeat * ((counts // repeat - 1) // 2)
        letter = str(sample.knit[row, column])
        across, along = nodes[rows[row], columns[column], :2]
        axes.text(across, along, KNIT_OF_LETTER[letter] if large else letter, **look)


def electrodes_figure(case_file: xr.Dataset) -> Figure:
    """Where electrodes run, on the chart and on the fabric, relaxed or at ``applied_strain``."""
    from knitlab.cubes.recorded_case import recorded_case
    from knitlab.model.pattern import KNIT_OF_LETTER

    case = recorded_case(case_file)
    if case.capacitor is None:
        raise invalid("electrodes", "this case has no electrodes; run a workflow with [electrodes]")
    figure = Figure(figsize=(TWO_COLUMNS, 3.6))
    chart = figure.add_axes((0.06, 0.2, 0.36, 0.7))
    _draw_chart(chart, case)
    design = ", ".join(f"{name} = {value}" for name, value in case.design.items())
    chart.set_title(f"flat, {design}")
    scene = figure.add_axes((0.44, 0.1, 0.56, 0.86), projection="3d")
    _draw_fabric(scene, case, case_file)
    scene.set_title(sheets.state_text(float(case_file["applied_strain"][0])), y=0.96)
    handles = [Patch(color=colour, label=f"electrode {name}") for name, colour in COLOURS.items()]
    knits = {KNIT_OF_LETTER[letter]: SHADES[letter] for letter in np.unique(case.sample.knit)}
    if case.pure:
        knits = {case.weft.knit: SHADES["G"]}
    handles += [Patch(fc=shade, ec="0.6", lw=0.5, label=knit) for knit, shade in knits.items()]
    figure.legend(handles=handles, loc="lower center", ncols=4)
    return figure


def _draw_chart(axes: Axes, case: "Case") -> None:
    sample = case.sample
    rows, columns = sample.row_borders.tolist(), sample.column_borders.tolist()
    for row, column in np.ndindex(sample.knit.shape):
        corner = columns[column], rows[row]
        size = columns[column + 1] - columns[column], rows[row + 1] - rows[row]
        shade = SHADES[str(sample.knit[row, column])]
        axes.add_patch(Rectangle(corner, *size, color=shade, lw=0))
    for strips, colour in zip(case.electrodes.strips, COLOURS.values(), strict=True):
        for strip in strips:
            size = strip.right - strip.left, strip.top - strip.bottom
            axes.add_patch(Rectangle((strip.left, strip.bottom), *size, color=colour, lw=0))
    height, width = sample.grid
    axes.set(xlim=(0, width), ylim=(0, height), aspect="equal")
    axes.set(xlabel="x, weft [grid cells]", ylabel="y, warp [grid cells]")
    step = CELLS_PER_TICK * int(np.ceil(max(width, height) / CELLS_PER_TICK / MOST_TICKS))
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MultipleLocator(step))


def _draw_fabric(scene: Axes3D, case: "Case", case_file: xr.Dataset) -> None:
    sheet = closed_nodes(case_file.isel(applied_strain=[0]))[0]
    cells = sheet.shape[0] - 1, sheet.shape[1] - 1
    subdivisions = FINE if max(cells) <= FEW_CELLS else COARSE
    y, x = ((np.arange(count * subdivisions) + 0.5) / subdivisions for count in cells)
    colours = np.full((len(y), len(x)), sheets.FABRIC, dtype=object)
    for strips, colour in zip(case.electrodes.strips, COLOURS.values(), strict=True):
        for strip in strips:
            (left, right), (low, high) = strip.extents
            across = (left < x) & (x < right)
            if case.mesh_shape.periodic:
                across |= (left < x + cells[1]) & (x + cells[1] < right)
            colours[np.ix_((low < y) & (y < high), across)] = colour
    along = (np.arange(n * subdivisions + 1) / subdivisions for n in cells)
    fine = np.meshgrid(*along, indexing="ij")
    refined = RegularGridInterpolator([np.arange(n + 1) for n in cells], sheet)
    sheets.draw_sheet(scene, refined(np.stack(fine, axis=-1)), colours.ravel().tolist())
    sheets.frame_sheet(scene, sheet)


def relaxation_figure(case: xr.Dataset) -> Figure:
    """Kinetic energy against time, and snapshots (paper, Fig. "unit simulation")."""
    nodes = snapshot_nodes(case)
    area = np.ptp(nodes[..., :2], axis=(1, 2)).prod(axis=1)
    contracted = area[0] - area
    reached = [contracted >= (fraction - 1e-9) * contracted[-1] for fraction in CONTRACTED]
    chosen = [*(int(np.argmax(each)) for each in reached), len(nodes) - 1]
    figure = Figure(figsize=(TWO_COLUMNS, 4.2))
    axes = figure.add_axes((0.085, 0.52, 0.9, 0.42))
    time, kinetic = case["time"].values[1:], case["kinetic_energy"].values[1:]
    stored = case["potential_energy"].values
    at_once = stored[0] > stored[-1]  # the folds have all their rest angles at the beginning
    elastic, label = stored[1:], "elastic energy, while the folds develop"
    if at_once:
        elastic, label = elastic - elastic[-1], "elastic energy above the relaxed state"
    axes.plot(time, kinetic, color=CATEGORY_COLOURS[0], label="kinetic energy $T$")
    axes.plot(time, np.where(elastic > 0, elastic, np.nan), "--", color="0.45", label=label)
    axes.set(xlabel="time since the flat sheet was released [ms]", ylabel="energy [N mm]")
    axes.set(xscale="log" if at_once else "linear", yscale="log")
    axes.set_xlim(0.7 * time[0] if at_once else 0, (1.1 if at_once else 1.03) * time[-1])
    axes.set_ylim(max(kinetic[-1], 1e-14), 5 * max(stored))
    axes.legend(loc="lower left" if at_once else "lower center")
    width = 1 / len(chosen)
    beside: Look = {"xytext": (2, -2), "textcoords": "offset points", "va": "top"}
    for column, (snapshot, letter) in enumerate(zip(chosen, "abcd", strict=True)):
        instant = float(case["snapshot"][snapshot])
        at = max(instant, axes.get_xlim()[0])
        axes.axvline(at, color="0.75", lw=0.6, zorder=0)
        axes.annotate(letter, (at, 1), xycoords=("data", "axes fraction"), **beside)
        scene = figure.add_axes((column * width, 0.0, width, 0.36), projection="3d")
        sheets.draw_sheet(scene, nodes[snapshot])
        sheets.frame_sheet(scene, nodes)
        figure.text((column + 0.5) * width, 0.37, f"{letter}: {instant:.2g} ms", ha="center")
    figure.text(0.5, 0.97, sheets.design_text(case), ha="center")
    return figure


def snapshot_nodes(case: xr.Dataset) -> np.ndarray:
    """Node positions (snapshot, y, x, component) of a relaxation, periodic fabric closed [mm]."""
    states = {f"snapshot_{name}": name for name in ("position", "length_x", "length_y")}
    states = {name: state for name, state in states.items() if name in case}
    return closed_nodes(case[[*states]].rename(states | {"snapshot": "applied_strain"}))


def stretched_samples(cases: Sequence[xr.Dataset]) -> Figure:
    """Samples between clamps, relaxed and stretched (paper, Fig. "tension images").

    Each is shown relaxed and at the recorded strain nearest 0.23, or at one or two selected values
    of ``applied_strain``.
    """
    from knitlab.cubes.recorded_case import recorded_case

    if any("length_x" in case for case in cases):
        raise invalid("samples", "shows samples between clamps, not periodic fabric; draw shape")
    strains = cases[0]["applied_strain"]
    if len(strains) > 2:
        strains = strains.sel(applied_strain=[0, SHOWN_STRAIN], method="nearest")
    states = [case.sel(applied_strain=strain) for case in cases for strain in strains.values]
    values = np.concatenate([state["strain_xx"].values.ravel() for state in states])
    by_strain = style.value_colours(values, signed=True)
    spans = [np.ptp(state["position"].values[..., :2], axis=(0, 1)) for state in states]
    widths, heights = 1.1 * np.transpose(spans)
    height = 0.75 * TWO_COLUMNS * heights.max() / widths.sum() + 1.3
    look: Look = {"squeeze": False, "sharey": True, "width_ratios": widths}
    figure, (grid,) = style.subplots(height, 1, len(states), **look)
    for axes, state in zip(grid, states, strict=True):
        nodes = state["position"].values
        faces = sheets.faces_of(nodes - [0, nodes[..., 1].min(), 0])
        case = recorded_case(state)
        local = on_grid_cells(case, state["strain_xx"].values).ravel()
        sheets.draw_faces(axes, faces, sheets.shaded(faces, by_strain.to_rgba(local)))
        patterned = "pattern" in state.coords
        design = str(state["pattern"].item()).replace("_", " ") if patterned else design_name(state)
        cells_y, cells_x = state["strain_xx"].shape
        shown = sheets.state_text(float(state["applied_strain"]))
        axes.set(title=f"{design}\n{cells_x} × {cells_y} cells\n{shown}", xlabel="", ylabel="")
    grid[0].set_ylabel(f"y, warp [{length_unit(cases[0])}]")
    figure.supxlabel(f"x, weft [{length_unit(cases[0])}]", fontsize="medium")
    label = "local transverse strain $\\varepsilon_{xx}$ [1]\nof a unit cell; shading is slope"
    style.colour_bar(list(grid), by_strain, label=label, shrink=0.8, aspect=30)
    return figure


SLICED = ("applied_strain",)
FIGURES = {
    "shape": FigureKind(fabric_shape, needs="position", coordinates=SLICED),
    "electrodes": FigureKind(electrodes_figure, None, needs="position", coordinates=SLICED),
    "samples": FigureKind(stretched_samples, DESIGN_DIMS, "position", PAPER_DESIGNS, SLICED),
    "relaxation": FigureKind(relaxation_figure, needs="snapshot_position"),
}
