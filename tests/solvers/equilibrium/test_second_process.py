"""The second process finds the solutions of this process, and ends with its use."""

import os
import signal
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from knitlab.model.energy import Point
from knitlab.model.threads import ALONE, Threads
from knitlab.solvers.equilibrium import domain_decomposition
from knitlab.solvers.equilibrium.domain_decomposition import (
    SecondProcess,
    SubdomainSolver,
    solve_subdomain,
)
from knitlab.solvers.equilibrium.stiffness import free_stiffness
from knitlab.solvers.equilibrium.subdomains import grid_subdomains
from knitlab.solvers.equilibrium.system import System, one_thread_of_blas
from tests.fabrics import DEFAULT


@pytest.fixture
def divided(sample, small_subdomains):
    """Arguments of the solution of four small subdomains."""
    net, _, loading = sample
    start = Point(loading.ahead([(0.0, loading.reference)], 0.05))
    free = free_stiffness(net.shape, loading.free)
    return start, free, DEFAULT


def is_there(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.slow
def test_a_second_process_finds_the_same_solution(sample, divided):
    (_, fabric, _), (at, free, _) = sample, divided
    settings = replace(DEFAULT, tolerance=1e-6, max_iterations=300)
    process = SecondProcess()
    for number, subdomain in enumerate(grid_subdomains(free)):
        own = subdomain.fabric(fabric)
        sent = subdomain.free.shape, subdomain.free.dofs, own
        # Sent twice, the second time only by its number.
        for start in (at.unknowns, at.unknowns + 1e-3):
            begin = Point(start[subdomain.dofs])
            remote = process.solve(number, sent, begin, settings)
            with one_thread_of_blas():
                system = System(subdomain.free.shape, own)
                local = solve_subdomain(system, subdomain.free, begin, settings)
            assert remote.outcome is local.outcome
            assert remote.iterations == local.iterations > 0
            np.testing.assert_array_equal(remote.unknowns, local.unknowns)


@pytest.mark.slow
def test_subdomains_are_solved_though_a_second_process_dies(sample, divided, monkeypatch):
    net, fabric, _ = sample
    dead = []

    class Dying(SecondProcess):
        def solve(self, *args):
            os.kill(self.pid, signal.SIGKILL)
            state = super().solve(*args)
            dead.append(state is None)
            return state

    def solved(threads):
        system = System(net.shape, fabric, threads)
        return SubdomainSolver(system).solve(system, *divided)

    alone = solved(ALONE)
    monkeypatch.setattr(domain_decomposition, "SecondProcess", Dying)
    left = solved(Threads(2))
    np.testing.assert_array_equal(left[0].unknowns, alone[0].unknowns)
    assert dead
    assert all(dead)


@pytest.mark.skipif(sys.platform == "win32", reason="asks for processes by signals")
def test_a_second_process_ends_when_its_parent_is_killed():
    script = (
        "from knitlab.solvers.equilibrium.domain_decomposition import SecondProcess\n"
        "process = SecondProcess()\nprint(process.pid, flush=True)\ninput()"
    )
    with subprocess.Popen(
        [sys.executable, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        pid = int(process.stdout.readline())
        assert is_there(pid)
        process.kill()
        # Both write to one pipe, which ends when the last of them has.
        assert process.stdout.read() == ""
