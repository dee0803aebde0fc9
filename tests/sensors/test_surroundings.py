"""A dielectric between electrodes, and a grounded plane below them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from knitlab.observables.capacitance.boundary_elements import VACUUM_PERMITTIVITY
from tests.sensors.conductors import (
    bent,
    between,
    crowded,
    extrapolated,
    maxwell,
    plate,
    sphere,
    strips,
)

LENGTH = 4.0
"""Period of periodic conductors [mm]."""
OF_A_SPHERE = 4 * np.pi * VACUUM_PERMITTIVITY


def square(count=6, height=0.0):
    return plate([0, 0, height], [1, 0, 0], [0, 1, 0], crowded(count), crowded(count))


def two_strips():
    ends = [[(0.3, 0.1), (1.2, 0.5)], [(-0.3, 0.0), (-1.4, 0.3)]]
    return [bent(panels) for panels in strips(ends, 12, LENGTH)]


@pytest.mark.parametrize("thickness", [0.05, 0.4])
def test_touching_plates_are_those_that_the_dielectric_keeps_apart(thickness):
    found = maxwell(square(), square(), apart=thickness)
    np.testing.assert_allclose(found, maxwell(square(), square(height=thickness)), rtol=1e-4)


@pytest.mark.slow
def test_far_images_are_kept_apart_too():
    """Wide strips at a dielectric of their width: by images, as by a long finite pair."""
    ends = [(-0.5, 0.0), (0.5, 0.0)]
    assert between(*strips([ends, ends], 12, LENGTH), period=LENGTH, apart=1.0) == pytest.approx(
        between(*strips([ends, [(x, 1.0) for x, _ in ends]], 12, LENGTH), period=LENGTH), rel=1e-5
    )


@pytest.mark.slow
@pytest.mark.parametrize("height", [1.5, 4.0])
def test_a_sphere_above_a_plane_has_the_series_of_its_mirror_charges(height):
    angle, number = np.arccosh(height), np.arange(1, 200)
    exact = OF_A_SPHERE * np.sinh(angle) * (1 / np.sinh(number * angle)).sum()
    found = extrapolated(*(maxwell(sphere(count), ground=-height)[0, 0] for count in (3, 6)))
    assert found == pytest.approx(exact, rel=3e-3)


@pytest.mark.slow
@pytest.mark.parametrize("period", [None, pytest.param(LENGTH, marks=pytest.mark.slow)])
def test_a_plane_acts_as_mirrored_conductors_of_opposite_potential(period):
    """Up to which pairs of panels are near enough for the closed form, which is not the same."""
    pair, height = two_strips(), -0.4
    mirrored = [panels * [1, 1, -1] + [0, 0, 2 * height] for panels in pair]
    both = maxwell(*pair, *mirrored, period=period)
    expected = both[:2, :2] - both[:2, 2:]
    np.testing.assert_allclose(maxwell(*pair, period=period, ground=height), expected, rtol=1e-4)


@pytest.mark.slow
@settings(max_examples=8)
@given(st.floats(0.05, 5.0), st.floats(1.1, 3.0))
def test_a_nearer_plane_gives_more_capacitance_and_less_of_it_mutual(distance, factor):
    """An isolated conductor always adds to the capacitance; a guarded one shields."""
    pair = two_strips()
    lowest = min(panels[..., 2].min() for panels in pair)
    near, far = (maxwell(*pair, ground=lowest - d) for d in (distance, factor * distance))
    floating = [(m[0, 0] * m[1, 1] - m[0, 1] ** 2) / m.sum() for m in (near, far)]
    assert floating[0] > floating[1]
    assert -near[0, 1] < -far[0, 1]
