"""Requests of designs: what may stand in one, and every mistake with its place."""

import pytest

from knitlab.io.errors import BadInput
from knitlab.optimisation.request import checked_request, read_request

TARGET = "poisson_ratio = -0.3 @ 0.05:0.25"


def request(**changes):
    return checked_request("wish", {"targets": [TARGET], **changes})


def test_a_target_without_a_tolerance_has_a_twentieth_of_its_value():
    asked = request(targets=[TARGET, "poisson_ratio = 0 @ 0.1", "knit_cell_x < 20 ± 2"])
    assert [each.tolerance for each in asked.targets] == pytest.approx([0.015, 0.01, 2])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"targets": []}, "targets"),
        ({"targets": 3}, "targets"),
        ({"subject_to": 3}, "subject_to"),
        ({"vary": [1, 2]}, "vary"),
        ({"targets": ["poisson_ratio"]}, "cannot be read"),
        ({"vary": {"rib_kt": [1, 2]}}, "unknown variable 'rib_kt'|no variable 'rib_kt'"),
        ({"vary": {"rib_k_t": [2, 1]}}, "lowest and highest value"),
        ({"vary": {"rib_k_t": 2}}, "lowest and highest value"),
        ({"vary": {"n_stripe": [4, 0]}}, "whole numbers"),
        ({"vary": {"n_stripe": [4.5]}}, "whole numbers"),
        ({"vary": {"pattern": ["GR", "RG"]}}, "list names of patterns"),
        ({"vary": {"pattern": 4}}, "list names of patterns"),
        ({"settings": {"k_s": 2}}, "k_s"),
        ({"settings": {"k_t_factor": 2}, "vary": {"k_t_factor": [1, 2]}}, "may also vary"),
        ({"settings": {"robustness": 2}}, "next to targets"),
        ({"settings": {"cell_size": ["flat", "relaxed"]}}, "is a list"),
        ({"starts": 0}, "starts"),
        ({"targets": ["knit_cell_x < 10"], "subject_to": ["knit_cell_x > 20"]}, "no value meets"),
        (
            {"targets": [{"name": "poisson_ratio", "applied_strain": [0.1, 0.2], "value": [1]}]},
            "1 values at 2 strains",
        ),
        (
            {"targets": [{"name": "poisson_ratio", "applied_strain": [0.2, 0.1], "value": [1, 2]}]},
            "do not ascend",
        ),
    ],
)
def test_what_is_wrong_is_named(changes, message):
    with pytest.raises(BadInput, match=message):
        request(**changes)


def test_every_mistake_of_a_file_is_listed_and_its_paths_are_of_its_folder(tmp_path):
    path = tmp_path / "wish.toml"
    path.write_text('targets = "poisson_ratio"\n[vary]\nrib_k_t = [2, 1]\nn_stripe = [0]\n')
    with pytest.raises(BadInput) as error:
        read_request(path)
    assert len(error.value.faults) == 3
    assert all(str(path) in str(fault) for fault in error.value.faults)
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
    (tmp_path / "wish.toml").write_text('targets = "poisson_ratio = wanted.csv"\n')
    assert read_request(tmp_path / "wish.toml").targets[0].curve == of_table.curve
    path.write_text("strain [1],ratio [1]\n0.1,-0.4\n")
    with pytest.raises(BadInput, match="column poisson_ratio"):
        request(targets=[f"poisson_ratio = {path}"])
