from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from hypothesis import example, given, settings
from hypothesis import strategies as st

from knitlab.io.errors import InputError
from knitlab.lab.description import MarkersTable, SampleTable
from knitlab.lab.experiment import import_records
from knitlab.lab.markers import (
    MarkedSample,
    along_pull,
    in_fabric_axes,
    marker_values,
    read_marked,
)
from knitlab.lab.tracks.grid import find_grid
from knitlab.observables.unit_cells import deformation_gradient, lattice_vectors
from tests.lab.recorded import CAMERA, CELLS, NU, Laboratory, positions
from workflows.laboratory.make_synthetic import Camera

PATH = Path("markers.npy")
LENGTH = {"value": 0.1, "unit": "mm"}
SAMPLE = SampleTable.model_validate(
    {
        "n_stripe": 4,
        "n_subunit": 16,
        "unit_cells": CELLS,
        "length": {"value": 80.0, "unit": "mm"},
        "width": {"value": 45.0, "unit": "mm"},
    }
)


def table(**changes):
    each = {"file": "markers.npy", "pixel": LENGTH, "strain_per_frame": 0.01}
    return MarkersTable.model_validate(each | changes)


@pytest.mark.slow
@settings(max_examples=30, deadline=None)
@example(1.0, 1.0, 0, 0, 0.5)  # the middle does not move at all
@given(
    st.floats(-30, 30),
    st.floats(0.01, 10),
    st.integers(0, 2**32 - 1),
    st.integers(0, 2),
    st.sampled_from([0.0, 0.5]),
)
def test_turned_and_missing_markers_give_the_same_strains(turn, pixel, seed, missing, still):
    random = np.random.default_rng(seed)
    strain = np.linspace(0, 0.3, 31)
    corners = positions(strain, still)
    count = corners[0, ..., 0].size
    camera = Camera(pixel, np.radians(turn), (200.0, 900.0), 0.0)
    # A corner of the sample without a marker removes one unit cell and its place in the grid.
    order = random.permutation(np.setdiff1d(np.arange(count), [0, count - 1][:missing]))
    tracks = camera.sees(corners.reshape(31, -1, 2), random)[:, order]
    fabric = in_fabric_axes(tracks * [1, -1], table(pixel={"value": pixel, "unit": "mm"}))
    grid = find_grid(fabric[0])
    marked = MarkedSample(grid.corners(fabric[:1])[0], grid.corners(fabric), grid, 1, CELLS, strain)
    marked = along_pull(PATH, marked, strain)
    assert np.degrees(marked.turn) == pytest.approx(turn, abs=1e-6)
    values = marker_values(marked, strain[::5], strain, np.arange(31))
    lost = np.isnan(values["strain_xx"])
    np.testing.assert_array_equal(lost.sum(axis=(1, 2)), missing)
    for name, slope in (("xx", -NU), ("yy", 1.0)):
        expected = np.where(lost, np.nan, slope * strain[::5][:, None, None])
        np.testing.assert_allclose(values[f"strain_{name}"], expected, atol=1e-9)
        np.testing.assert_allclose(values[f"mean_strain_{name}"], slope * strain[::5], atol=1e-9)
    np.testing.assert_allclose(values["poisson_ratio"][1:], NU, atol=1e-6)
    assert values["relaxed_cell_x"] == pytest.approx(15.0)
    assert values["relaxed_cell_y"] == pytest.approx(20.0)


@settings(max_examples=50, deadline=None)
@given(st.lists(st.floats(-0.3, 0.3), min_size=4, max_size=4), st.integers(0, 2**32 - 1))
def test_an_affine_motion_gives_its_gradient_exactly(entries, seed):
    gradient = np.eye(2) + np.reshape(entries, (2, 2))
    random = np.random.default_rng(seed)
    points = positions(np.zeros(1))[0] + random.uniform(-2, 2, (*np.add(CELLS, 1), 2))
    order = random.permutation(points[..., 0].size)
    grid = find_grid(points.reshape(-1, 2)[order])
    moved = (points @ gradient.T + random.uniform(-50, 50, 2)).reshape(-1, 2)[order]
    corners = grid.corners(np.stack([points.reshape(-1, 2)[order], moved]))
    found = deformation_gradient(lattice_vectors(corners[0]), lattice_vectors(corners[1]))
    np.testing.assert_allclose(found, np.broadcast_to(gradient, found.shape), atol=1e-10)


def test_a_lost_marker_removes_only_its_own_quadrilaterals_and_is_counted():
    strain = np.linspace(0, 0.3, 61)
    corners = positions(strain)
    lost = corners.copy()
    # In the middle of the sample, from 10 % to 20 %.
    lost[20:41, 2, 1] = np.nan
    grid = find_grid(corners[0].reshape(-1, 2))
    at = np.linspace(0, 0.3, 13)
    marked = MarkedSample(corners[0], lost, grid, 1, CELLS, np.arange(61.0))
    values = marker_values(marked, at, strain, np.arange(61))
    gone = (at > 0.12) & (at < 0.18)
    np.testing.assert_array_equal(values["cells_lost"][gone], 4)
    np.testing.assert_array_equal(values["markers_lost"][gone], 1)
    np.testing.assert_array_equal(values["cells_lost"][at < 0.09], 0)
    missing = np.isnan(values["strain_yy"][gone])
    np.testing.assert_array_equal(
        missing[0], [[False] * 3, [True, True, False], [True, True, False], [False] * 3]
    )
    # The central cells, column 1 of rows 1 and 2, are both among them: there is no mean.
    both = np.isnan(values["strain_yy"][:, 1:3, 1]).all(axis=1)
    np.testing.assert_array_equal(np.isnan(values["mean_strain_yy"]), both)


