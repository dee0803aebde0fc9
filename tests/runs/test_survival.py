"""Sweeps survive kills, failing cases, damage, full disks and second runs; by a fake simulator."""

import mmap
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryFile

import psutil
import pytest
import xarray as xr
from distributed import LocalCluster

from knitlab.cubes.case_file import case_path, is_undamaged
from knitlab.io.checksum import LENGTH, append_checksum
from knitlab.io.errors import CannotWrite, InputError
from knitlab.io.lock import locked
from knitlab.observables.status import Status
from knitlab.runs import results_folder
from knitlab.runs.plan import make_plan
from knitlab.runs.recorded_plan import read_plan
from knitlab.runs.results_folder import CaseState
from tests.runs import fake_simulator
from tests.runs.fake_simulator import ran, same

HERE = Path(__file__).resolve().parents[2]
WORKERS = 2
ENOUGH = 8
"""Cases after which a run is interrupted, of forty."""


def plan_of(factors=1):
    return fake_simulator.plan_of(factors)


def few_cases():
    """Four cases, two of them bad; a good and a bad one share a batch."""
    return make_plan("periodic", ("n_stripe=4,8", "n_subunit=16,32", "strain_max=0.06"))


def statuses(run):
    return {status.name: int((run.cube["status"] == status).sum()) for status in Status}


def simulator_process(*words, **options):
    """A process of the fake simulator; its output ends when it and all its workers have."""
    command = [sys.executable, "-m", "tests.runs.fake_simulator", *map(str, words)]
    return subprocess.Popen(
        command, cwd=HERE, stdout=subprocess.PIPE, pipesize=mmap.PAGESIZE, text=True, **options
    )


def await_cases(process, count):
    """Wait until a process has announced a number of cases; only a few more are written."""
    for _ in range(count):
        assert process.stdout.readline(), "the process ended too early"


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory):
    return ran(fake_simulator.plan_of(), tmp_path_factory.mktemp("uninterrupted"))


@pytest.mark.slow
@pytest.mark.nightly
def test_kills_at_any_change_of_a_file_lose_no_finished_case(tmp_path, uninterrupted):
    command = [sys.executable, "-m", "tests.runs.fake_simulator", "kills", tmp_path, "60"]
    said = subprocess.run(command, cwd=HERE, capture_output=True, text=True, check=False)
    assert said.returncode == 0, said.stderr
    hit = int(said.stdout.split(", ")[1].split()[0])
    assert hit >= 8, said.stdout
    after = ran(fake_simulator.plan_of(), tmp_path)
    same(after.cube, uninterrupted.cube)
    assert not list(tmp_path.rglob(".writing-*"))


@pytest.mark.slow
@pytest.mark.nightly
def test_a_killed_run_with_workers_resumes(tmp_path, uninterrupted):
    plan = fake_simulator.plan_of()
    process = simulator_process("run", tmp_path, WORKERS)
    await_cases(process, ENOUGH)
    process.kill()
    process.communicate()  # its workers end with it
    done = len(list(tmp_path.glob("cases/*.nc")))
    assert ENOUGH <= done < len(plan.cases)
    after = ran(plan, tmp_path, workers=WORKERS)
    assert len(after.simulated) <= len(plan.cases) - done + WORKERS * 2
    same(after.cube, uninterrupted.cube)


def ignoring_ctrl_c():
    """Signal handling of a process that a shell starts in the background."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def ended_by(number, results, **options):
    """A run with workers that gets a signal after some cases, and the cube that it leaves."""
    with TemporaryFile("w+") as log:
        process = simulator_process(
            "run", results, WORKERS, stderr=log, start_new_session=True, **options
        )
        await_cases(process, ENOUGH)
        process.send_signal(number)
        process.communicate()  # and all its workers have ended
        log.seek(0)
        said = log.read()
    assert process.returncode == 0
    assert "Traceback" not in said
    assert "leaked" not in said
    cube = xr.load_dataset(results / "cube.nc")
    done = int((cube["status"] == Status.ok).sum())
    assert ENOUGH <= done < cube["status"].size
    assert done + int((cube["status"] == Status.pending).sum()) == len(
        fake_simulator.plan_of().cases
    )


def simulate_and_lose_an_interrupt(results, cases, progress):
    """A batch during which Ctrl-C is pressed in a callback, where Python ignores an exception."""
    with suppress(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
    fake_simulator.simulate(results, cases, progress)


@pytest.fixture
def ctrl_c():
    """Ctrl-C as in a terminal, even if this process was started in the background."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("ctrl_c")
