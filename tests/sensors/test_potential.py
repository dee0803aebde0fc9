import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import dblquad
from scipy.spatial.transform import Rotation

from knitlab.observables.capacitance.boundary_elements import triangle_potential

RIGHT = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 3.0, 0.0]])
SEED = st.integers(0, 10_000)


def potential(at, corners):
    return np.asarray(triangle_potential(np.asarray(at, float).T, np.moveaxis(corners, 0, -1)))


def one_potential(at, corners):
    return float(triangle_potential(np.asarray(at, float), np.asarray(corners, float)))


def integrated(at, corners):
    first, second, third = corners
    scale = np.linalg.norm(np.cross(second - first, third - first))

    def inverse_distance(v, u):
        return 1 / np.linalg.norm(first + u * (second - first) + v * (third - first) - at)

    return scale * dblquad(inverse_distance, 0, 1, 0, lambda u: 1 - u, epsabs=1e-12)[0]


def area(corners):
    return np.linalg.norm(np.cross(corners[1] - corners[0], corners[2] - corners[0])) / 2


def placed(seed, in_plane=False):
    """A triangle that is not too thin, and a point that may lie in its plane."""
    random = np.random.default_rng(seed)
    corners = random.normal(size=(3, 3))
    while area(corners) < 0.3:
        corners = random.normal(size=(3, 3))
    if in_plane:
        return random.normal(size=3) @ corners / 2 + corners.mean(axis=0) / 2, corners
    return random.normal(size=3), corners


@pytest.mark.slow
@pytest.mark.parametrize("height", [0.2, -0.7, 3.0])
@pytest.mark.parametrize("foot", [(1.0, 0.5), (0.0, 0.0), (1.5, 1.5), (-2.0, 4.0)])
def test_the_potential_off_the_plane_is_the_integral(foot, height):
    corners = np.array([[0.2, -0.4, 0.0], [2.9, 0.3, 0.0], [0.6, 2.2, 0.0]])
    at = np.array([*foot, height])
    assert one_potential(at, corners) == pytest.approx(integrated(at, corners), rel=1e-8)


@pytest.mark.parametrize("seed", range(6))
def test_the_potential_of_any_triangle_is_the_integral(seed):
    at, corners = placed(seed)
    assert one_potential(at, corners) == pytest.approx(integrated(at, corners), rel=1e-7)


@pytest.mark.parametrize(
    ("corner", "exact"),
    [
        (0, 3 * np.sqrt(2) * np.log(1 + np.sqrt(2))),
        (1, 3 * np.log(1 + np.sqrt(2))),
        (2, 3 * np.log(1 + np.sqrt(2))),
    ],
)
def test_the_potential_at_the_corners_of_a_right_triangle_has_closed_forms(corner, exact):
    assert one_potential(RIGHT[corner], RIGHT) == pytest.approx(exact, rel=1e-14)


@given(SEED, st.floats(0.05, 0.95), st.booleans())
def test_the_parts_of_a_triangle_add_up(seed, part, in_plane):
    at, (first, second, third) = placed(seed, in_plane)
    cut = (1 - part) * second + part * third
    whole, one, other = (
        one_potential(at, np.array(corners))
        for corners in ((first, second, third), (first, second, cut), (first, cut, third))
    )
    assert one + other == pytest.approx(whole, rel=1e-8)


@pytest.mark.parametrize("on", [(0.4, 0.6, 0.0), (0.5, 0.5, 0.0), (0.2, 0.3, 0.5), (1.0, 0.0, 0.0)])
def test_the_parts_of_a_triangle_add_up_where_they_meet(on):
    at = on @ RIGHT
    cut = (RIGHT[0] + RIGHT[1]) / 2
    halves = [RIGHT[[0, 2]], RIGHT[[2, 1]]]
    parts = sum(one_potential(at, np.array([cut, *half])) for half in halves)
    assert np.isfinite(parts)
    assert parts == pytest.approx(one_potential(at, RIGHT), rel=1e-12)


@pytest.mark.parametrize(
    "corners",
    [
        [[0, 0, 0], [1, 2, 3], [2, 4, 6]],
        [[0, 0, 0], [0, 0, 0], [2, 4, 6]],
        [[1, 1, 1], [1, 1, 1], [1, 1, 1]],
    ],
    ids=["line", "segment", "point"],
)
@pytest.mark.parametrize("at", [(0.3, 0.0, 0.0), (0.0, 0.0, 0.0), (1.0, 2.0, 3.0), (1.0, 1.0, 1.0)])
def test_a_triangle_without_area_has_no_potential(corners, at):
    assert one_potential(at, corners) == pytest.approx(0, abs=1e-12)


def test_far_away_the_potential_is_that_of_a_point_charge():
    away = Rotation.random(20, rng=0).apply([1.0, 0, 0])
    for distance, most in ((30, 3e-3), (300, 3e-5), (3000, 3e-7)):
        found = potential(RIGHT.mean(axis=0) + distance * away, np.repeat(RIGHT[None], 20, axis=0))
        assert np.abs(found / (area(RIGHT) / distance) - 1).max() < most


@pytest.mark.slow
def test_on_either_face_the_field_is_that_of_its_charge():
    slope = jax.grad(triangle_potential)
    for side in (1, -1):
        above = np.asarray(slope(np.array([0.9, 0.8, side * 1e-7]), RIGHT))
        assert above[2] == pytest.approx(-side * 2 * np.pi, rel=1e-6)
