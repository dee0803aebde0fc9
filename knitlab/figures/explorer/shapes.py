"""Shapes of designs, from their case files, packed as text that a browser unpacks by itself."""

import base64
import zlib
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Float

from knitlab.cubes.case_file import length_unit

if TYPE_CHECKING:
    from knitlab.model.pattern import PatchGrid
    from knitlab.solvers.case import Case

MAX_NODES = 4096  # of a large sample that are shown: those of the paper's largest unit cell
NO_POSITIONS = "Its case file holds no node positions, so that there is no shape."
NO_STATE = "No state of it was reached, so that there is no shape."
LEVELS = (1 << 12) - 1
MIN_STEP = 1e-9  # step of a component that does not vary [mm]


class Window(NamedTuple):
    """First and last grid lines of a fabric that are shown, with a note if others are not."""

    rows: tuple[int, int]
    columns: tuple[int, int]
    note: str = ""


def shape_content(case: xr.Dataset, strains: np.ndarray) -> dict[str, Any] | str:
    """The shape of a case at strains of the cube, or a sentence that says why there is none."""
    if "position" not in case:
        return NO_POSITIONS
    nodes = case["position"].transpose("applied_strain", "node_y", "node_x", "component").values
    reached = np.isfinite(nodes).all(axis=(1, 2, 3))
    if not reached.any():
        return NO_STATE
    # JAX is imported only for this.
    from knitlab.cubes.recorded_case import recorded_case

    recorded = recorded_case(case)
    periodic = recorded.options.boundary == "periodic"
    window = _window(recorded)
    (bottom, top), (left, right) = window.rows, window.columns
    ends = 0 if periodic else 1
    along = case["applied_strain"].values[reached]
    lengths = [case[f"length_{axis}"].values[reached] for axis in ("x", "y") if periodic]
    if "length_shear" in case:
        lengths.append(case["length_shear"].values[reached])
    return {
        "rows": top - bottom + ends,
        "columns": right - left + ends,
        "frames": np.abs(along[:, None] - strains).argmin(axis=1).tolist(),
        **pack_positions(nodes[reached, bottom : top + ends, left : right + ends]),
        "periods": np.stack(lengths, axis=1).tolist() if periodic else None,
        "note": window.note,
        "unit": length_unit(case),
        **_patches(recorded.sample, window),
        "electrodes": _electrodes(recorded, window),
    }


def pack_positions(positions: Float[np.ndarray, "strain node_y node_x 3"]) -> dict[str, Any]:
    """Positions at every strain, none of them missing, as text, with what unpacks them [mm].

    Every component (x, y, z) is rounded to 4096 levels, from ``origin`` on in steps of ``step``.
    Second differences along the strain are small, as fabric moves almost steadily; interleaved with
    their sign, split into low and high bytes and deflated, they take a third of a byte each. They
    are in the order strain, component, row, column; before the first strain everything is 0.
    """
    nodes = (0, 1, 2)
    origin = positions.min(axis=nodes)
    step = np.maximum(np.ptp(positions, axis=nodes) / LEVELS, MIN_STEP)
    levels = np.moveaxis(np.rint((positions - origin) / step).astype(np.int32), -1, 1)
    differences = np.diff(levels, n=2, axis=0, prepend=np.zeros_like(levels[:1]).repeat(2, axis=0))
    # Of small numbers without a sign nearly all high bytes are 0.
    unsigned = ((differences << 1) ^ (differences >> 31)).astype(np.uint16)
    low, high = (half.astype(np.uint8).tobytes() for half in (unsigned & 0xFF, unsigned >> 8))
    return {
        "origin": origin.tolist(),
        "step": step.tolist(),
        "error": (step / 2).tolist(),
        "positions": base64.b64encode(zlib.compress(low + high, 9)).decode("ascii"),
    }


def _window(case: "Case") -> Window:
    """All of a fabric, or of a large sample the central unit cells."""
    sample, (along_y, along_x) = case.sample, case.unit_cells
    height, width = sample.grid
    if case.options.boundary == "periodic" or (height + 1) * (width + 1) <= MAX_NODES:
        return Window((0, height), (0, width))
    # A unit cell of a graded fabric may be as large as the sample.
    fraction = (MAX_NODES / (height * width)) ** 0.5
    rows, shown_y = _central(sample.row_borders, along_y, fraction)
    columns, shown_x = _central(sample.column_borders, along_x, fraction)
    note = f"central {shown_y} × {shown_x} of {along_y} × {along_x} unit cells (warp × weft)"
    return Window(rows, columns, note)


def _central(borders: np.ndarray, count: int, fraction: float) -> tuple[tuple[int, int], int]:
    """Grid lines of the central ones of ``count`` unit cells, and their number."""
    lines = borders[:: (len(borders) - 1) // count]
    shown = max(1, int(count * fraction))
    first = (count - shown) // 2
    return (int(lines[first]), int(lines[first + shown])), shown


def _patches(sample: "PatchGrid", window: Window) -> dict[str, Any]:
    patches: dict[str, Any] = {}
    kept = []
    for name, (first, last) in (("row_borders", window.rows), ("column_borders", window.columns)):
        borders = getattr(sample, name)
        within = (borders >= first) & (borders <= last)
        patches[name] = (borders[within] - first).tolist()
        kept.append(np.flatnonzero(within)[:-1])
    return {**patches, "knit": ["".join(row) for row in sample.knit[np.ix_(*kept)]]}


def _electrodes(case: "Case", window: Window) -> dict[str, Any] | None:
    if case.capacitor is None:
        return None
    x, y = window.columns[0], window.rows[0]
    strips = [
        [[one.left - x, one.right - x, one.bottom - y, one.top - y] for one in electrode_strips]
        for electrode_strips in case.electrodes.strips
    ]
    return {"along": case.electrodes.along, "strips": strips}
