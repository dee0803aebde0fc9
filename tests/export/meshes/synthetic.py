"""Sheets and tests of known shape, for meshes of them; nothing is simulated."""

import base64
import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import xarray as xr
from hypothesis import strategies as st

from knitlab.cubes.case_file import read_case
from knitlab.export.meshes.formats import FORMATS
from knitlab.model.cell_grid import CellGrid
from knitlab.model.fabric import flat_sheet
from knitlab.solvers.case import Case, case_of

PREVIEW = Path(__file__).parents[3] / "results" / "reference" / "periodic"
(CASE_ID,) = (path.stem for path in (PREVIEW / "cases").glob("4-16-*.nc"))
"""Periodic fabric of (4, 16): 16 × 16 grid cells."""


VTK_TYPES = {"Float64": "<f8", "Int64": "<i8", "UInt8": "u1", "Int32": "<i4", "Float32": "<f4"}


def write_meshes(shapes, path):
    """Files of shapes in the format of a suffix."""
    return FORMATS[path.suffix.lower()].write(shapes, path)


def vtu_arrays(path: Path) -> dict[tuple[str, str], np.ndarray]:
    """Arrays of a .vtu file by their group and name."""
    arrays = {}
    for group in ElementTree.parse(path).getroot().find("UnstructuredGrid/Piece"):
        for array in group:
            content = base64.b64decode(array.text)
            assert int.from_bytes(content[:8], "little") == len(content) - 8
            values = np.frombuffer(content[8:], VTK_TYPES[array.get("type")])
            components = int(array.get("NumberOfComponents"))
            if components > 1 and group.tag != "Cells":
                values = values.reshape(-1, components)
            arrays[group.tag, array.get("Name")] = values
    return arrays


@cache
def kept_file() -> xr.Dataset:
    return read_case(PREVIEW, CASE_ID)


@cache
def kept_case() -> Case:
    return case_of(json.loads(kept_file().attrs["parameters"]))


def sample(case: Case) -> Case:
    """The fabric of a case between clamps, 1 × 2 unit cells."""
    return replace(case, options=replace(case.options, boundary="clamped"), unit_cells=(1, 2))


def flat_test(case: Case, stretch: tuple[float, float] = (1.0, 1.0)) -> xr.Dataset:
    """A test of a flat fabric that is stretched by factors along (x, y) at its second strain."""
    flat = flat_sheet(*case.assemble())
    factors = np.array([[1, 1, 1], [*stretch, 1]])
    positions = factors[:, None, None] * np.asarray(flat.positions)
    lengths = factors[:, :2] * np.asarray(flat.lengths)
    cells: CellGrid = case.cell_grid
    strains = {
        name: (("applied_strain", "cell_y", "cell_x"), np.stack([0 * of_cells, of_cells]))
        for name, of_cells in zip(
            ("strain_xx", "strain_yy"),
            np.random.default_rng(0).random((2, *cells.count)),
            strict=True,
        )
    }
    sides = {"length_x": lengths[:, 0], "length_y": lengths[:, 1]}
    return xr.Dataset(
        {
            "status": 1,
            "self_intersections": ("applied_strain", [0.0, 0.0]),
            "position": (("applied_strain", "node_y", "node_x", "component"), positions),
            **{name: ("applied_strain", side) for name, side in sides.items()},
            **strains,
        },
        {"applied_strain": [0.0, 0.1], "component": ["x", "y", "z"]},
        {"parameters": json.dumps(case.record), "title": "synthetic case"},
    ).drop_vars(() if case.mesh_shape.periodic else ("length_x", "length_y"))


def zigzag(cells: tuple[int, int], half: float, width: float = 0.7) -> np.ndarray:
    """Nodes of a sheet of planes that lean by ± an angle along x in turn, ridges along y [mm]."""
    rows, columns = np.mgrid[: cells[0] + 1, : cells[1] + 1]
    lean = columns * width * np.cos(half), rows * 1.3, columns % 2 * width * np.sin(half)
    return np.stack(lean, axis=-1)


def arch(cells: tuple[int, int], turn: float, width: float = 0.7) -> np.ndarray:
    """Nodes of a sheet that bends by the same angle at every line along y, upwards [mm]."""
    lean = turn * (np.arange(cells[1]) - (cells[1] - 1) / 2)
    x, z = (
        np.concatenate([[0], np.cumsum(width * of(lean))]) for of in (np.cos, lambda a: -np.sin(a))
    )
    y = 1.3 * np.arange(cells[0] + 1)
    x, y = np.meshgrid(x, y)
    return np.stack([x, y, np.broadcast_to(z, x.shape)], axis=-1)


@st.composite
def bumpy_sheets(draw: st.DrawFn) -> np.ndarray:
    """Nodes of sheets of any size whose nodes are moved by up to a quarter of a cell [mm]."""
    shape = draw(st.tuples(st.integers(1, 6), st.integers(1, 6)))
    seed = draw(st.integers(0, 2**32 - 1))
    rows, columns = np.mgrid[: shape[0] + 1, : shape[1] + 1]
    flat = np.stack([columns * 1.0, rows * 1.0, 0.0 * rows], axis=-1)
    return flat + np.random.default_rng(seed).uniform(-0.25, 0.25, flat.shape)
