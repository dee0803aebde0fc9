"""Merging of results folders: nothing lost, nothing contradictory joined; by a fake simulator."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from knitlab.cubes.case_file import case_path, is_undamaged, write_case_file
from knitlab.io.errors import InputError
from knitlab.runs.batches import Shard
from knitlab.runs.cube import joined_cubes
from knitlab.runs.merge import merge_folders
from knitlab.runs.plan import make_plan
from tests.file_events import kill_fork
from tests.runs import fake_simulator
from tests.runs.fake_simulator import counts, ran, same

COUNT = 3
HERE = Path(__file__).resolve().parents[2]
SMALL = ("n_stripe=4,8", "n_subunit=16,32", "strain_max=0.06")


def files(folder):
    """Contents of the files of a results folder but its locks."""
    return {
        path.relative_to(folder): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and not path.name.startswith(".lock")
    }


@pytest.fixture(scope="module")
def plan():
    return make_plan("periodic", SMALL)


@pytest.fixture(scope="module")
def finished(plan, tmp_path_factory):
    """A finished run, and its shards in folders of their own."""
    folder = tmp_path_factory.mktemp("finished")
    ran(plan, folder / "whole" / "periodic")
    for number in range(1, COUNT + 1):
        ran(plan, folder / f"shard-{number}" / "periodic", shard=Shard(number, COUNT))
    return folder


@pytest.fixture
def made(finished, tmp_path):
    """A copy that a test may change."""
    return Path(shutil.copytree(finished, tmp_path / "made"))


def shards(folder):
    return sorted(folder.glob("shard-*"))


@pytest.mark.slow
def test_shards_in_folders_of_their_own_become_one_run(finished, tmp_path, plan):
    merged = merge_folders(shards(finished), tmp_path)
    assert merged.folder == tmp_path / "periodic"
    assert sorted(merged.copied) == sorted(plan.cases)
    whole = xr.load_dataset(finished / "whole" / "periodic" / "cube.nc")
    same(xr.load_dataset(merged.folder / "cube.nc"), whole)
    assert merged.cube.attrs["parameters"] == whole.attrs["parameters"]
    assert counts(merged.folder) == {"ok": len(plan.cases)}
    assert ran(plan, merged.folder).simulated == ()


@pytest.mark.slow
def test_merging_again_changes_nothing_in_any_order(finished, tmp_path):
    merge_folders(shards(finished), tmp_path / "once")
    before = files(tmp_path / "once")
    again = merge_folders(shards(finished)[::-1], tmp_path / "once")
    assert again.copied == ()
    after = files(tmp_path / "once")
    assert after.keys() == before.keys()
    assert all(after[path] == kept for path, kept in before.items() if path.name != "cube.nc")
    for shard in shards(finished)[::-1]:
        merge_folders([shard / "periodic"], tmp_path / "singly")
    cubes = [xr.load_dataset(tmp_path / name / "periodic/cube.nc") for name in ("once", "singly")]
    same(*cubes)


@pytest.mark.slow
def test_a_shard_that_was_killed_before_its_cube_is_merged_too(made, tmp_path, finished):
    for name in ("cube.nc", "failures.jsonl"):
        (made / "shard-2" / "periodic" / name).unlink()
    merged = merge_folders(shards(made), tmp_path)
    same(merged.cube, xr.load_dataset(finished / "whole" / "periodic" / "cube.nc"))


@pytest.mark.slow
def test_failures_are_merged(made, tmp_path, plan):
    bad = ran(plan, made / "bad" / "periodic", fake_simulator.simulate_poisoned)
    merged = merge_folders([made / "bad"], tmp_path)
    assert counts(merged.folder)["failed"] == len(bad.failures) > 0
    lines = (merged.folder / "failures.jsonl").read_text().splitlines()
    assert {json.loads(line)["case_id"] for line in lines} == {
        entry["case_id"] for entry in bad.failures
    }
    mended = merge_folders([made / "whole"], tmp_path)
    assert counts(merged.folder) == {"ok": len(plan.cases)} == mended.counts
    assert (merged.folder / "failures.jsonl").read_text() == ""


@pytest.mark.slow
def test_different_designs_of_one_workflow_are_joined(tmp_path):
    for k, n_stripe in enumerate((2, 4)):
        settings = ("n_subunit=16", f"n_stripe={n_stripe}", "strain_max=0.06")
        ran(make_plan("periodic", settings), tmp_path / str(k) / "periodic")
    merged = merge_folders([tmp_path / "0", tmp_path / "1"], tmp_path / "both")
    assert merged.cube["n_stripe"].values.tolist() == [2, 4]
    assert counts(merged.folder) == {"ok": 2}
    together = make_plan("periodic", ("n_subunit=16", "n_stripe=2,4", "strain_max=0.06"))
    assert ran(together, merged.folder).simulated == ()


@pytest.mark.slow
def test_cubes_without_plans_are_joined(made, tmp_path, finished):
    for path in made.rglob("plan.json"):
        path.unlink()
    merged = merge_folders(shards(made), tmp_path)
    same(merged.cube, xr.load_dataset(finished / "whole" / "periodic" / "cube.nc"))


@pytest.mark.slow
def test_joined_cubes_are_what_xarray_combines(tmp_path):
    # Other strains, other sample sizes and other designs.
    chosen = (("n_stripe=2,4", "strain_max=0.06"), ("n_stripe=6", "strain_max=0.12"))
    cubes = [
        ran(make_plan("periodic", ("n_subunit=24,48", *words)), tmp_path / str(k)).cube
        for k, words in enumerate(chosen)
    ]
    joined = joined_cubes(cubes)
    combined = cubes[0].combine_first(cubes[1])
    for name in joined.data_vars:
        if joined[name].dtype.kind == "f":
            aligned = combined[name].transpose(*joined[name].dims).sel(joined[name].coords)
            np.testing.assert_array_equal(joined[name].values, aligned.values, err_msg=name)


@pytest.mark.slow
def test_a_damaged_file_is_left_out_unless_another_folder_has_it(made, tmp_path, plan):
    case_id = next(iter(plan.cases))
    damaged = [path for path in made.rglob(f"{case_id}.nc") if "whole" not in path.parts]
    for path in damaged:
        path.write_bytes(b"damaged")
    merged = merge_folders(shards(made), tmp_path / "one")
    assert merged.damaged == tuple(damaged)
    assert not case_path(merged.folder, case_id).exists()
    merged = merge_folders([*shards(made), made / "whole"], tmp_path / "two")
    assert merged.damaged == ()
    assert is_undamaged(merged.folder, case_id)


def change_numbers(folder, case_id):
    """Compute a case as another machine does that is wrong."""
    with xr.open_dataset(case_path(folder, case_id)) as dataset:
        case = dataset.load()
    case["poisson_ratio"] = case["poisson_ratio"] + 0.1
    write_case_file(folder, case_id, case)


@pytest.mark.parametrize("in_cube", [True, False])
def test_the_same_case_with_other_numbers_is_refused(made, tmp_path, plan, in_cube):
    case_id = next(iter(plan.cases))
    other = made / "shard-1" / "periodic"
    shutil.copytree(made / "whole" / "periodic", other, dirs_exist_ok=True)
    change_numbers(other, case_id)
    (other / "cube.nc").unlink()
    if in_cube:
        ran(plan, other)
    with pytest.raises(InputError, match=rf"case {case_id}: .*shard-1.*nu.*1\.0e-01") as error:
        merge_folders([made / "whole", made / "shard-1"], tmp_path)
    assert len(error.value.mistakes) == 1
    assert list((tmp_path / "periodic").glob("[!.]*")) == []


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((*SMALL, "z_max=4"), r"periodic.*sheet.z_max was 6.0, is 4.0"),
        ((*SMALL, "k_t_factor=1,1.1"), "n_stripe, n_subunit, k_t_factor"),
        ((*SMALL, "max_iterations=77"), "n_stripe 4  n_subunit 16.* 4-16-"),
    ],
)
def test_what_was_computed_otherwise_is_refused(finished, tmp_path, words, message):
    ran(make_plan("periodic", words), tmp_path / "other" / "periodic")
    with pytest.raises(InputError, match=message):
        merge_folders([finished / "whole", tmp_path / "other"], tmp_path / "merged")
    assert list((tmp_path / "merged" / "periodic").glob("[!.]*")) == []


@pytest.mark.slow
def test_other_code_is_refused_unless_it_is_allowed(finished, tmp_path, plan, monkeypatch):
    monkeypatch.setattr(fake_simulator, "MODEL", "model 0")
    ran(plan, tmp_path / "other" / "periodic")
    both = [finished / "whole", tmp_path / "other"]
    with pytest.raises(InputError, match=r"model 1 in .*whole.*, model 0 in "):
        merge_folders(both, tmp_path / "merged")
    merged = merge_folders(both, tmp_path / "merged", any_code=True)
    same(merged.cube, xr.load_dataset(finished / "whole" / "periodic" / "cube.nc"))


def test_folders_without_results_or_of_several_workflows_are_refused(finished, tmp_path):
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="empty: "):
        merge_folders([tmp_path / "empty"], tmp_path)
    ran(make_plan("paper", ("n_stripe=2", "n_subunit=16", "strain_max=0.06")), tmp_path / "paper")
    with pytest.raises(InputError, match=r"periodic in .*, paper in"):
        merge_folders([finished / "whole", tmp_path / "paper"], tmp_path)


KILLS = """
import sys
from pathlib import Path
from tests.runs.test_merge import kill_merge
for changes in range(1, int(sys.argv[3]), 4):
    kill_merge(Path(sys.argv[1]), Path(sys.argv[2]), changes)
"""


def kill_merge(made, results, changes):
    """Merge in a fork, and kill it before a change of a file of this number."""
    kill_fork(lambda: merge_folders(shards(made), results), results, changes)


@pytest.mark.slow
@pytest.mark.nightly
def test_a_killed_merge_loses_nothing(finished, tmp_path):
    before = files(finished)
    command = [sys.executable, "-c", KILLS, finished, tmp_path, "40"]
    said = subprocess.run(command, cwd=HERE, capture_output=True, text=True)
    assert said.returncode == 0, said.stderr
    merged = merge_folders(shards(finished), tmp_path)
    same(merged.cube, xr.load_dataset(finished / "whole" / "periodic" / "cube.nc"))
    assert not list(tmp_path.rglob(".writing-*"))
    assert files(finished) == before
