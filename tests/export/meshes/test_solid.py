"""Solids of sheets: closed, outside out, and as thick as asked."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from knitlab.export.meshes.surface import (
    MITRE_LIMIT,
    grid_surface,
    largest_thickness,
    mitred_normals,
    solid_of,
)
from tests.export.meshes.synthetic import arch, bumpy_sheets, zigzag
from tests.export.meshes.test_surface import as_trimesh
from tests.refusals import refused

CELLS = (3, 6)
AREA = 3 * 1.3 * 6 * 0.7
"""Of :func:`zigzag` and :func:`arch` of these cells [mm²]."""


@given(bumpy_sheets(), st.floats(0.05, 0.95))
def test_a_solid_is_closed_and_outside_out(nodes, part):
    sheet = grid_surface(nodes)
    solid = solid_of(sheet, part * largest_thickness(sheet))
    for each in (solid, solid.triangulated()):
        body = as_trimesh(each)
        assert body.is_watertight
        assert body.is_winding_consistent
        assert body.euler_number == 2  # a ball
        assert body.volume > 0
    edges, _ = sheet.rim()
    assert len(solid.faces) == 2 * len(sheet.faces) + len(edges)
    assert len(solid.nodes) == 2 * len(sheet.nodes)


@pytest.mark.parametrize("nodes", [zigzag(CELLS, 0.0), zigzag(CELLS, 1.1), arch(CELLS, 0.5)])
def test_the_volume_of_a_bent_sheet_is_area_times_thickness(nodes):
    # With mitred folds a plane loses on one side what it gains on the other.
    solid = solid_of(grid_surface(nodes), 0.2)
    assert as_trimesh(solid).volume == pytest.approx(AREA * 0.2, rel=1e-12)


def test_flanks_are_as_thick_as_asked_up_to_the_fold():
    half, thickness = 1.1, 0.2
    sheet = grid_surface(zigzag(CELLS, half))
    solid = solid_of(sheet, thickness)
    count = len(sheet.faces)
    over, under = solid.nodes[solid.faces[:count]], solid.nodes[solid.faces[count : 2 * count]]
    normals = np.cross(over[:, 1] - over[:, 0], over[:, 2] - over[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    assert ((over[:, :1] - under) * normals[:, None]).sum(-1) == pytest.approx(thickness, abs=1e-12)


def test_a_fold_sharper_than_the_mitre_limit_is_cut_off():
    sheet = grid_surface(zigzag(CELLS, np.radians(80)))
    reach = np.linalg.norm(mitred_normals(sheet), axis=1).reshape(4, 7)
    assert reach[:, 1:-1] == pytest.approx(MITRE_LIMIT)
    assert reach[:, [0, -1]] == pytest.approx(1)


@pytest.mark.parametrize("turn", [0.5, 0.8])
def test_the_inner_side_of_an_arch_limits_its_thickness(turn):
    # Of a plane between two folds of one sense, twice s tan(turn/2) is lost on the inner side.
    sheet = grid_surface(arch(CELLS, turn))
    assert largest_thickness(sheet) == pytest.approx(0.7 / np.tan(turn / 2), rel=1e-9)


def test_the_inner_side_of_an_arch_turns_over_beyond_its_limit():
    sheet = grid_surface(arch(CELLS, 0.8))
    most = largest_thickness(sheet)
    volume = as_trimesh(solid_of(sheet, 0.999 * most)).volume
    assert volume == pytest.approx(AREA * 0.999 * most, rel=1e-9)
    with refused("thickness", "1.6 mm"):
        solid_of(sheet, 1.001 * most)


def test_a_flat_sheet_is_at_most_as_thick_as_it_is_wide():
    assert largest_thickness(grid_surface(zigzag(CELLS, 0.0))) == pytest.approx(3.9)


@pytest.mark.parametrize("thickness", [0.0, -1.0, np.nan])
def test_a_thickness_is_above_0(thickness):
    with refused("thickness", "above 0"):
        solid_of(grid_surface(zigzag(CELLS, 0.3)), thickness)


def test_a_sheet_with_a_crushed_cell_and_a_closed_fold_is_still_closed():
    nodes = zigzag(CELLS, 0.3)
    nodes[:, 3] = nodes[:, 2]
    nodes[0, -1] = nodes[0, -3]
    sheet = grid_surface(nodes)
    body = as_trimesh(solid_of(sheet, largest_thickness(sheet) / 2))
    assert np.isfinite(body.vertices).all()
    assert body.is_watertight


def test_fields_are_on_both_sides_and_on_the_wall():
    sheet = grid_surface(
        zigzag((1, 2), 0.3), {"node": np.arange(6.0)}, {"face": np.array([[7, 8]])}
    )
    solid = solid_of(sheet, 0.1)
    assert solid.node_fields["node"].tolist() == [*range(6), *range(6)]
    assert solid.face_fields["face"][:4].tolist() == [7, 8, 7, 8]
    # Of the wall, each face lies beside its face of the sheet: three sides of either.
    walls = solid.nodes[solid.faces[4:]][..., 0].mean(axis=1)
    assert (solid.face_fields["face"][4:] == np.where(walls < 0.7 * np.cos(0.3), 7, 8)).all()
