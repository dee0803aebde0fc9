import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from knitlab.lab.tracks.grid import NoGrid, find_grid, placed_grid

SETTINGS = settings(max_examples=50, deadline=None)


@st.composite
def distorted_grids(draw):
    """Points of a distorted grid, shuffled and with some missing, and the place of each."""
    rows, columns = draw(st.integers(3, 12)), draw(st.integers(3, 12))
    width = draw(st.floats(2, 50))
    height = width * draw(st.floats(0.6, 1.7))
    turn, shear = np.radians(draw(st.floats(-30, 30))), draw(st.floats(-0.1, 0.1))
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    place = np.stack(np.mgrid[:rows, :columns], axis=-1).reshape(-1, 2)
    y, x = (place * [height, width]).T
    points = np.stack([x + shear * y, y], axis=1)
    # A smooth distortion that stretches and shears cells by up to about 10 %, and a random one.
    least = min(width, height)
    wave = 2 * np.pi / (max(width, height) * draw(st.floats(6, 15)))
    amount = draw(st.floats(0, 0.1)) / wave
    points += amount * np.sin(wave * points[:, ::-1] + random.uniform(0, 6, 2))
    points += random.normal(0, 0.02 * least, points.shape)
    points = points @ [[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]
    points += random.uniform(-1000, 1000, 2)
    order = random.permutation(len(points))
    lost = random.permutation(len(points))[: draw(st.integers(0, max(1, len(points) // 12)))]
    points[lost] = np.nan
    return points[order], place[order]


@pytest.mark.slow
@SETTINGS
@given(distorted_grids())
def test_every_marker_finds_its_place(grid):
    points, place = grid
    found = find_grid(points)
    seen = np.isfinite(points).all(axis=1)
    assert found.strays == ()
    rows_columns = np.argwhere(found.marker >= 0)
    markers = found.marker[tuple(rows_columns.T)]
    assert sorted(markers) == sorted(np.flatnonzero(seen))
    # A whole row or column at the edge may be missing, which cannot be detected.
    np.testing.assert_array_equal(rows_columns, place[markers] - place[seen].min(axis=0))


def lattice(rows=5, columns=4):
    return np.stack(np.mgrid[:columns, :rows][::1], axis=-1).swapaxes(0, 1).reshape(-1, 2) * 10.0


def test_stray_markers_are_ignored():
    found = find_grid(np.concatenate([lattice(), [[14.0, 26.0], [200.0, 3.0]]]))
    assert found.strays == (20, 21)
    assert found.marker.shape == (5, 4)


def test_the_grid_continues_around_a_gap_wider_than_a_step():
    points = lattice(7, 7)
    hole = (abs(points - 30).max(axis=1)) < 15
    points[hole] = np.nan
    found = find_grid(points)
    assert (found.marker < 0).sum() == hole.sum() == 9
    np.testing.assert_array_equal(np.argwhere(found.marker < 0).min(axis=0), [2, 2])


def test_corners_follow_the_markers():
    points = lattice()
    tracks = np.stack([points, points + 1.0])
    tracks[1, 7] = np.nan
    corners = find_grid(points).corners(tracks)
    np.testing.assert_allclose(corners[0, 2, 3], [30.0, 20.0])
    assert np.isnan(corners[1]).any(axis=-1).sum() == 1
    assert np.isnan(corners[1, 1, 3]).all()


@pytest.mark.parametrize(
    ("points", "problem"),
    [
        (lattice()[:3], "3 markers are seen"),
        (np.full((9, 2), np.nan), "0 markers are seen"),
        (lattice(1, 9), "in one line"),
        (np.concatenate([lattice(), lattice()[:1]]), "at one point"),
        (np.random.default_rng(3).uniform(0, 100, (40, 2)), "table"),
    ],
)
def test_markers_that_form_no_grid_are_refused(points, problem):
    with pytest.raises(NoGrid, match=problem):
        find_grid(points)


def test_a_table_of_places_is_taken_as_it_is():
    rows, columns = np.array([1, 0, -1, 0]), np.array([0, 0, -1, 2])
    found = placed_grid(rows, columns)
    np.testing.assert_array_equal(found.marker, [[1, -1, 3], [0, -1, -1]])
    assert found.strays == (2,)
    with pytest.raises(NoGrid, match="markers 0 and 1 are both in row 1, column 0"):
        placed_grid(np.array([1, 1]), np.array([0, 0]))
