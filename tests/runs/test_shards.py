"""Shards of a plan in one results folder and in their own; by a fake simulator."""

import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
import xarray as xr

from knitlab.io.errors import InputError
from knitlab.io.lock import locked, running_shards
from knitlab.observables.status import Status
from knitlab.runs.batches import Shard
from knitlab.runs.plan import make_plan
from knitlab.runs.recorded_plan import PLAN, read_plan
from knitlab.runs.run import run_plan
from knitlab.runs.run_options import RunOptions
from tests.runs import fake_simulator
from tests.runs.fake_simulator import counts, same

HERE = Path(__file__).resolve().parents[2]
COUNT = 3


def ran(plan, results, shard=None, simulate=fake_simulator.simulate, **options):
    chosen = None if shard is None else Shard(shard, COUNT)
    return run_plan(plan, results, RunOptions(simulate=simulate, shard=chosen, **options))


def left(folder):
    """Files of a results folder but cases and locks."""
    return sorted(path.name for path in folder.iterdir() if not path.name.startswith(".lock"))


@pytest.fixture(scope="module")
def plan():
    return fake_simulator.plan_of(2)


@pytest.fixture(scope="module")
def whole(plan, tmp_path_factory):
    return ran(plan, tmp_path_factory.mktemp("whole"))


def test_the_first_shard_writes_the_plan_though_another_waits_to_begin(tmp_path, plan):
    with locked(tmp_path, (3, COUNT)):
        assert not ran(plan, tmp_path, 1).joined
        assert set(read_plan(tmp_path)["cases"]) == set(plan.cases)


@pytest.mark.slow
def test_shards_one_after_another_give_the_cube_of_one_run(tmp_path, plan, whole):
    for number in range(1, COUNT + 1):
        part = ran(plan, tmp_path, number)
        assert set(part.simulated) == set(plan.share(Shard(number, COUNT)).cases)
        assert part.joined
        assert int((part.cube["status"] == Status.ok).sum()) == len(part.simulated)
    same(xr.load_dataset(tmp_path / "cube.nc"), whole.cube)
    assert counts(tmp_path) == {"ok": len(plan.cases)}
    assert ran(plan, tmp_path).simulated == ()


@pytest.mark.slow
def test_only_the_last_shard_to_end_writes_the_cube(tmp_path, plan, whole):
    with locked(tmp_path, (3, COUNT)):
        plan.write(tmp_path / PLAN)
        first = ran(plan, tmp_path, 1)
        assert not first.joined
        assert not (tmp_path / "cube.nc").exists()
        done = len(first.simulated)
        assert counts(tmp_path) == {
            "done, not yet in the cube": done,
            "pending": len(plan.cases) - done,
        }
        assert running_shards(tmp_path) == [(3, COUNT)]
    assert ran(plan, tmp_path, 2).joined
    assert ran(plan, tmp_path, 3).joined
    same(xr.load_dataset(tmp_path / "cube.nc"), whole.cube)


@pytest.mark.slow
def test_failures_of_shards_are_joined_and_shown_meanwhile(tmp_path, plan):
    bad = {case_id for case_id, case in plan.cases.items() if case.design["n_stripe"] == 8}
    with locked(tmp_path, (3, COUNT)):
        plan.write(tmp_path / PLAN)
        failed = [
            entry["case_id"]
            for number in (1, 2)
            for entry in ran(plan, tmp_path, number, fake_simulator.simulate_poisoned).failures
        ]
        assert counts(tmp_path)["failed"] == len(failed) > 0
    last = ran(plan, tmp_path, 3, fake_simulator.simulate_poisoned)
    assert {*failed, *(entry["case_id"] for entry in last.failures)} == bad
    lines = (tmp_path / "failures.jsonl").read_text().splitlines()
    assert {json.loads(line)["case_id"] for line in lines} == bad
    assert all("poisoned on purpose" in json.loads(line)["reason"] for line in lines)
    assert counts(tmp_path) == {"ok": len(plan.cases) - len(bad), "failed": len(bad)}
    mended = ran(plan, tmp_path)
    assert set(mended.simulated) == bad
    assert counts(tmp_path) == {"ok": len(plan.cases)}