def test_a_batch_of_this_process_stops_though_the_exception_of_a_signal_is_lost(tmp_path):
    plan = fake_simulator.plan_of(1)
    run = ran(plan, tmp_path, simulate_and_lose_an_interrupt)
    assert run.stopped
    assert len(list(tmp_path.glob("cases/*.nc"))) == 1 < len(plan.batches[0].cases)
    # The run and its status agree on what is left.
    assert len(run.simulated) == 1
    left = fake_simulator.counts(tmp_path)["pending"]
    assert f"{left} cases are left" in run.remarks(plan.dims, tmp_path)[-1]


@pytest.mark.slow
def test_ctrl_c_keeps_what_is_done_and_writes_the_cube(tmp_path, uninterrupted):
    ended_by(signal.SIGINT, tmp_path)
    same(ran(fake_simulator.plan_of(), tmp_path).cube, uninterrupted.cube)


@pytest.mark.slow
@pytest.mark.nightly
@pytest.mark.parametrize("before", [None, ignoring_ctrl_c])
def test_a_terminated_run_ends_as_by_ctrl_c(tmp_path, before):
    ended_by(signal.SIGTERM, tmp_path, preexec_fn=before)


@pytest.mark.slow
@pytest.mark.parametrize("workers", [0, pytest.param(WORKERS, marks=pytest.mark.slow)])
def test_a_case_that_raises_does_not_affect_others(tmp_path, workers):
    run = ran(plan_of(2), tmp_path, fake_simulator.simulate_poisoned, workers=workers)
    poisoned = [case for case in run.failures if case["n_stripe"] == fake_simulator.POISONED]
    assert len(poisoned) == len(run.failures) == 6
    assert statuses(run)["ok"] == 14
    for failure in run.failures:
        assert failure["status"] == "failed"
        assert "poisoned on purpose" in failure["reason"]
        assert "FloatingPointError" in failure["trace"]
        assert failure["case"]["design"]["n_stripe"] == fake_simulator.POISONED
    assert (
        run.cube["status"].sel(n_stripe=fake_simulator.POISONED, n_subunit=64) == Status.failed
    ).all()
    mended = ran(plan_of(2), tmp_path)
    assert sorted(mended.simulated) == sorted(failure["case_id"] for failure in run.failures)
    assert mended.failures == ()


@pytest.mark.slow
@pytest.mark.parametrize(("n_stripe", "threads"), [("8", 4), ("4,8", 2)])
def test_cores_without_a_batch_become_threads_of_other_workers(tmp_path, n_stripe, threads):
    plan = make_plan("periodic", (f"n_stripe={n_stripe}", "n_subunit=32", "strain_max=0.06"))
    ran(plan, tmp_path, fake_simulator.simulate_and_tell_threads, workers=4)
    result = [path.read_text() for path in tmp_path.glob("threads-*")]
    assert result == [f"{threads} 1"] * len(n_stripe.split(","))


@pytest.mark.slow
@pytest.mark.nightly
def test_a_case_that_kills_its_worker_does_not_affect_others(tmp_path):
    run = ran(few_cases(), tmp_path, fake_simulator.simulate_deadly, workers=WORKERS)
    assert statuses(run)["failed"] == 2
    assert statuses(run)["ok"] == 2
    assert {failure["n_stripe"] for failure in run.failures} == {fake_simulator.POISONED}
    assert "its worker died" in run.failures[0]["reason"]


@pytest.mark.slow
@pytest.mark.nightly
def test_a_worker_lost_once_costs_nothing(tmp_path):
    run = ran(plan_of(), tmp_path, fake_simulator.simulate_once_lost, workers=WORKERS)
    assert (tmp_path / "died-once").exists()
    assert run.failures == ()


def killed_at_its_start():
    """Kill the first worker process of this one, as soon as there is one."""
    while not (
        started := [
            each for each in psutil.Process().children() if "spawn_main" in " ".join(each.cmdline())
        ]
    ):
        time.sleep(0.01)
    started[0].kill()


@pytest.mark.slow
def test_a_worker_killed_at_its_start_is_a_sentence_and_no_case_is_lost(tmp_path, uninterrupted):
    killer = threading.Thread(target=killed_at_its_start, daemon=True)
    killer.start()
    with pytest.raises(InputError, match=r"^workers 2: "):
        ran(fake_simulator.plan_of(), tmp_path, workers=WORKERS)
    killer.join(timeout=1)
    assert not killer.is_alive()
    same(ran(fake_simulator.plan_of(), tmp_path, workers=WORKERS).cube, uninterrupted.cube)


