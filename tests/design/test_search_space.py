"""The search space: its points, and the stripe parameters that follow from them."""

from dataclasses import asdict
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from knitlab.design.request import checked_request
from knitlab.design.search_space import search_space
from knitlab.observables.case_variables import STRIPE_PARAMETERS
from tests.refusals import refused

VARY = {
    "n_stripe": [4, 8],
    "n_subunit": [16, 32],
    "rib_k_t": [0.001, 0.1],
    "garter_k_s_factor": [0.5, 2.0],
    "theta_0_factor": [0.8, 1.2],
    "k_t_factor": [0.9, 1.1],
    "stitch_width": [1.0, 1.75],
}


def space(targets="poisson_ratio = -0.3 @ 0.05:0.25", **changes):
    return search_space(checked_request("sleeve", {"targets": [targets], "vary": VARY, **changes}))


def logarithms(case, gauge):
    """Logarithm of every parameter that the variables change."""
    stripes = {"weft": asdict(case.weft), "warp": asdict(case.warp)}
    numbers = [stripes[side][name] for side, name in STRIPE_PARAMETERS.values()]
    return np.log([*numbers, *asdict(gauge).values()])


def test_impossible_designs_are_left_out_and_the_test_ends_at_the_largest_strain_of_the_targets():
    searched = space()
    assert searched.designs == ((4, 16), (4, 32), (8, 16), (8, 32))
    case, _ = searched.case((4, 16), np.full(5, 0.5))
    assert case.applied_strain[-1] == pytest.approx(0.27)
    assert case.robustness == 0


usual_space = cache(space)


@given(st.lists(st.floats(0, 1), min_size=5, max_size=5))
def test_a_point_is_found_again_from_its_values(fractions):
    searched = usual_space()
    point = np.array(fractions)
    np.testing.assert_allclose(searched.point(searched.values(point)), point, atol=1e-12)


def test_stripe_parameters_follow_from_the_place_in_the_search_space():
    searched, middle = space(), np.full(5, 0.5)
    before = logarithms(*searched.case((4, 16), middle))
    for variable in range(5):
        moved = middle.copy()
        moved[variable] += 0.25
        change = (logarithms(*searched.case((4, 16), moved)) - before) / 0.25
        np.testing.assert_allclose(change, searched.parameter_slopes()[:, variable], atol=1e-9)


def test_a_search_starts_from_the_tables():
    searched = space()
    case, gauge = searched.case((8, 32), searched.start((8, 32)))
    np.testing.assert_allclose(logarithms(case, gauge), logarithms(*searched.case((8, 32))))


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"vary": {"n_stripe": [3], "n_subunit": [16]}}, "n_stripe"),
        ({"vary": {"rib_theta_0_factor": [0.8, 9.0]}}, "below pi"),
        ({"settings": {"strain_max": 0.12}}, "0.25"),
        ({"workflow": "prewiew"}, "did you mean 'preview'"),
    ],
)
def test_an_invalid_search_space_is_refused(changes, word):
    with refused(word):
        space(**changes)
