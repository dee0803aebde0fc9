"""Companions: other processes that settle blocks beside this one.

What settling a block takes is small calls, and between them every thread waits for the one
interpreter of its process. A companion is a program of its own and not a child of
``multiprocessing``, which would run an unguarded script anew. It ends when its pipe does: when
what started it lets go of it, or is killed.
"""

import os
import subprocess
import sys
import weakref
from dataclasses import dataclass
from multiprocessing import Pipe
from multiprocessing.connection import Connection

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
        self._pipe, theirs = Pipe()
        with theirs:
            process = subprocess.Popen(
                [sys.executable, "-m", PROGRAM, str(theirs.fileno())],
                pass_fds=[theirs.fileno()],
                env=os.environ | ONE_THREAD,
            )
        self.pid = process.pid
        self._known: set[tuple[int, int]] = set()
        weakref.finalize(self, _part, self._pipe, process)

    def settle(self, subdomain_task: SubdomainTask, piece: SubdomainData) -> State | None:
        """Where a block comes to rest; ``None`` if the process has died."""
        try:
            self._pipe.send((subdomain_task, None if subdomain_task.name in self._known else piece))
            self._known.add(subdomain_task.name)
            return self._pipe.recv()
        except (EOFError, OSError):
            return None


def _part(pipe: Connection, process: subprocess.Popen[bytes]) -> None:
    pipe.close()
    process.wait()
