"""Intersections: closed forms, and the collision library ipctk pair by pair."""

import itertools

import ipctk
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from knitlab.model.cell_grid import nodes_at
from knitlab.model.fabric import Configuration
from knitlab.model.network import MeshShape, mesh_shape
from knitlab.model.surfaces import self_intersections
from tests.fabrics import patch_map

TRIANGLES = [[0, 1, 2], [2, 3, 0]]


def sheet(boundary: str, periods: int = 1) -> MeshShape:
    return mesh_shape(patch_map(["R"], periods), boundary)


def configuration(nodes: np.ndarray, period: tuple[float, float] = (0.0, 0.0)) -> Configuration:
    """Of a single state."""
    return Configuration(nodes[None], np.array([period], float))


def extruded(shape: MeshShape, profile: np.ndarray) -> np.ndarray:
    """A sheet whose every row is one curve in the plane of x and z."""
    nodes = np.zeros((shape.nodes_y, shape.nodes_x, 3))
    nodes[..., [0, 2]] = profile
    nodes[..., 1] = np.arange(shape.nodes_y)[:, None]
    return nodes


def pairs_by_library(shape: MeshShape, state: Configuration, reach: int) -> int:
    """Pairs of cells that intersect, each pair given to ipctk as a separate mesh."""
    rows = np.arange(-reach * shape.cells_y, (reach + 1) * shape.cells_y + 1)
    columns = np.arange(-reach * shape.cells_x, (reach + 1) * shape.cells_x + 1)
    nodes = np.asarray(nodes_at(shape, state, rows, columns))
    cells = list(itertools.product(range(len(rows) - 1), range(len(columns) - 1)))
    home = [
        cell
        for cell in cells
        if cell[0] // shape.cells_y == reach and cell[1] // shape.cells_x == reach
    ]
    found = 0.0
    for one, other in itertools.product(home, cells):
        if one != other and library_says(nodes, one, other):
            # Two cells of a period are a pair in both orders, and so are a cell and an image.
            found += 0.5
    return round(found)


def library_says(nodes: np.ndarray, *cells: tuple[int, int]) -> bool:
    places: dict[tuple[int, int], int] = {}
    faces = []
    for row, column in cells:
        corners = [(row, column), (row, column + 1), (row + 1, column + 1), (row + 1, column)]
        numbers = [places.setdefault(corner, len(places)) for corner in corners]
        faces += [[numbers[k] for k in triangle] for triangle in TRIANGLES]
    vertices = np.array([nodes[place] for place in places])
    mesh = ipctk.CollisionMesh(vertices, ipctk.edges(np.array(faces)), np.array(faces))
    return bool(ipctk.has_intersections(mesh, vertices))


def test_a_flat_sheet_and_a_zigzag_do_not_intersect():
    shape = sheet("clamped", periods=2)
    along = np.arange(shape.nodes_x)
    flat = extruded(shape, np.stack([along, 0 * along], axis=-1))
    folded = extruded(shape, np.stack([0.1 * along, along % 2], axis=-1))
    both = Configuration(np.stack([flat, folded]), np.zeros((2, 2)))
    assert self_intersections(shape, both) == [0, 0]


def test_a_sheet_that_loops_through_itself_intersects_once_per_row():
    shape = sheet("clamped")
    loop = np.array([[0, 0], [2, 0], [2, 1], [1, 1], [1, -1]])
    assert shape.nodes_x == len(loop)
    found = self_intersections(shape, configuration(extruded(shape, loop)))
    assert found == [shape.cells_y]


@pytest.mark.parametrize(("height", "pairs"), [(0.001, 1), (0.0, 0), (-0.001, 0)])
def test_touching_is_not_passing_through(height, pairs):
    shape = sheet("clamped")
    loop = np.array([[0, 0], [2, 0], [2, 1], [1, 1], [1, -height]])
    found = self_intersections(shape, configuration(extruded(shape, loop)))
    assert found == [pairs * shape.cells_y]


def test_periodic_fabric_longer_than_its_period_intersects_its_image():
    shape = sheet("periodic")
    row = np.array([[0, 0], [0.5, 0.5], [1, 0], [0.2, 0.6]])
    nodes = extruded(shape, row) + np.random.default_rng(1).normal(scale=1e-3, size=(4, 4, 3))
    state = configuration(nodes, (0.7, 4.0))
    found = self_intersections(shape, state)
    assert found == [pairs_by_library(shape, state[0], 2)]
    assert found > [0]


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from(["clamped", "periodic"]))
def test_every_pair_is_one_that_the_library_finds(seed, boundary):
    rng = np.random.default_rng(seed)
    shape = sheet(boundary)
    steps = np.indices((shape.nodes_y, shape.nodes_x)).transpose(1, 2, 0)[..., ::-1]
    nodes = np.concatenate([steps, np.zeros((*steps.shape[:2], 1))], axis=-1)
    nodes = nodes + rng.normal(scale=rng.choice([0.2, 0.35, 0.5]), size=nodes.shape)
    state = configuration(nodes, (shape.nodes_x, shape.nodes_y))
    reach = 1 if shape.periodic else 0
    assert self_intersections(shape, state) == [pairs_by_library(shape, state[0], reach)]


@given(st.integers(0, 2**32 - 1))
def test_a_turned_and_moved_sheet_intersects_as_often(seed):
    rng = np.random.default_rng(seed)
    shape = sheet("clamped", periods=2)
    nodes = rng.normal(size=(shape.nodes_y, shape.nodes_x, 3))
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    moved = nodes @ turn + rng.normal(size=3)
    both = Configuration(np.stack([nodes, moved]), np.zeros((2, 2)))
    assert len(set(self_intersections(shape, both))) == 1