@pytest.mark.slow
@pytest.mark.nightly
@pytest.mark.parametrize(("workers", "timeout"), [(0, 2.0), (WORKERS, 6.0)])
def test_a_case_without_end_is_ended(tmp_path, workers, timeout):
    unending = fake_simulator.simulate_endlessly
    run = ran(few_cases(), tmp_path, unending, workers=workers, case_timeout=timeout)
    assert statuses(run)["failed"] == 2
    assert statuses(run)["ok"] == 2
    assert f"took longer than {timeout:g} s (case_timeout)" in run.failures[0]["reason"]
    assert not list(tmp_path.glob(".timed-out-*"))


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="no timers of signals")
def test_a_time_that_is_over_at_once_ends_with_its_case(tmp_path):
    before = signal.getsignal(signal.SIGALRM)
    run = ran(few_cases(), tmp_path, case_timeout=1e-300)
    assert statuses(run)["failed"]
    assert signal.getsignal(signal.SIGALRM) is before
    assert signal.getitimer(signal.ITIMER_REAL) == (0, 0)


@pytest.mark.slow
def test_an_existing_scheduler_is_used(tmp_path):
    with LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as cluster:
        run = ran(plan_of(), tmp_path, scheduler=cluster.scheduler_address)
        poisoned = ran(
            plan_of(2),
            tmp_path / "poisoned",
            fake_simulator.simulate_poisoned,
            scheduler=cluster.scheduler_address,
        )
    assert run.failures == ()
    assert statuses(poisoned)["failed"] == 6
    assert statuses(poisoned)["ok"] == 14


def test_batches_that_raise_are_retried_as_often_as_requested(tmp_path):
    tries = []

    def third_time(results, cases, progress):
        tries.append(len(cases))
        if len(tries) < 3:
            raise OSError("not yet")
        fake_simulator.simulate(results, cases, progress)

    plan = make_plan("periodic", ("n_stripe=4", "n_subunit=16", "strain_max=0.06"))
    assert ran(plan, tmp_path, third_time, retries=1).failures
    tries.clear()
    assert ran(plan, tmp_path, third_time, retries=2).failures == ()
    assert tries == [1, 1, 1]


@pytest.mark.slow
@pytest.mark.parametrize(
    "bad", [fake_simulator.simulate_poisoned, fake_simulator.simulate_unconverged]
)
def test_fail_fast_stops_at_the_first_case_that_is_not_ok(tmp_path, bad):
    run = ran(plan_of(40), tmp_path, bad, fail_fast=True)
    assert run.stopped
    assert run.failures
    assert statuses(run)["pending"] > 100


@pytest.mark.slow
@pytest.mark.parametrize("damage", ["truncated", "flipped", "emptied", "no checksum"])
def test_a_damaged_case_file_is_named_and_computed_again(tmp_path, damage):
    plan = plan_of()
    before = ran(plan, tmp_path)
    case_id = next(iter(plan.cases))
    path = case_path(tmp_path, case_id)
    whole = path.read_bytes()
    flipped = whole[:2000] + bytes([whole[2000] ^ 1]) + whole[2001:]
    written = {"truncated": whole[:-7], "flipped": flipped, "emptied": b""}
    path.write_bytes(written.get(damage, whole[:-LENGTH]))
    assert not is_undamaged(tmp_path, case_id)
    again = ran(plan, tmp_path)
    assert again.states_before[case_id] is CaseState.damaged
    assert again.simulated == (case_id,)
    same(again.cube, before.cube)
    assert is_undamaged(tmp_path, case_id)


@pytest.mark.slow
def test_a_damaged_file_that_cannot_be_computed_again_is_not_read(tmp_path):
    plan = plan_of()
    ran(plan, tmp_path)
    (tmp_path / "cube.nc").unlink()
    for case_id, case in plan.cases.items():
        if case.design["n_stripe"] == fake_simulator.POISONED:
            case_path(tmp_path, case_id).write_bytes(b"no longer netCDF")
    run = ran(plan, tmp_path, fake_simulator.simulate_poisoned)
    assert statuses(run)["failed"] == 3
    assert statuses(run)["ok"] == 7