@pytest.mark.slow
def test_unconverged_designs_of_shards_keep_their_reasons(tmp_path, plan, tmp_path_factory):
    for number in range(1, COUNT + 1):
        ran(plan, tmp_path, number, fake_simulator.simulate_unconverged)
    once = tmp_path_factory.mktemp("once")
    ran(plan, once, simulate=fake_simulator.simulate_unconverged)
    texts = [(folder / "failures.jsonl").read_text() for folder in (tmp_path, once)]
    assert texts[0] == texts[1] != ""


def test_more_shards_than_cases_leave_some_without_any(tmp_path):
    plan = make_plan("periodic", ("n_stripe=4", "n_subunit=16", "strain_max=0.06"))
    runs = [ran(plan, tmp_path, number) for number in range(1, COUNT + 1)]
    assert sorted(len(run.simulated) for run in runs) == [0, 0, 1]
    assert counts(tmp_path) == {"ok": 1}


def test_a_shard_refuses_a_folder_in_other_use(tmp_path, plan):
    with locked(tmp_path), pytest.raises(InputError, match=f"process {os.getpid()} of "):
        ran(plan, tmp_path, 1)
    with locked(tmp_path, (1, COUNT)):
        plan.write(tmp_path / PLAN)
        of_two = RunOptions(simulate=fake_simulator.simulate, shard=Shard(1, 2))
        for use in (
            lambda: ran(plan, tmp_path, 1),
            lambda: run_plan(plan, tmp_path, of_two),
            lambda: ran(plan, tmp_path),
        ):
            with pytest.raises(InputError, match=rf"process {os.getpid()} .*shard 1 of {COUNT}"):
                use()
        with pytest.raises(InputError, match=r"plan\.json.* cases"):
            ran(fake_simulator.plan_of(1), tmp_path, 2)
    assert ran(plan, tmp_path, 1).failures == ()


@pytest.mark.slow
def test_a_shard_that_starts_leaves_unfinished_files_of_others(tmp_path, plan):
    unfinished = tmp_path / "cases" / ".writing-other"
    with locked(tmp_path, (3, COUNT)):
        plan.write(tmp_path / PLAN)
        unfinished.mkdir(parents=True)
        ran(plan, tmp_path, 1)
        assert unfinished.exists()
    ran(plan, tmp_path, 2)
    assert not unfinished.exists()


PROGRAM = """
import sys
from pathlib import Path
from knitlab.runs.run_options import RunOptions
from knitlab.runs.run import run_plan
from knitlab.runs.batches import Shard
from tests.runs import fake_simulator
options = RunOptions(simulate=fake_simulator.simulate, shard=Shard.of(sys.argv[2]))
run_plan(fake_simulator.plan_of(2), Path(sys.argv[1]), options)
"""


@pytest.mark.slow
def test_shards_at_the_same_time_give_the_cube_of_one_run(tmp_path, plan, whole):
    def process(number):
        command = [sys.executable, "-c", PROGRAM, tmp_path, f"{number}/4"]
        return subprocess.run(command, cwd=HERE, capture_output=True, text=True)

    with ThreadPoolExecutor(4) as pool:
        for said in pool.map(process, range(1, 5)):
            assert said.returncode == 0, said.stderr
    same(xr.load_dataset(tmp_path / "cube.nc"), whole.cube)
    assert left(tmp_path) == ["cases", "cube.nc", "failures.jsonl", "plan.json"]


KILLS = """
import sys
from pathlib import Path
from tests.runs.fake_simulator import plan_of
from tests.file_events import kill_fork
from tests.runs.test_shards import ran
plan, results = plan_of(2), Path(sys.argv[1])
for k in range(int(sys.argv[2])):
    kill_fork(lambda: ran(plan, results, 1 + k % 3), results, 3 + 7 * k % 50)
"""


@pytest.mark.slow
@pytest.mark.nightly
def test_kills_of_shards_at_any_change_of_a_file_lose_nothing(tmp_path, plan, whole):
    # In a process of its own, because JAX's threads do not survive a fork.
    command = [sys.executable, "-c", KILLS, tmp_path, "40"]
    said = subprocess.run(command, cwd=HERE, capture_output=True, text=True)
    assert said.returncode == 0, said.stderr
    for number in range(1, COUNT + 1):
        ran(plan, tmp_path, number)
    same(xr.load_dataset(tmp_path / "cube.nc"), whole.cube)
    assert counts(tmp_path) == {"ok": len(plan.cases)}
    assert not list(tmp_path.rglob(".writing-*"))
