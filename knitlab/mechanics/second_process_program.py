"""``python -m knitlab.mechanics.second_process_program PIPE``: what a companion runs."""

import signal
import sys
from multiprocessing.connection import Connection

from knitlab.mechanics.executor import Executor, solve_subdomain
from knitlab.mechanics.factorisation import Factoriser, one_thread_of_blas
from knitlab.mechanics.second_process import SubdomainData, SubdomainTask
from knitlab.mechanics.stiffness import FreeStiffness
from knitlab.mechanics.subdomains import subdomain_stiffness


def serve(pipe: Connection) -> None:
    """Settle what comes through the pipe until it is closed at the other end."""
    factorisers: dict[FreeStiffness, Factoriser] = {}
    desks: dict[tuple[int, int], tuple[Executor, FreeStiffness]] = {}
    while True:
        subdomain_task: SubdomainTask
        piece: SubdomainData | None
        try:
            subdomain_task, piece = pipe.recv()
        except EOFError:
            return
        if piece is not None:
            executor = Executor(piece.shape, piece.fabric, factorisers)
            free = subdomain_stiffness(piece.shape, piece.unknowns.tobytes())
            desks[subdomain_task.name] = executor, free
        pipe.send(solve_subdomain(*desks[subdomain_task.name], subdomain_task))


if __name__ == "__main__":
    # An interrupt is for the process that it works for, with which it ends.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with one_thread_of_blas():
        serve(Connection(int(sys.argv[1])))
