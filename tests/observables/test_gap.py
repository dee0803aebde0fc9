import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from knitlab.model.surfaces import crossings, gap_between, segment_distance, triangle_distance

SEED = st.integers(0, 10_000)
FAR = 100.0
STEPS = np.linspace(0, 1, 41)


def found_by_minimising(one, other):
    """Shortest distance between triangles, as a convex problem of the positions on both."""

    def squared(place):
        apart = (1 - place[0] - place[1]) * one[0] + place[:2] @ one[1:]
        apart = apart - (1 - place[2] - place[3]) * other[0] - place[2:] @ other[1:]
        return apart @ apart

    within = [{"type": "ineq", "fun": lambda p, k=k: 1 - p[k] - p[k + 1]} for k in (0, 2)]
    best = minimize(
        squared,
        np.full(4, 1 / 3),
        method="SLSQP",
        bounds=[(0, 1)] * 4,
        constraints=within,
        options={"ftol": 1e-15, "maxiter": 500},
    )
    return np.sqrt(best.fun)


def sampled(triangle):
    """Points distributed over a triangle."""
    u, v = (part.ravel() for part in np.meshgrid(STEPS, STEPS))
    u, v = u[u + v <= 1], v[u + v <= 1]
    return (
        triangle[0]
        + u[:, None] * (triangle[1] - triangle[0])
        + v[:, None] * (triangle[2] - triangle[0])
    )


def pair(seed):
    """Two triangles side by side, which do not intersect."""
    random = np.random.default_rng(seed)
    one, other = random.normal(size=(2, 3, 3))
    apart = random.normal(size=3)
    apart /= np.linalg.norm(apart)
    clear = (one @ apart).max() - (other @ apart).min()
    return one, other + (clear + random.exponential(0.5)) * apart


def square(corner=(0.0, 0.0, 0.0), one=(1.0, 0.0, 0.0), other=(0.0, 1.0, 0.0), count=3):
    corner, one, other = map(np.asarray, (corner, one, other))
    steps = np.arange(count) / count
    return np.array(
        [
            [start, start + one / count, start + (one + other) / count, start + other / count]
            for start in (corner + u * one + v * other for u in steps for v in steps)
        ]
    )


def gap(one, other, reach=FAR):
    return gap_between(one, other, reach)


def turned(panels, turn):
    return turn.apply(panels.reshape(-1, 3)).reshape(panels.shape)


def folded_strip(outline):
    """A strip along y on an outline of points (x, z), of one panel each."""
    (x, z), length = np.array(outline, float).T, 2.0
    line = np.stack([x, 0 * x, z], axis=-1)
    back = line + np.array([0, length, 0])
    return np.stack([line[:-1], line[1:], back[1:], back[:-1]], axis=1)


@pytest.mark.slow
@given(SEED)
@settings(max_examples=60)
def test_the_distance_of_triangles_is_the_smallest_of_their_points(seed):
    one, other = pair(seed)
    found = triangle_distance(one[None], other[None])[0]
    assert found == pytest.approx(found_by_minimising(one, other), abs=1e-5)
    between = np.linalg.norm(sampled(one)[:, None] - sampled(other)[None], axis=-1)
    spacing = max(np.ptp(one, axis=0).max(), np.ptp(other, axis=0).max()) * 3 / len(STEPS)
    assert found - 1e-12 <= between.min() <= found + spacing


@given(SEED, SEED)
def test_the_distance_of_triangles_does_not_depend_on_their_order(seed, motion):
    one, other = pair(seed)
    turn, random = Rotation.random(rng=motion), np.random.default_rng(motion)
    moved = [turn.apply(each[random.permutation(3)]) + motion % 7 for each in (other, one)]
    assert triangle_distance(moved[0][None], moved[1][None])[0] == pytest.approx(
        triangle_distance(one[None], other[None])[0], abs=1e-9
    )


@pytest.mark.slow
@given(SEED)
def test_the_distance_of_many_equals_that_of_each(seed):
    one, other = (np.array(each) for each in zip(*map(pair, range(seed, seed + 5)), strict=True))
    alone = [triangle_distance(*each)[0] for each in zip(one[:, None], other[:, None], strict=True)]
    assert triangle_distance(one, other).tolist() == alone


@pytest.mark.parametrize(
    ("other", "exact"),
    [
        ([[0.2, 0.2, 0.5], [0.3, 0.2, 2], [0.2, 0.3, 2]], 0.5),
        ([[2, 0, 0], [3, 0, 0], [3, 1, 0]], 1.0),
        ([[1, 1, -1], [1, 1, 1], [2, 2, 0]], np.sqrt(0.5)),
        ([[0, 0, 0.3], [1, 0, 0.3], [0, 1, 0.3]], 0.3),
        ([[1, 0, 0], [2, 0, 0], [2, 1, 0]], 0.0),
        ([[0.5, 0.25, 0], [0.5, 0.25, 2], [0.6, 0.25, 2]], 0.0),
    ],
    ids=["corner to face", "corner to corner", "edge to edge", "parallel", "touching", "on it"],
)
def test_triangles_have_their_distance(other, exact):
    one = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]])
    other = np.array([other], float)
    assert triangle_distance(one, other)[0] == pytest.approx(exact, abs=1e-15)
    assert triangle_distance(other, one)[0] == pytest.approx(exact, abs=1e-15)


