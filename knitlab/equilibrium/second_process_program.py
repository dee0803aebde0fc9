"""Program of the second process: ``python -m knitlab.equilibrium.second_process_program``."""

import os
import pickle
import signal
import sys
from typing import IO

from knitlab.equilibrium.divided_system import solve_subdomain
from knitlab.equilibrium.factorisation import Factorisers, one_thread_of_blas
from knitlab.equilibrium.second_process import SubdomainData, SubdomainTask
from knitlab.equilibrium.stiffness import FreeStiffness, free_stiffness
from knitlab.equilibrium.system import System


def serve(requests: IO[bytes], replies: IO[bytes]) -> None:
    """Solve the requested subdomains until the other end closes the requests."""
    factorisers: Factorisers = {}
    systems: dict[tuple[int, int], tuple[System, FreeStiffness]] = {}
    while True:
        task: SubdomainTask
        subdomain: SubdomainData | None
        try:
            task, subdomain = pickle.load(requests)
        except EOFError:
            return
        if subdomain is not None:
            system = System(subdomain.shape, subdomain.fabric, factorisers)
            free = free_stiffness(subdomain.shape, subdomain.unknowns)
            systems[task.name] = system, free
        pickle.dump(solve_subdomain(*systems[task.name], task), replies)
        replies.flush()


if __name__ == "__main__":
    # The parent handles interrupts, and this process ends with it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # Printed text must not mix with the replies.
    with os.fdopen(os.dup(sys.stdout.fileno()), "wb") as replies:
        os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
        with one_thread_of_blas():
            serve(sys.stdin.buffer, replies)
