"""Companions: other processes that settle blocks beside this one.

What settling a block takes is small calls, and between them every thread waits for the one
interpreter of its process. A companion is a program of its own and not a worker of
``concurrent.futures`` or loky: the first would run an unguarded script anew, and the workers of
neither end when what started them is killed. It ends when its standard input does.
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

from knitlab.linalg.threads import ONE_THREAD
from knitlab.mechanics.solver import Evaluate, SolverSettings
from knitlab.mechanics.state import State
from knitlab.model.fabric import Fabric
from knitlab.model.network import MeshShape

PROGRAM = "knitlab.mechanics.second_process_program"


@dataclass(frozen=True, eq=False)
class SubdomainData:
    """A block as its companion has to know it.

    Attributes:
        shape: its mesh shape.
        unknowns: those that may move.
        fabric: its numbers.
    """

    shape: MeshShape
    unknowns: Int[np.ndarray, " free"]
    fabric: Fabric


@dataclass(frozen=True)
class SubdomainTask:
    """A block to settle.

    Attributes:
        name: of the block; no two that a companion is given share one.
        start: where from.
        step_length: longest change of the vector between neighbouring nodes in a step [mm].
        settings: tolerance and limits.
    """

    name: tuple[int, int]
    start: Evaluate
    step_length: float
    settings: SolverSettings


class SecondProcess:
    """Another process, given one errand after the other.

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

    def settle(self, subdomain_task: SubdomainTask, piece: SubdomainData) -> State | None:
        """Where a block comes to rest; ``None`` if the process has died."""
        try:
            known = subdomain_task.name in self._known
            pickle.dump((subdomain_task, None if known else piece), self._requests)
            self._requests.flush()
            self._known.add(subdomain_task.name)
            return pickle.load(self._replies)
        except (EOFError, OSError, pickle.UnpicklingError):
            return None


def _end(process: subprocess.Popen[bytes], requests: IO[bytes], replies: IO[bytes]) -> None:
    # What was not sent cannot be, if it has died.
    with suppress(OSError):
        requests.close()
    replies.close()
    process.wait()
