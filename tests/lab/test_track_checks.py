"""Tracked markers: what no fabric does is left out, and nothing else is."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from knitlab.lab.tracks.checks import predicted_by_neighbours, without_implausible

STEP = np.array([8.0, 10.0])


def fabric(rows, columns, frames, strain, bulge, noise, random):
    """Corners of a sample that is pulled along y and bulges between its clamps [mm]."""
    y, x = np.mgrid[:rows, :columns].astype(float)
    relaxed = np.stack([x, y], axis=-1) * STEP
    pull = np.linspace(0, strain, frames)[:, None, None]
    middle = (columns - 1) / 2
    wider = 1 + pull * bulge * np.sin(np.pi * y / (rows - 1))
    shown = np.stack([(middle + (x - middle) * wider), y * (1 + pull)], axis=-1) * STEP
    return relaxed, shown + random.normal(0, noise * STEP.min(), shown.shape)


cases = st.fixed_dictionaries(
    {
        "rows": st.integers(4, 12),
        "columns": st.integers(3, 8),
        "frames": st.integers(8, 40),
        "strain": st.floats(0.05, 0.6),
        "bulge": st.floats(-0.3, 0.8),
        "noise": st.floats(0, 0.02),
        "seed": st.integers(0, 2**32 - 1),
    }
)


def made(case):
    case = dict(case)
    random = np.random.default_rng(case.pop("seed"))
    return *fabric(**case, random=random), random


@given(cases)
def test_a_fabric_loses_no_marker(case):
    relaxed, corners, _ = made(case)
    kept, dropped = without_implausible(relaxed, corners)
    assert not dropped
    np.testing.assert_array_equal(kept, corners)


@given(cases, st.sampled_from(["jump", "origin", "swap", "on neighbour"]))
def test_what_a_tracker_confuses_is_left_out_from_that_frame_on(case, confusion):
    relaxed, corners, random = made(case)
    frames, rows, columns, _ = corners.shape
    frame = int(random.integers(1, frames))
    row, column = int(random.integers(rows)), int(random.integers(columns - 1))
    confused, wrong = corners.copy(), {(row, column)}
    if confusion == "jump":
        turn = random.uniform(0, 2 * np.pi)
        away = random.uniform(0.7, 5) * STEP.max()
        confused[frame:, row, column] += away * np.array([np.cos(turn), np.sin(turn)])
    elif confusion == "origin":
        confused[frame:, row, column] = -500.0
    elif confusion == "swap":
        other = row, column + 1
        wrong |= {other}
        confused[frame:, row, column] = corners[frame:, row, column + 1]
        confused[frame:, row, column + 1] = corners[frame:, row, column]
    else:
        confused[frame:, row, column] = confused[frame:, row, column + 1]
    kept, dropped = without_implausible(relaxed, confused)
    assert {(each.row, each.column) for each in dropped} == wrong
    assert {each.frame for each in dropped} == {frame}
    expected = corners.copy()
    for marker in wrong:
        expected[(slice(frame, None), *marker)] = np.nan
    np.testing.assert_array_equal(kept, expected)


def test_a_marker_that_stands_still_while_its_neighbours_move_is_left_out():
    relaxed, corners = fabric(6, 4, 30, 0.4, 0.5, 0.0, np.random.default_rng(0))
    stuck = corners.copy()
    stuck[10:, 3, 2] = stuck[10, 3, 2]
    kept, dropped = without_implausible(relaxed, stuck)
    assert [each[:3] for each in dropped] == [(3, 2, 11)]
    assert "stands still" in dropped[0].reason
    assert np.isnan(kept[11:, 3, 2]).all()
    # A whole row in a clamp stands still too, and is kept.
    assert np.isfinite(kept[:, 0]).all()


@pytest.mark.parametrize(
    ("towards", "wrong", "reason"),
    [
        ((-2.2, -1.6), {(3, 3)}, "turns a unit cell over"),
        ((1.0, 0.0), {(3, 3), (3, 4)}, "coincides"),
    ],
)
def test_a_marker_that_drifts_slowly_is_left_out(towards, wrong, reason):
    relaxed, corners = fabric(7, 6, 60, 0.2, 0.5, 0.0, np.random.default_rng(0))
    astray = corners.copy()
    away = towards * STEP if towards[1] else corners[:, 3, 4] - corners[:, 3, 3]
    astray[:, 3, 3] += np.linspace(0, 1, 60)[:, None] * away
    kept, dropped = without_implausible(relaxed, astray)
    assert {each[:2] for each in dropped} == wrong
    assert reason in dropped[-1].reason
    assert np.isnan(kept).all(axis=-1).any(axis=0).sum() == len(wrong)


@given(st.integers(0, 2**32 - 1))
def test_affine_deformation_has_no_departure(seed):
    random = np.random.default_rng(seed)
    y, x = np.mgrid[:5, :4].astype(float)
    moved = np.stack([x, y], axis=-1) @ random.normal(size=(2, 2)) + random.normal(size=2)
    expected = moved.copy()
    moved[2, 1] = np.nan
    np.testing.assert_allclose(predicted_by_neighbours(moved), expected, atol=1e-12)


@pytest.mark.parametrize("shape", [(2, 2), (2, 3), (3, 2)])
def test_few_markers_are_checked_as_far_as_they_determine_each_other(shape):
    relaxed, corners = fabric(3, 3, 20, 0.3, 0.0, 0.0, np.random.default_rng(0))
    rows, columns = shape
    relaxed, corners = relaxed[:rows, :columns], corners[:, :rows, :columns]
    assert not without_implausible(relaxed, corners)[1]
    astray = corners.copy()
    astray[8:, 0, 0] = 500.0
    kept, dropped = without_implausible(relaxed, astray)
    assert dropped
    assert not np.isfinite(kept[8:, :2, :2]).all()
