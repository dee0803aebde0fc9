"""Spread over perturbed copies: small if the fabric has one branch, large if it has several."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from knitlab.observables.spread import branches, extremes
from knitlab.runs.plan import make_plan
from knitlab.runs.run import run_plan
from knitlab.runs.run_options import RunOptions
from knitlab.solvers.perturbed_copies import perturbed_copy


def cube_of(tmp_path, *settings, workflow="periodic"):
    return run_plan(make_plan(workflow, settings), tmp_path, RunOptions()).cube


def case_of(*settings):
    return next(iter(make_plan("periodic", settings).cases.values()))


@pytest.mark.slow
def test_a_fabric_with_one_branch_has_little_spread(tmp_path):
    flat = "cell_size=flat", "contact=none", "z_max=1.9", "n_stripe=8", "n_subunit=32"
    cube = cube_of(tmp_path, "strain_max=0.09", *flat, "robustness=3").squeeze()
    assert float(cube["relaxed_branches"]) == 1
    assert (cube["siblings"] == 3).all()
    spread = (cube["poisson_ratio_high"] - cube["poisson_ratio_low"]).max()
    assert 0.005 < float(spread) < 0.06
    for name in ("poisson_ratio", "reaction_force"):
        own = cube[name].dropna("applied_strain")
        assert (cube[f"{name}_low"] <= own).all()
        assert (cube[f"{name}_high"] >= own).all()
    assert cube.attrs["random_seeds"].startswith("1 to 3")


@pytest.mark.slow
@pytest.mark.nightly
def test_a_copy_of_a_clamped_sample_begins_from_the_other_start(tmp_path):
    settings = ("boundary=clamped", "unit_cells=2,2", "n_stripe=4", "n_subunit=8")
    cube = cube_of(tmp_path, *settings, "strain_max=0.06", "robustness=1").squeeze()
    assert (cube["siblings"] == 1).all()
    case = case_of(*settings, "robustness=2")
    assert case.equilibrium_solver.start == "dynamics"
    assert [perturbed_copy(case, k).equilibrium_solver.start for k in (1, 2)] == [
        "flat",
        "dynamics",
    ]


@given(st.integers(1, 50))
def test_a_copy_has_every_stripe_parameter_changed_by_two_percent_at_most(number):
    case = case_of("n_stripe=4", "n_subunit=16")
    one, same = perturbed_copy(case, number), perturbed_copy(case, number)
    assert one == same
    for stripe, original in ((one.weft, case.weft), (one.warp, case.warp)):
        for name in ("period", "k_s", "k_t", "theta_0"):
            part = getattr(stripe, name) / getattr(original, name) - 1
            assert 0 < abs(part) <= 0.02


def test_the_second_of_two_copies_differs_the_other_way():
    case = case_of("n_stripe=4", "n_subunit=16")
    one, other = perturbed_copy(case, 3), perturbed_copy(case, 4)
    for name in ("period", "k_s", "k_t"):
        original = getattr(case.weft, name)
        assert getattr(one.weft, name) + getattr(other.weft, name) == pytest.approx(2 * original)


@given(st.lists(st.integers(1, 9), min_size=1, max_size=8), st.data())
def test_branches_are_the_distinct_energies(whole, data):
    noise = data.draw(st.lists(st.floats(-1, 1), min_size=len(whole), max_size=len(whole)))
    energies = [value * (1 + 1e-8 * part) for value, part in zip(whole, noise, strict=True)]
    assert branches([*energies, float("nan")]) == len(set(whole))
    assert branches([float("nan")]) == 0


def test_a_copy_counts_up_to_the_strain_that_it_reached():
    own, short = np.array([np.nan, -0.3, -0.2]), np.array([np.nan, -0.4])
    low, high, count = extremes(own, [short])
    assert count.tolist() == [0, 1, 0]
    assert low.tolist()[1:] == [-0.4, -0.2]
    assert high.tolist()[1:] == [-0.3, -0.2]


def test_copies_by_dynamics_are_refused():
    plan = make_plan("periodic", ("method=dynamics", "robustness=2"))
    assert {case.robustness for case in plan.cases.values()} == {0}
    assert any("robustness = 2" in warning for warning in plan.warnings)
