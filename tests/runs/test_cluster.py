"""A cluster that loses a worker, then its scheduler, in the middle of a run; all are processes.

The workers wait before each case file for permission, so that this test knows without a clock what
is done when it kills one.
"""

import os
import selectors
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
import xarray as xr

from knitlab.cubes.case_file import is_undamaged
from knitlab.runs.run import run_plan
from knitlab.runs.run_options import RunOptions
from tests.runs import fake_simulator

HERE = Path(__file__).resolve().parents[2]
WORKERS = 3
BEFORE_WORKER = 7
BEFORE_SCHEDULER = 8
"""Cases that are written before a worker is killed, and then before the scheduler is; of forty."""

SCHEDULER = """
import sys
from distributed.cli.dask_scheduler import main
main(["--host", "127.0.0.1", "--port", sys.argv[1], "--no-dashboard"])
"""
WORKER = """
import socket, sys
from pathlib import Path
from distributed.cli.dask_worker import main
from tests.file_events import pause_before_changes
pause_before_changes(socket.socket(fileno=int(sys.argv[3])), Path(sys.argv[2]), ".nc")
# Without a nanny, which would start it again.
main([sys.argv[1], "--nthreads", "1", "--no-nanny", "--no-dashboard"])
"""
RUN = """
import sys
from pathlib import Path
from knitlab.runs.run_options import RunOptions
from knitlab.runs.run import run_plan
from tests.runs import fake_simulator
options = RunOptions(scheduler=sys.argv[1], simulate=fake_simulator.simulate)
run = run_plan(fake_simulator.plan_of(), Path(sys.argv[2]), options)
print(len(run.simulated), len(run.failures), run.stopped)
"""


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def program(text, *words, **options):
    return subprocess.Popen(
        [sys.executable, "-c", text, *map(str, words)],
        cwd=HERE,
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(HERE), *sys.path])},
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        **options,
    )


class Cluster:
    """A scheduler and workers, each a process of its own."""

    def __init__(self, results: Path) -> None:
        self.port = free_port()
        self.address = f"tcp://127.0.0.1:{self.port}"
        self.scheduler = program(SCHEDULER, self.port)
        self.workers: dict[socket.socket, subprocess.Popen] = {}
        for _ in range(WORKERS):
            own, other_end = socket.socketpair()
            words = (self.address, results, other_end.fileno())
            self.workers[own] = program(WORKER, *words, pass_fds=[other_end.fileno()])
            other_end.close()

    def waiting(self) -> Iterator[socket.socket]:
        """Each worker in the order in which they come to wait for permission to write a case."""
        with selectors.DefaultSelector() as selector:
            for channel in self.workers:
                selector.register(channel, selectors.EVENT_READ)
            while selector.get_map():
                for key, _ in selector.select():
                    channel = key.fileobj
                    if channel.recv(1):
                        yield channel
                    else:
                        selector.unregister(channel)

    def permit_all(self) -> None:
        """Let every worker write what it waits to write, until all have ended."""
        for channel in self.waiting():
            with suppress(OSError):
                channel.send(b".")

    def kill(self) -> None:
        for process in (self.scheduler, *self.workers.values()):
            process.kill()
            process.communicate()


@contextmanager
def cluster(results):
    made = Cluster(results)
    try:
        yield made
    finally:
        made.kill()


def sound(plan, results):
    return {name for name in plan.cases if is_undamaged(results, name)}


@pytest.mark.slow
@pytest.mark.nightly
def test_a_run_outlives_a_worker_and_continues_after_its_scheduler(tmp_path):
    plan = fake_simulator.plan_of()
    results = tmp_path / "results"
    whole = run_plan(plan, tmp_path / "whole", RunOptions(simulate=fake_simulator.simulate))

    with cluster(results) as first:
        run = program(RUN, first.address, results)
        waiting = first.waiting()
        for _ in range(BEFORE_WORKER):
            next(waiting).send(b".")
        lost = next(waiting)  # it is about to write a case
        first.workers[lost].kill()
        for _ in range(BEFORE_SCHEDULER):
            next(waiting).send(b".")
        next(waiting)
        first.scheduler.kill()
        said, _ = run.communicate()
    done = sound(plan, results)
    assert BEFORE_WORKER + BEFORE_SCHEDULER - WORKERS <= len(done) < len(plan.cases)
    assert run.returncode == 0
    assert said.split()[1:] == ["0", "True"]
    stored = xr.load_dataset(results / "cube.nc")
    assert int((stored["status"] == 1).sum()) == len(done)

    with cluster(results) as second:
        run = program(RUN, second.address, results)
        permitting = threading.Thread(target=second.permit_all)
        permitting.start()
        said, _ = run.communicate()
    permitting.join()
    assert said.split() == [str(len(plan.cases) - len(done)), "0", "False"]
    cube = xr.load_dataset(results / "cube.nc")
    xr.testing.assert_identical(cube.drop_attrs(), whole.cube.drop_attrs())