@pytest.mark.slow
@pytest.mark.nightly
def test_errors_of_strains_are_those_of_the_noise(tmp_path):
    astray = {name: [] for name in ("xx", "yy")}
    for seed in range(40):
        laboratory = Laboratory(
            tmp_path / str(seed),
            camera=replace(CAMERA, noise=0.3, turn=0.1),
            random=np.random.default_rng(seed),
            frame_rate=10.0,
        )
        description = laboratory.description()
        description["markers"]["relaxed_frames"] = 20
        cube = import_records("markers", laboratory.write(description), tmp_path).cube.squeeze()
        strain = cube["applied_strain"].values
        for name, slope in (("xx", -NU), ("yy", 1.0)):
            error = cube[f"mean_strain_{name}"].values - slope * strain
            astray[name].append(error / cube[f"mean_strain_{name}_error"].values)
    for values in astray.values():
        assert 0.8 < np.std(values) < 1.25


@pytest.mark.parametrize(
    ("weft", "warp", "turned"),
    [("right", "up", 0.0), ("down", "right", -90.0), ("left", "up", 0.0), ("right", "up", 90.0)],
)
def test_axes_are_those_that_the_description_gives(weft, warp, turned):
    points = np.array([[[0.0, 0.0], [10.0, 0.0], [0.0, 20.0]]])
    each = table(weft=weft, warp=warp)
    # The same fabric, photographed with its axes as described.
    in_picture = {"right": [1, 0], "left": [-1, 0], "up": [0, -1], "down": [0, 1]}
    pixels = points @ np.array([in_picture[weft], in_picture[warp]]) / 0.1
    np.testing.assert_allclose(in_fabric_axes(pixels, each), points, atol=1e-12)
    camera = Camera(0.1, np.radians(turned), (0.0, 0.0), 0.0)
    seen = camera.sees(points, np.random.default_rng(0)) * [1, -1]
    np.testing.assert_allclose(in_fabric_axes(seen, table(turned=turned)), points, atol=1e-12)


def test_every_second_marker_may_be_a_corner_and_places_may_be_given(tmp_path):
    fine = np.stack(np.mgrid[:9, :7][::-1], axis=-1).reshape(-1, 2) * [7.5, 10.0]
    np.save(tmp_path / "markers.npy", np.stack([fine, fine * [1.05, 1.1]]) / 0.1)
    marked = read_marked(tmp_path, table(markers_per_cell=[2, 2]), SAMPLE)
    assert marked.relaxed.shape == (5, 4, 2)
    rows, columns = np.divmod(np.arange(63), 7)
    lines = [f"{m},{r},{c}" for m, (r, c) in enumerate(zip(rows, columns, strict=True))]
    (tmp_path / "places.csv").write_text("\n".join(["marker,row,column", *lines]))
    given = read_marked(tmp_path, table(markers_per_cell=[2, 2], places="places.csv"), SAMPLE)
    np.testing.assert_allclose(given.relaxed, marked.relaxed)


@pytest.mark.parametrize("align", ["picture", "pull"])
def test_coordinates_in_the_order_row_and_column_are_refused(tmp_path, align):
    """A square sample, which is pulled along y to 0.2 and grows wider by half as much."""
    strain = np.linspace(0, 0.2, 21)[:, None, None]
    y, x = np.mgrid[:3, :3] * 12.5
    shown = np.stack([(x - 12.5) * (1 + strain / 2), y * (1 + strain)], axis=-1) / 0.05
    tracks = shown.reshape(21, 9, 2) + 900.0
    description = {
        "title": "a square",
        "sample": SAMPLE.model_dump() | {"unit_cells": (2, 2)},
        "protocol": {"strain_max": 0.2, "strain_step": 0.05},
        "markers": {"file": "markers.npy", "pixel": {"value": 0.05, "unit": "mm"}},
    }
    side = {"value": 25.0, "unit": "mm"}
    description["sample"] |= {"length": side, "width": side}
    description["markers"] |= {"strain_per_frame": 0.01, "align": align}
    path = tmp_path / "square.toml"
    path.write_text(tomli_w.dumps(description))
    np.save(tmp_path / "markers.npy", tracks)
    cube = import_records("markers", path, tmp_path / "right").cube.squeeze()
    np.testing.assert_allclose(cube["poisson_ratio"][1:], -0.5)
    np.save(tmp_path / "markers.npy", tracks[..., ::-1])
    with pytest.raises(InputError, match=r"pulled along its weft|off the separation|from the warp"):
        import_records("markers", path, tmp_path / "wrong")
