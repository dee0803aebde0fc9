"""A second process that solves subdomains beside this one, and its program.

A subdomain is solved by many small calls, between which threads of one process wait for the global
interpreter lock. The second process is a separate program, not a worker of ``concurrent.futures``
or loky: spawned pools run an unguarded script again, and the workers of both outlive a parent that
is killed. This program ends when its standard input is closed.
"""

import os
import pickle
import signal
import subprocess
import sys
import weakref
from contextlib import suppress
from typing import IO

import numpy as np
from jaxtyping import Int

from knitlab.equilibrium.settings import Solver
from knitlab.equilibrium.state import State
from knitlab.fabric.energy import Point
from knitlab.fabric.fabric import Fabric
from knitlab.fabric.network import MeshShape
from knitlab.fabric.threads import ONE_THREAD

SentSubdomain = tuple[MeshShape, Int[np.ndarray, " free"], Fabric]
"""Mesh shape of a subdomain, indices of its free unknowns, and its springs, folds and walls."""


class SecondProcess:
    """Another process that solves subdomains one after another; ``pid`` is its identifier."""

    def __init__(self) -> None:
        process = subprocess.Popen(
            [sys.executable, "-m", "knitlab.equilibrium.second_process"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=os.environ | ONE_THREAD,
        )
        if process.stdin is None or process.stdout is None:
            raise RuntimeError("the process has no pipes")
        self.pid, self._requests, self._replies = process.pid, process.stdin, process.stdout
        self._known: set[int] = set()
        weakref.finalize(self, _end, process, self._requests, self._replies)

    def solve(
        self, number: int, subdomain: SentSubdomain, start: Point, settings: Solver
    ) -> State | None:
        """Equilibrium of a subdomain, known to the process by its number; ``None`` if it died."""
        try:
            sent = None if number in self._known else subdomain
            pickle.dump((number, sent, start, settings), self._requests)
            self._requests.flush()
            self._known.add(number)
            return pickle.load(self._replies)
        except (EOFError, OSError, pickle.UnpicklingError):
            return None


def _end(process: subprocess.Popen[bytes], requests: IO[bytes], replies: IO[bytes]) -> None:
    # A dead process cannot receive buffered data.
    with suppress(OSError):
        requests.close()
    replies.close()
    process.wait()


def _serve(requests: IO[bytes], replies: IO[bytes]) -> None:
    """Solve the requested subdomains until the other end closes the requests."""
    # The solver of a sample imports this module to start a second process.
    from knitlab.equilibrium.domain_decomposition import solve_subdomain
    from knitlab.equilibrium.stiffness import FreeStiffness, free_stiffness
    from knitlab.equilibrium.system import KeptFactors, System

    kept: KeptFactors = {}
    known: dict[int, tuple[System, FreeStiffness]] = {}
    while True:
        try:
            number, subdomain, start, settings = pickle.load(requests)
        except EOFError:
            return
        if subdomain is not None:
            shape, places, fabric = subdomain
            known[number] = System(shape, fabric, kept=kept), free_stiffness(shape, places)
        pickle.dump(solve_subdomain(*known[number], start, settings), replies)
        replies.flush()


if __name__ == "__main__":
    from knitlab.equilibrium.system import one_thread_of_blas

    # The parent handles interrupts, and this process ends with it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # Printed text must not mix with the replies.
    with os.fdopen(os.dup(sys.stdout.fileno()), "wb") as answers:
        os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
        with one_thread_of_blas():
            _serve(sys.stdin.buffer, answers)
