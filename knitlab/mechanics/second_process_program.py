"""``python -m knitlab.mechanics.second_process_program PIPE``: what a companion runs."""

import signal
import sys
from multiprocessing.connection import Connection

from knitlab.mechanics.executor import Desk, settled_block
from knitlab.mechanics.factorisation import Factoriser, one_thread_of_blas
from knitlab.mechanics.second_process import Errand, Piece
from knitlab.mechanics.stiffness import FreeStiffness
from knitlab.mechanics.subdomains import block_stiffness


def serve(pipe: Connection) -> None:
    """Settle what comes through the pipe until it is closed at the other end."""
    factorisers: dict[FreeStiffness, Factoriser] = {}
    desks: dict[tuple[int, int], tuple[Desk, FreeStiffness]] = {}
    while True:
        errand: Errand
        piece: Piece | None
        try:
            errand, piece = pipe.recv()
        except EOFError:
            return
        if piece is not None:
            desk = Desk(piece.shape, piece.fabric, piece.method, factorisers)
            free = block_stiffness(piece.shape, piece.unknowns.tobytes())
            desks[errand.name] = desk, free
        pipe.send(settled_block(*desks[errand.name], errand))


if __name__ == "__main__":
    # An interrupt is for the process that it works for, with which it ends.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with one_thread_of_blas():
        serve(Connection(int(sys.argv[1])))
