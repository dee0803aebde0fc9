"""Shapes of designs, from their case files."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from knitlab.explorer.page import Content
from knitlab.explorer.positions import pack_positions

if TYPE_CHECKING:
    from knitlab.fabric.pattern import PatchGrid

MOST_NODES = 4096
"""Largest number of nodes of a large sample that are shown: of the paper's largest unit cell."""
NO_POSITIONS = "Its case file holds no node positions, so that there is no shape."
NO_STATE = "No state of it was reached, so that there is no shape."


@dataclass(frozen=True)
class Window:
    """Grid cells of a fabric that are shown.

    Attributes:
        rows, columns: first and last grid line along the warp and along the weft.
        note: which part of the fabric it is; empty if it is the whole.
    """

    rows: tuple[int, int]
    columns: tuple[int, int]
    note: str = ""


def shape_of(case: xr.Dataset, strains: np.ndarray) -> Content | str:
    """The shape of a design for the page, or a sentence that says why there is none.

    Args:
        case: contents of its case file.
        strains: applied strains of the cube [1].
    """
    if "position" not in case:
        return NO_POSITIONS
    nodes = case["position"].transpose("applied_strain", "node_y", "node_x", "component").values
    reached = np.isfinite(nodes).all(axis=(1, 2, 3))
    if not reached.any():
        return NO_STATE
    return _content(case, nodes[reached], reached, strains)


def _content(
    case: xr.Dataset, nodes: np.ndarray, reached: np.ndarray, strains: np.ndarray
) -> Content:
    # JAX is imported only for this.
    from knitlab.fabric.pattern import recorded_pattern

    record = json.loads(case.attrs["parameters"])
    sample = recorded_pattern(record)
    periodic = record["reading"]["boundary"] == "periodic"
    window = _window(sample, record, periodic)
    (bottom, top), (left, right) = window.rows, window.columns
    ends = 0 if periodic else 1
    packed = pack_positions(nodes[:, bottom : top + ends, left : right + ends])
    along = case["applied_strain"].values[reached]
    lengths = ["length_x", "length_y"]
    return {
        "rows": top - bottom + ends,
        "columns": right - left + ends,
        "frames": np.abs(along[:, None] - strains).argmin(axis=1).tolist(),
        "origin": packed.origin,
        "step": packed.step,
        "error": packed.error,
        "positions": packed.text,
        "periods": (
            np.stack([case[name].values[reached] for name in lengths], axis=1).tolist()
            if periodic
            else None
        ),
        "note": window.note,
        **_patches(sample, window),
        "electrodes": _electrodes(record, window),
    }


def _window(sample: "PatchGrid", record: Mapping[str, Any], periodic: bool) -> Window:
    """The whole fabric, or of a large sample the central unit cells."""
    height, width = sample.grid
    if periodic or (height + 1) * (width + 1) <= MOST_NODES:
        return Window((0, height), (0, width))
    # A unit cell of a graded fabric may be as large as the whole.
    along_y, along_x = record["unit_cells"]
    part = (MOST_NODES / (height * width)) ** 0.5
    rows, shown_y = _central(sample.row_borders, along_y, part)
    columns, shown_x = _central(sample.column_borders, along_x, part)
    note = f"central {shown_y} × {shown_x} of {along_y} × {along_x} unit cells (warp × weft)"
    return Window(rows, columns, note)


def _central(borders: np.ndarray, count: int, part: float) -> tuple[tuple[int, int], int]:
    """Grid lines of the central ones of ``count`` unit cells, and their number."""
    lines = borders[:: (len(borders) - 1) // count]
    shown = max(1, int(count * part))
    first = (count - shown) // 2
    return (int(lines[first]), int(lines[first + shown])), shown


def _patches(sample: "PatchGrid", window: Window) -> Content:
    """Knit and borders of the patches of a window, in its own grid lines."""
    found: Content = {}
    kept = []
    for name, borders, (first, last) in (
        ("row_borders", sample.row_borders, window.rows),
        ("column_borders", sample.column_borders, window.columns),
    ):
        within = (borders >= first) & (borders <= last)
        found[name] = (borders[within] - first).tolist()
        kept.append(np.flatnonzero(within)[:-1])
    return {**found, "knit": ["".join(row) for row in sample.knit[np.ix_(*kept)]]}


def _electrodes(record: Mapping[str, Any], window: Window) -> Content | None:
    """What both electrodes run along, and their strips [left, right, bottom, top] in a window."""
    if not record.get("capacitor"):
        return None
    from pydantic import ValidationError

    from knitlab.simulation.case import case_of

    try:
        electrodes = case_of(dict(record)).electrodes
    except ValidationError:
        return None  # a case of another version, whose record this one does not know
    x, y = window.columns[0], window.rows[0]
    strips = [
        [[one.left - x, one.right - x, one.bottom - y, one.top - y] for one in of_electrode]
        for of_electrode in electrodes.strips
    ]
    return {"along": electrodes.along, "strips": strips}
