"""Reproducing one case: found by the beginning of its identifier, compared with its file."""

import shutil

import pytest
import xarray as xr

from knitlab.cubes.case_file import case_path, write_case_file
from knitlab.io.errors import InputError
from knitlab.runs.plan import make_plan
from knitlab.runs.reproduce import comparison, find_case, reproduce
from knitlab.runs.run import run_plan
from knitlab.runs.run_options import RunOptions

SMALL = ("n_stripe=4", "n_subunit=8,16", "strain_max=0.06", "robustness=0")


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """A results folder with case files only, like those kept for reference."""
    made = tmp_path_factory.mktemp("made")
    plan = make_plan("periodic", SMALL)
    run_plan(plan, made, RunOptions())
    results = tmp_path_factory.mktemp("results")
    shutil.copytree(made / "cases", results / "periodic" / "cases")
    return results, list(plan.cases)


@pytest.mark.slow
def test_a_kept_case_is_found_by_its_beginning_and_agrees(kept):
    results, (case_id, _) = kept
    recorded = find_case(results, case_id[:6])
    assert recorded.case_id == recorded.case.case_id == case_id
    said = []
    assert reproduce(case_id, results=results, report=said.append)
    assert said[-1].endswith(f"agrees with {case_path(recorded.folder, case_id)}")
    table = [line for line in said if "converged" in line and "states" not in line]
    ratios = xr.load_dataset(case_path(recorded.folder, case_id))["poisson_ratio"].values
    assert [float(line.split()[5]) for line in table[1:]] == pytest.approx(ratios[1:], abs=1e-5)


def test_a_results_folder_itself_may_be_named(kept):
    results, (case_id, _) = kept
    assert find_case(results / "periodic", case_id).case_id == case_id


def test_a_beginning_of_several_is_refused_with_their_names(kept):
    results, names = kept
    with pytest.raises(InputError, match=r"2 cases[^…]*") as caught:
        find_case(results, "4-")
    assert all(name in str(caught.value) for name in names)


def test_what_differs_is_reported(kept, tmp_path):
    results, (case_id, _) = kept
    case = xr.load_dataset(case_path(results / "periodic", case_id))
    other = case.copy(deep=True)
    other["poisson_ratio"] += 0.01
    write_case_file(tmp_path / "periodic", case_id, other)
    said = []
    assert not reproduce(case_id, results=tmp_path, report=said.append)
    assert "nu differs by at most 1.0e-02" in said[-1]
    assert "DOES NOT agree" in said[-1]
    shorter = case.copy(deep=True)
    shorter["reaction_force"][-1] = float("nan")
    agree, sentence = comparison(case, shorter)
    assert not agree
    assert "other states are missing" in sentence