@pytest.mark.parametrize("thin", [[[1, 0, 1]] * 3, [[1, 0, 1], [2, 0, 1], [4, 0, 1]]])
def test_triangles_without_area_have_their_distance(thin):
    one = np.array([[[0.0, 0, 0], [2, 0, 0], [0, 2, 0]]])
    assert triangle_distance(one, np.array([thin], float))[0] == pytest.approx(1)


@given(st.floats(-2, 3), st.floats(-2, 3), st.floats(0.01, 5))
def test_parallel_segments_have_their_distance(start, end, height):
    low, high = sorted((start, end))
    along = max(low - 1, -high, 0)
    found = segment_distance(
        np.zeros(3), np.array([1.0, 0, 0]), np.array([start, height, 0]), np.array([end, height, 0])
    )
    assert float(found) == pytest.approx(np.hypot(along, height), rel=1e-6)


@given(st.floats(0.01, 20), SEED)
@settings(max_examples=20)
def test_the_gap_of_parallel_squares_is_their_distance(distance, motion):
    turn = Rotation.random(rng=motion)
    one, other = (turned(square((0, 0, height)), turn) for height in (0, distance))
    assert gap(one, other) == pytest.approx(distance, rel=1e-9)


@given(SEED)
@settings(max_examples=20)
def test_the_gap_is_the_same_from_either_side(seed):
    random = np.random.default_rng(seed)
    one = square(*random.normal(size=(3, 3)))
    other = square(*random.normal(size=(3, 3))) + 2.0
    assert gap(one, other) == pytest.approx(gap(other, one), rel=1e-12)


@given(SEED)
@settings(max_examples=20)
def test_the_gap_does_not_depend_on_the_panel_size(seed):
    random = np.random.default_rng(seed)
    one, other = random.normal(size=(2, 3, 3))
    other[0] += [4, 0, 0]
    coarse, fine = (gap(square(*one, count), square(*other, count)) for count in (1, 4))
    assert fine == pytest.approx(coarse, abs=1e-9)


@pytest.mark.parametrize(
    ("other", "expected"),
    [
        (square((1.5, 0.25, 0)), 0.5),
        (square((0.4, 0.35, -0.5), (0, 0, 1), (0.1, 0.1, 0)), 0),
        (square((1.0, 0, 0), (0, 0, 1)), 0),
        (square(), 0),
    ],
    ids=["beside each other", "crossing", "touching", "in each other"],
)
def test_the_gap_of_squares_is_that_of_their_nearest_points(other, expected):
    assert gap(square(), other) == pytest.approx(expected)
    assert gap(other, square()) == pytest.approx(expected)


@pytest.mark.parametrize("reach", [0.1, 1.9])
def test_the_gap_is_limited_to_the_search_distance(reach):
    assert gap(square(), square((0, 0, 2.0)), reach) == reach


ZIGZAG = [(0, 0), (1, 4), (2, 0), (3, 4), (4, 0)]


@pytest.mark.parametrize("motion", range(3))
@pytest.mark.parametrize(("end", "crosses"), [(1.1, False), (0.9, True), (0.0, True)])
def test_a_strip_that_comes_back_through_itself_crosses_itself(end, crosses, motion):
    outline = [(0, 0), (2, 4), (4, 4), (4, 2), (end, 2)]
    panels = turned(folded_strip(outline), Rotation.random(rng=motion))
    assert (crossings(panels) > 0) == crosses
    assert (crossings(panels[::-1]) > 0) == crosses


AT_A_CORNER = square((1.0, 1.0, 0), (1.0, 0, 1.0), (0, 1.0, 0), count=1)
APART = {
    **{f"zigzag {k}": turned(folded_strip(ZIGZAG), Rotation.random(rng=k)) for k in range(3)},
    "tightly folded": folded_strip([(1e-3 * x, z) for x, z in ZIGZAG]),
    **{
        f"neighbours at {angle}": folded_strip([(-1, 0), (0, 0), (-np.cos(angle), np.sin(angle))])
        for angle in (0.0, 0.5, 2.0, 3.1)
    },
    "neighbours at a corner": np.concatenate([square(count=1), AT_A_CORNER]),
    "flat": square(count=5),
}


@pytest.mark.parametrize("panels", APART.values(), ids=APART)
def test_surfaces_that_at_most_touch_do_not_cross(panels):
    assert not crossings(panels)
