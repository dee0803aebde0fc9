"""Requests of designs: their contents, and every mistake with its position."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from knitlab.cubes.strain_window import REDUCTIONS
from knitlab.cubes.target import read_target
from knitlab.design.request import (
    WITHIN_RANGE,
    checked_request,
    contradictions,
    read_request,
    with_tolerance,
)
from knitlab.io.errors import InputError
from tests.refusals import refused

TARGET = "poisson_ratio = -0.3 @ 0.05:0.25"


def request(**changes):
    return checked_request("sleeve", {"targets": [TARGET], **changes})


@pytest.mark.parametrize(
    ("one", "other", "contradictory"),
    [
        ("poisson_ratio < -0.3 @ 0.05:0.25", "poisson_ratio > -0.2 @ 0.2:0.4", True),
        ("poisson_ratio < -0.3 @ 0.05:0.15", "poisson_ratio > -0.2 @ 0.2:0.4", False),
        ("poisson_ratio < -0.2 @ 0.05:0.25", "poisson_ratio > -0.3 @ 0.2:0.4", False),
        ("poisson_ratio = -0.3 ± 0.06 @ 0.1", "poisson_ratio > -0.25 @ 0.05:0.2", False),
        ("poisson_ratio = -0.3 ± 0.04 @ 0.1", "poisson_ratio > -0.25 @ 0.05:0.2", True),
        ("mean(poisson_ratio) < -0.3 @ 0.1:0.2", "poisson_ratio > -0.2 @ 0.05:0.25", True),
        ("mean(poisson_ratio) < -0.3 @ 0.1:0.3", "poisson_ratio > -0.2 @ 0.05:0.25", False),
        ("slope(poisson_ratio) < -3 @ 0.1:0.2", "poisson_ratio > -2 @ 0.05:0.25", False),
        ("max(reaction_force) < 1 @ 0.1:0.2", "min(reaction_force) > 2 @ 0.1:0.2", False),
        ("max(reaction_force) < 1 @ 0.1:0.2", "max(reaction_force) > 2 @ 0.1:0.2", True),
        ("knit_cell_x < 10", "knit_cell_y > 20", False),
    ],
)
def test_only_targets_that_no_curve_meets_contradict_each_other(one, other, contradictory):
    targets = [with_tolerance(read_target(text)) for text in (one, other)]
    assert bool(list(contradictions(targets))) == contradictory
    assert bool(list(contradictions(targets[::-1]))) == contradictory


CURVES = st.lists(st.floats(-1, 1), min_size=2, max_size=5)
RELATIONS = st.sampled_from(["<", ">", "="])
REDUCED = st.sampled_from(["poisson_ratio", *(f"{name}(poisson_ratio)" for name in WITHIN_RANGE)])
PLACES = st.sampled_from([0.0, 0.1, 0.2, 0.3])


@given(
    CURVES,
    st.lists(
        st.tuples(REDUCED, RELATIONS, st.sampled_from([-0.5, 0.0, 0.5]), PLACES, PLACES),
        min_size=2,
        max_size=8,
    ),
)
def test_targets_that_one_curve_meets_do_not_contradict_each_other(curve, asked):
    strains = np.linspace(0, 0.3, len(curve))

    def met(target):
        inside, values = target.window.read(strains, np.array([curve]))
        if target.reduction:
            inside, values = inside[:1], REDUCTIONS[target.reduction](inside, values)
        return (abs(target.departure(values, inside)) <= target.allowance).all()

    targets = [
        with_tolerance(read_target(f"{name} {relation} {value} @ {min(one, two)}:{max(one, two)}"))
        for name, relation, value, one, two in asked
    ]
    assert not list(contradictions([target for target in targets if met(target)]))


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"targets": []}, "targets"),
        ({"targets": 3}, "targets"),
        ({"targets": ["poisson_ratio_min < 0"] * 31}, "30"),
        ({"subject_to": 3}, "subject_to"),
        ({"vary": [1, 2]}, "vary"),
        ({"targets": ["poisson_ratio"]}, "poisson_ratio"),
        ({"vary": {"rib_kt": [1, 2]}}, "'rib_kt'"),
        ({"vary": {"rib_k_t": [2, 1]}}, "vary.rib_k_t"),
        ({"vary": {"rib_k_t": 2}}, "vary.rib_k_t"),
        ({"vary": {"n_stripe": [4, 0]}}, "vary.n_stripe"),
        ({"vary": {"n_stripe": [4.5]}}, "vary.n_stripe"),
        ({"vary": {"pattern": ["GR", "RG"]}}, "vary.pattern"),
        ({"vary": {"pattern": 4}}, "vary.pattern"),
        ({"settings": {"k_s": 2}}, "k_s"),
        ({"settings": {"k_t_factor": 2}, "vary": {"k_t_factor": [1, 2]}}, "settings.k_t_factor"),
        ({"settings": {"robustness": 2}}, "settings.robustness"),
        ({"settings": {"cell_size": ["flat", "relaxed"]}}, "settings.cell_size"),
        ({"starts": 0}, "starts"),
        ({"targets": ["knit_cell_x < 10"], "subject_to": ["knit_cell_x > 20"]}, "knit_cell_x > 20"),
        (
            {"targets": [{"name": "poisson_ratio", "applied_strain": [0.1, 0.2], "value": [1]}]},
            "2 strains",
        ),
        (
            {"targets": [{"name": "poisson_ratio", "applied_strain": [0.2, 0.1], "value": [1, 2]}]},
            "ascend",
        ),
    ],
)
def test_mistakes_of_a_request_are_named(changes, word):
    with refused(word):
        request(**changes)


def test_every_mistake_of_a_file_is_listed_and_its_paths_are_of_its_folder(tmp_path):
    path = tmp_path / "sleeve.toml"
    path.write_text('targets = "poisson_ratio"\n[vary]\nrib_k_t = [2, 1]\nn_stripe = [0]\n')
    with pytest.raises(InputError) as error:
        read_request(path)
    assert len(error.value.mistakes) == 3
    assert all(str(path) in str(each) for each in error.value.mistakes)
    path.write_text(f'targets = "{TARGET}"\ncubes = ["known"]\n')
    assert read_request(path).cubes == (str(tmp_path / "known"),)


def test_a_curve_is_read_from_a_table_or_a_file(tmp_path):
    path = tmp_path / "wanted.csv"
    path.write_text("strain [1],poisson_ratio [1]\n0.1,-0.4\n0.2,-0.2\n")
    table = {"name": "poisson_ratio", "applied_strain": [0.1, 0.2], "value": [-0.4, -0.2]}
    of_file, of_table = request(targets=[f"poisson_ratio = {path} ± 0.02", table]).targets
    assert of_file.curve == of_table.curve
    assert of_file.tolerance == 0.02
    assert of_file.bounds(0.15)[0] == pytest.approx(-0.3)
    (tmp_path / "sleeve.toml").write_text('targets = "poisson_ratio = wanted.csv"\n')
    assert read_request(tmp_path / "sleeve.toml").targets[0].curve == of_table.curve
    path.write_text("strain [1],ratio [1]\n0.1,-0.4\n")
    with refused("poisson_ratio"):
        request(targets=[f"poisson_ratio = {path}"])
