import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from knitlab.cubes.comparison import compared, difference
from knitlab.io.errors import InputError
from tests.cubes.artificial_cubes import synthetic_cube

NUMBER = st.floats(-10, 10)


@given(st.lists(st.tuples(NUMBER, NUMBER), min_size=1, max_size=9), st.floats(0.1, 5))
def test_the_difference_is_a_mean_square_that_scales(pairs, factor):
    one, other = np.array(pairs).T
    found = difference(one, other, np.full(len(one), 0.1))
    assert found.rms_difference == pytest.approx(np.linalg.norm(one - other) / len(one) ** 0.5)
    scaled = difference(factor * one, factor * other, np.full(len(one), factor * 0.1))
    assert scaled.rms_difference == pytest.approx(factor * found.rms_difference)
    assert scaled.uncertainty == pytest.approx(factor * found.uncertainty, rel=1e-6)


def test_the_uncertainty_is_what_noise_makes_of_the_difference():
    random = np.random.default_rng(0)
    strain = np.linspace(0, 1, 20)
    simulated, truth, error = strain**2, strain**2 + 0.3 * strain, 0.02
    found = [
        difference(simulated, truth + random.normal(0, error, 20), np.full(20, error))
        for _ in range(2000)
    ]
    rms = [each.rms_difference for each in found]
    assert np.std(rms) == pytest.approx(np.mean([each.uncertainty for each in found]), rel=0.05)


def test_two_measurements_of_one_curve_differ_by_the_noise():
    random = np.random.default_rng(0)
    noise = random.normal(0, 0.1, (500, 40))
    found = [difference(np.zeros(40), row, np.full(40, 0.1)) for row in noise]
    assert np.mean([each.rms_difference for each in found]) == pytest.approx(
        found[0].noise, rel=0.02
    )


def test_only_strains_that_both_have_count():
    gap = np.array([1.0, np.nan, 3.0, 4.0])
    other = np.array([1.5, 2.0, 3.5, np.nan])
    found = difference(gap, other, np.full(4, np.nan))
    assert (found.strains, found.rms_difference) == (2, 0.5)
    assert np.isnan(found.uncertainty)
    assert difference(gap[1:2], other[1:2], np.zeros(1)) is None


def measured_cube():
    """(4, 16) with the same ratios but 0.1 more, of a sample twice as wide, at other strains."""
    cube = synthetic_cube().sel(n_stripe=[4], n_subunit=[16])
    cube = cube.interp(applied_strain=[0.0, 0.125, 0.15, 0.2]).assign_coords(source="bench 3")
    cube["poisson_ratio"] += 0.1
    cube["poisson_ratio_error"] = cube["poisson_ratio"] * 0 + 0.01
    cube["reaction_force"] = 4.0 * cube["applied_strain"] + 0 * cube["poisson_ratio"]
    cube["status"] = cube["status"].astype(np.int8)
    cube.attrs["parameters"] = '{"unit_cells": [4, 6]}'
    return cube


def simulated_cube():
    cube = synthetic_cube()
    grid = (*cube["status"].dims, "applied_strain", "cell_y", "cell_x")
    cube["strain_yy"] = grid, np.zeros((*cube["status"].shape, 3, 4, 3))
    cube["reaction_force"] = 2.0 * cube["applied_strain"] + 0 * cube["poisson_ratio"]
    return cube


def test_curves_are_compared_at_the_measured_strains_and_forces_for_one_width():
    table = compared(simulated_cube(), [measured_cube()]).set_index("variable")
    assert table.loc["poisson_ratio", "source"] == "bench 3"
    assert table.loc["poisson_ratio", "strains"] == 3
    assert table.loc["poisson_ratio", "rms_difference"] == pytest.approx(0.1)
    assert table.loc["poisson_ratio", "noise"] == pytest.approx(0.01)
    assert table.loc["reaction_force", "rms_difference"] == pytest.approx(0.0, abs=1e-12)
    assert table.loc["reaction_force", "units"] == "N"


def test_cubes_that_cannot_be_compared_are_refused():
    with pytest.raises(InputError, match="bench 3"):
        compared(measured_cube(), [measured_cube()])
    with pytest.raises(InputError, match="experiments"):
        compared(simulated_cube(), [simulated_cube()])
    other = simulated_cube().sel(n_stripe=[2])
    with pytest.raises(InputError, match="other cubes"):
        compared(other, [measured_cube()])
