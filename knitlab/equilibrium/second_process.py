"""A second process that solves subdomains beside this one.

A subdomain is solved by many small calls, between which threads of one process wait for the global
interpreter lock. The second process is a separate program, not a worker of ``concurrent.futures``
or loky: spawned pools run an unguarded script again, and the workers of both outlive a parent that
is killed. This program ends when its standard input is closed.
"""

import os
import pickle
import subprocess
import sys
import weakref
from contextlib import suppress
from dataclasses import dataclass
from typing import IO

import numpy as np
from jaxtyping import Int

from knitlab.equilibrium.settings import SolverSettings
from knitlab.equilibrium.state import State
from knitlab.fabric.energy import Point
from knitlab.fabric.fabric import Fabric
from knitlab.fabric.network import MeshShape
from knitlab.fabric.threads import ONE_THREAD

PROGRAM = "knitlab.equilibrium.second_process_program"


@dataclass(frozen=True, eq=False)
class SubdomainData:
    """Data of a subdomain for the second process.

    Attributes:
        shape: its mesh shape.
        unknowns: indices of the free unknowns.
        fabric: its springs, folds and walls.
    """

    shape: MeshShape
    unknowns: Int[np.ndarray, " free"]
    fabric: Fabric


@dataclass(frozen=True)
class SubdomainTask:
    """A subdomain to solve.

    Attributes:
        name: identifies the subdomain within one process.
        start: configuration that the search starts from.
        step_length: longest change of the vector between neighbouring nodes in a step [mm].
        settings: tolerance and limits.
    """

    name: tuple[int, int]
    start: Point
    step_length: float
    settings: SolverSettings


class SecondProcess:
    """Another process that solves subdomains one after another.

    Attributes:
        pid: its identifier.
    """

    def __init__(self) -> None:
        process = subprocess.Popen(
            [sys.executable, "-m", PROGRAM],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=os.environ | ONE_THREAD,
        )
        if process.stdin is None or process.stdout is None:
            raise RuntimeError("the process has no pipes")
        self.pid, self._requests, self._replies = process.pid, process.stdin, process.stdout
        self._known: set[tuple[int, int]] = set()
        weakref.finalize(self, _end, process, self._requests, self._replies)

    def solve(self, task: SubdomainTask, subdomain: SubdomainData) -> State | None:
        """Equilibrium of a subdomain; ``None`` if the process has died."""
        try:
            known = task.name in self._known
            pickle.dump((task, None if known else subdomain), self._requests)
            self._requests.flush()
            self._known.add(task.name)
            return pickle.load(self._replies)
        except (EOFError, OSError, pickle.UnpicklingError):
            return None


def _end(process: subprocess.Popen[bytes], requests: IO[bytes], replies: IO[bytes]) -> None:
    # A dead process cannot receive buffered data.
    with suppress(OSError):
        requests.close()
    replies.close()
    process.wait()
