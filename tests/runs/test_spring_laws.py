"""Spring laws from files and settings to cases and back."""

import json

import pytest

from knitlab.io.errors import InputError
from knitlab.model.spring_curve import SpringCurve
from knitlab.model.stripe import SPRING_LAWS
from knitlab.runs.plan import make_plan
from knitlab.solvers.case import case_of

DESIGN = ("n_stripe=4", "n_subunit=16")
HEAD = """
thickness = { value = 0.1, unit = "mm", source = "test" }
[rib]
source = "test"
unit = { period = "mm", k_s = "N/mm", theta_0 = "rad", k_t = "N" }
[rib.n]
"""
GARTERS = """
[garter]
source = "test"
unit = { period = "mm", k_s = "N/mm", theta_0 = "rad", k_t = "N" }
[garter.n]
8 = { period = 1.44, k_s = 4.78, theta_0 = 0.68, k_t = 0.045 }
16 = { period = 2.6, k_s = 1.16, theta_0 = 0.71, k_t = 0.018 }
"""
ROW = "4 = { period = 1.4, k_s = 0.8, theta_0 = 0.77, k_t = 0.02, %s }\n"
CURVE = "spring_curve = { strain = [0, 0.1, 0.2], force = [0, 1.0, 3] }"


def cases(*overrides):
    return list(make_plan("periodic", (*DESIGN, *overrides)).cases.values())


def stripe_file(tmp_path, law):
    path = tmp_path / "mine.toml"
    linear = "8 = { period = 2.44, k_s = 0.455, theta_0 = 0.732, k_t = 0.0048 }"
    path.write_text(HEAD + ROW % law + linear + GARTERS)
    return f"material={path}"


def test_the_record_of_linear_springs_has_no_law():
    (case,) = cases()
    for stripe in (case.record["weft"], case.record["warp"]):
        assert all(stripe[law] is None for law in SPRING_LAWS)
    assert case_of(json.loads(json.dumps(case.record))) == case


@pytest.mark.parametrize("law", ["stiffening_strain = 0.2", CURVE])
def test_a_stripe_of_a_file_has_its_law_and_so_has_its_record(tmp_path, law):
    (case,) = cases(stripe_file(tmp_path, law))
    (plain,) = cases()
    if "curve" in law:
        assert case.weft.spring_curve == SpringCurve((0.0, 0.1, 0.2), (0.0, 1.0, 3.0))
    else:
        assert case.weft.stiffening_strain == 0.2
    assert case.warp == plain.warp
    read = case_of(json.loads(json.dumps(case.record)))
    assert read == case
    assert read.case_id == case.case_id != plain.case_id


def test_a_stiffening_strain_is_a_setting_of_one_knit_or_of_both_and_a_dimension(tmp_path):
    made = cases("stiffening_strain=0.1,0.3", "rib_stiffening_strain=0.2")
    assert [case.weft.stiffening_strain for case in made] == [0.2, 0.2]
    assert [case.warp.stiffening_strain for case in made] == [0.1, 0.3]
    assert [case.design["stiffening_strain"] for case in made] == [0.1, 0.3]
    (case,) = cases(stripe_file(tmp_path, CURVE), "stiffening_strain=0.3")
    assert case.weft.spring_curve is None
    assert case.weft.stiffening_strain == case.warp.stiffening_strain == 0.3


def test_cases_of_different_laws_are_no_batch(tmp_path):
    plan = make_plan("periodic", (*DESIGN, "stiffening_strain=0.1,0.3"))
    assert [len(batch.cases) for batch in plan.batches] == [2]
    mixed = make_plan("periodic", ("n_stripe=4,8", "n_subunit=32", stripe_file(tmp_path, CURVE)))
    assert all(len(batch.cases) == 1 for batch in mixed.batches)


@pytest.mark.parametrize(
    ("law", "problems"),
    [
        ("stiffening_strain = -1", ["stiffening_strain: .*greater than 0"]),
        (f"stiffening_strain = 1, {CURVE}", ["both stiffening_strain and spring_curve"]),
        (
            "spring_curve = { strain = [0, 0.2, 0.1], force = [1, 2, 2] }",
            ["strain does not increase", "force does not increase", "point 0, 0"],
        ),
        ("spring_curve = { strain = [0, 0.2] }", ["force: is missing"]),
    ],
)
def test_one_message_lists_all_that_is_wrong_with_a_law(tmp_path, law, problems):
    for problem in problems:
        with pytest.raises(InputError, match=problem):
            cases(stripe_file(tmp_path, law))
