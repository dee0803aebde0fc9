"""CHOLMOD through the optional ``cvxopt`` (GPL), to compare knitlab's factorisation with."""

from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float

from knitlab.elasticity.element_chunks import ChunkedFabric
from knitlab.elasticity.stiffness import FreeStiffness
from knitlab.linalg.threads import Threads
from knitlab.model.fabric import Fabric
from knitlab.model.network import MeshShape
from knitlab.solvers.executor import Executor
from knitlab.solvers.solver import Assemble, ChangeDiagonal, Factorise, Request, Solve

SUPERNODAL = 2

Vector = Float[np.ndarray, " free"]
Entries = Float[np.ndarray, " nonzero"]
Solution = Callable[[Vector], Vector]
"""Solves with the last factor."""


def cholmod_factoriser(free: FreeStiffness) -> Callable[[Entries], Solution | None]:
    """What factors matrices of one sparsity; ``None`` of one that is not positive definite."""
    from cvxopt import cholmod, matrix, spmatrix

    size = len(free.places)
    columns = np.repeat(np.arange(size), np.diff(free.indptr))
    lower = spmatrix(1.0, free.indices.tolist(), columns.tolist(), (size, size))
    cholmod.options["supernodal"] = SUPERNODAL
    factor = cholmod.symbolic(lower)

    def solve(right: Vector) -> Vector:
        solution = matrix(right)
        cholmod.solve(factor, solution)
        return np.array(solution).ravel()

    def factorise(entries: Entries) -> Solution | None:
        if not np.isfinite(entries).all():
            return None
        lower.V = matrix(entries)
        try:
            cholmod.numeric(lower, factor)
        except ArithmeticError:
            return None
        return solve

    return factorise


class CholmodExecutor:
    """Answers a solver's requests as knitlab's executor does, but factors by CHOLMOD.

    Subdomains of a large sample are solved by knitlab's own factorisation. No matrix is
    convexified, nor any diagonal changed.

    Args:
        shape: mesh shape of the fabric.
        fabric: its numbers.
        threads: that share what CHOLMOD does not do.
    """

    def __init__(self, shape: MeshShape, fabric: Fabric, threads: Threads) -> None:
        self._others = Executor(shape, fabric, threads=threads)
        self._fabric = ChunkedFabric.of(shape, fabric, threads)
        self._threads = threads
        self._factorisers: dict[FreeStiffness, Callable[[Entries], Solution | None]] = {}
        self._free: FreeStiffness | None = None
        self._entries = np.zeros(0)
        self._solve: Solution | None = None

    def answer(self, request: Request) -> Any:
        """What a request asks for."""
        match request:
            case Assemble(configuration, free, stage):
                hessians = self._fabric.element_hessians(stage, configuration)
                self._free, self._entries = free, free.entries(hessians, self._threads)
                return None
            case Factorise(shift):
                return self._factorise(shift)
            case ChangeDiagonal():
                return False
            case Solve(right):
                if self._solve is None:
                    raise RuntimeError("nothing is factorised")
                return self._solve(right)
        return self._others.answer(request)

    def _factorise(self, shift: float) -> bool:
        free = self._free
        if free is None:
            raise RuntimeError("nothing is assembled")
        if free not in self._factorisers:
            self._factorisers[free] = cholmod_factoriser(free)
        self._solve = self._factorisers[free](free.shifted(self._entries, shift))
        return self._solve is not None