@pytest.mark.slow
@pytest.mark.parametrize("other", ["", "z_max=4"])
def test_a_refresh_that_fails_is_reported_and_loses_nothing(tmp_path, monkeypatch, other):
    before = ran(plan_of(), tmp_path)
    plan = make_plan("periodic", ("strain_max=0.06", "k_t_factor=1", other or "z_max=1.9"))
    if not other:
        monkeypatch.setattr(results_folder, "MODEL", "model 0")
    run = ran(plan, tmp_path, fake_simulator.simulate_poisoned, refresh=True)
    assert [failure["n_stripe"] for failure in run.failures] == [fake_simulator.POISONED] * 3
    assert all("poisoned on purpose" in failure["reason"] for failure in run.failures)
    monkeypatch.undo()
    same(ran(plan_of(), tmp_path).cube, before.cube)


@pytest.mark.slow
@pytest.mark.parametrize("garbage", [b"garbage", b"[]", b"{}", b"\xff\xfe\x00"])
def test_garbage_in_files_that_are_rewritten_is_ignored(tmp_path, garbage):
    plan = plan_of()
    before = ran(plan, tmp_path, fake_simulator.simulate_unconverged)
    (tmp_path / "failures.jsonl").write_bytes(garbage)
    (tmp_path / "plan.json").write_bytes(garbage)
    with pytest.raises(InputError, match=r"plan\.json"):
        read_plan(tmp_path)
    first, second = list(plan.cases)[:2]
    case_path(tmp_path, first).write_bytes(garbage)
    again = ran(plan, tmp_path, fake_simulator.simulate_unconverged)
    assert again.simulated == (first,)
    assert again.failures == before.failures
    (tmp_path / "cube.nc").write_bytes(garbage)
    same(ran(plan, tmp_path, fake_simulator.simulate_unconverged).cube, before.cube)
    assert (tmp_path / "cube-damaged.nc").read_bytes() == garbage
    # Its checksum is correct, but it is not a case.
    case_path(tmp_path, second).write_bytes(garbage)
    append_checksum(case_path(tmp_path, second))
    assert ran(plan, tmp_path, fake_simulator.simulate_unconverged).simulated == (second,)


def test_a_second_run_names_the_holder_of_the_lock(tmp_path):
    with locked(tmp_path), pytest.raises(InputError, match=f"process {os.getpid()} of "):
        # A lock belongs to an open file, so that this process can act as another one.
        ran(plan_of(), tmp_path)
    assert ran(plan_of(), tmp_path).failures == ()


@pytest.mark.slow
def test_a_lock_ends_with_its_process(tmp_path):
    process = simulator_process("run", tmp_path, 0)
    await_cases(process, 1)
    with pytest.raises(InputError, match=f"process {process.pid} of"):
        ran(plan_of(), tmp_path)
    process.kill()
    process.communicate()
    with locked(tmp_path):
        pass


FULL_DISK = """
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path
from knitlab.io.errors import CannotWrite
from knitlab.runs.run_options import RunOptions
from knitlab.runs.run import run_plan
from tests.runs import fake_simulator

results = Path(sys.argv[1])
options = RunOptions(workers=int(sys.argv[2]), simulate=fake_simulator.simulate)
run_plan(fake_simulator.plan_of(2), results, RunOptions(simulate=fake_simulator.simulate))
before = {path: path.read_bytes() for path in results.rglob("*.*") if path.is_file()}
try:
    run_plan(fake_simulator.plan_of(), results, options)
except CannotWrite as error:
    print(error)
for path, contents in before.items():
    if path.name != "plan.json" and not path.name.startswith(".lock"):
        assert path.read_bytes() == contents, path
"""


@pytest.mark.slow
@pytest.mark.parametrize("workers", [0, pytest.param(WORKERS, marks=pytest.mark.slow)])
def test_a_full_disk_gives_one_sentence_and_loses_nothing(tmp_path, workers):
    mounting = f"mount -t tmpfs -o size=1200k tmpfs {tmp_path}"
    namespace = ["unshare", "--user", "--map-root-user", "--mount", "bash", "-c"]
    if not shutil.which("unshare") or subprocess.run([*namespace, mounting]).returncode:
        pytest.skip("this machine lets nobody mount a small disk of his own")
    script = f"{mounting} && exec {sys.executable} -c '{FULL_DISK}' {tmp_path} {workers}"
    said = subprocess.run([*namespace, script], cwd=HERE, capture_output=True, text=True)
    assert said.returncode == 0, said.stderr
    assert "space" in said.stdout
    assert len(said.stdout.splitlines()) == 1


def test_a_folder_that_cannot_be_written_is_one_sentence(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(CannotWrite, match="cannot be written"):
        ran(plan_of(), tmp_path / "file" / "results")
