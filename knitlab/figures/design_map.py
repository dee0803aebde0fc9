"""Maps of designs over n_stripe and P."""

from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from itertools import chain

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle

from knitlab.cubes.cube_file import is_measured
from knitlab.cubes.trust import MARKS, marked
from knitlab.figures import cells, style
from knitlab.figures.style import Look
from knitlab.io.errors import invalid
from knitlab.observables.status import Status

LAST = "‡ lowest at the last strain of the test: ν may fall further"
ENDS = "‡ the test ends within the working range: it may be wider"


def draw_map(
    axes: Axes,
    cubes: Sequence[xr.Dataset],
    name: str,
    label: str,
    text: Callable[[float, xr.Dataset], str],
    signed: bool = False,
) -> set[Status]:
    """Draw a map of cells over n_stripe and P with its colour bar; the statuses that it marks."""
    values = [cube[name].values.ravel() for cube in cubes if name in cube]
    colours = style.value_colours(np.concatenate([np.empty(0), *values]), signed)
    cell_designs = defaultdict[tuple[int, float], list[xr.Dataset]](list)
    for design in chain.from_iterable(map(cells.planned_designs, sorted(cubes, key=is_measured))):
        cell_designs[int(design["n_stripe"]), cells.periods_of(design)].append(design)
    if any(sum(map(is_measured, designs)) > 1 for designs in cell_designs.values()):
        raise invalid("experiments", "there are several on one design; show one of them")
    stripes, periods = (sorted({each[k] for each in cell_designs}) for k in (0, 1))
    marked = {Status.excluded} if len(cell_designs) < len(stripes) * len(periods) else set[Status]()
    for (n_stripe, p), designs in cell_designs.items():
        row, column = stripes.index(n_stripe), periods.index(p)
        border = row - 0.5 + (0.42 if len(designs) > 1 else 0)
        spans = (border, row + 0.5), (row - 0.5, border)
        for design, (bottom, top) in zip(designs, spans, strict=False):
            status = Status(int(design["status"]))
            value = float(design[name]) if name in design else np.nan
            valid = status is Status.ok and np.isfinite(value)
            look: Look = (
                {"facecolor": colours.to_rgba(np.array(value))} if valid else cells.MARKS[status]
            )
            ink = style.ink_on(look["facecolor"])
            if design is designs[0]:
                at: Look = {"xytext": (3, -3), "textcoords": "offset points", "va": "top"}
                # Of a mark the name hides the hatching.
                box = None if valid else {"fc": "white", "ec": "none", "pad": 0.8}
                at |= {"fontsize": 6, "color": ink, "zorder": 4, "bbox": box}
                axes.annotate(cells.design_name(design), (column - 0.5, row + 0.5), **at)
            shown = text(float(value), design) if valid else ""
            letters: Look = {"fontsize": 7.5 if len(designs) == 1 else 6, "linespacing": 0.95}
            cells.cell(axes, row, column, shown, (bottom, top), letters, **look)
            if not valid:
                marked.add(status)
            elif is_measured(design):
                inset, frame = 0.015, cells.MEASURED | {"edgecolor": ink}
                corner = column - 0.5 + inset, bottom + inset
                size = 1 - 2 * inset, top - bottom - 2 * inset
                axes.add_patch(Rectangle(corner, *size, fill=False, **frame))
    cells.name_columns_and_rows(axes, [f"{p:g}" for p in periods], list(map(str, stripes)))
    axes.set(xlabel=cells.PERIODS_LABEL, ylabel="n_stripe: stitches\nacross a rib stripe")
    style.colour_bar(axes, colours, pad=0.01, label=label)
    return marked


def _notes(name: str, design: xr.Dataset) -> list[str]:
    """Notes on a value of a design; each begins with its mark."""
    last = float(design["applied_strain"].max())
    notes = [str(MARKS[mark]) for mark, where in marked(design, [name]).items() if where]
    if name == "poisson_ratio_min" and float(design["applied_strain_at_min"]) >= last > 0:
        notes.append(LAST)
    if name == "working_range" and "working_start" in design:
        end = float(design["working_start"] + design["working_range"])
        notes += [ENDS] if end >= last - 1e-9 else []
    return notes


def value_marks(name: str, design: xr.Dataset) -> str:
    """The marks of a value of a design, which :func:`explained` explains."""
    return "".join(note[0] for note in _notes(name, design))


def explained(names: Sequence[str], designs: Iterable[xr.Dataset]) -> list[str]:
    """The notes on some values of designs, each once, in the order of the marks of tables."""
    shown = {note for design in designs for name in names for note in _notes(name, design)}
    return [note for note in (*map(str, MARKS.values()), LAST, ENDS) if note in shown]


def row_count(designs: Sequence[xr.Dataset]) -> int:
    """Number of rows of a map of designs."""
    return len({int(design["n_stripe"]) for design in designs})
