"""``python -m knitlab.mechanics.second_process_program``: what a companion runs."""

import os
import pickle
import signal
import sys
from typing import IO

from knitlab.mechanics.executor import Executor, solve_subdomain
from knitlab.mechanics.factorisation import Factoriser, one_thread_of_blas
from knitlab.mechanics.second_process import SubdomainData, SubdomainTask
from knitlab.mechanics.stiffness import FreeStiffness
from knitlab.mechanics.subdomains import subdomain_stiffness


def serve(requests: IO[bytes], replies: IO[bytes]) -> None:
    """Settle what is requested until the requests are closed at the other end."""
    factorisers: dict[FreeStiffness, Factoriser] = {}
    desks: dict[tuple[int, int], tuple[Executor, FreeStiffness]] = {}
    while True:
        subdomain_task: SubdomainTask
        piece: SubdomainData | None
        try:
            subdomain_task, piece = pickle.load(requests)
        except EOFError:
            return
        if piece is not None:
            executor = Executor(piece.shape, piece.fabric, factorisers)
            free = subdomain_stiffness(piece.shape, piece.unknowns.tobytes())
            desks[subdomain_task.name] = executor, free
        pickle.dump(solve_subdomain(*desks[subdomain_task.name], subdomain_task), replies)
        replies.flush()


if __name__ == "__main__":
    # An interrupt is for the process that it works for, with which it ends.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # Whatever prints must not print among the replies.
    with os.fdopen(os.dup(sys.stdout.fileno()), "wb") as replies:
        os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
        with one_thread_of_blas():
            serve(sys.stdin.buffer, replies)
