"""Factorisation of the stiffness by a sparse Cholesky.

The package's own nested dissection (:mod:`knitlab.linalg.symbolic_factorisation`) is the fastest
that was measured in knitlab; CHOLMOD, of the optional ``cvxopt`` under the GPL, is there to be
compared with.
"""

import threading
from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import lru_cache
from typing import Any, Protocol

import numpy as np
from jaxtyping import Float
from threadpoolctl import ThreadpoolController

from knitlab.linalg.multifrontal import Multifrontal
from knitlab.linalg.symbolic_factorisation import NestedDissection, nested_dissection
from knitlab.linalg.threads import ALONE, Threads
from knitlab.mechanics.stiffness import FreeStiffness


class Factors(Protocol):
    """A factored matrix."""

    def solve(self, right: Float[np.ndarray, " free"], /) -> Float[np.ndarray, " free"]:
        """The x of matrix × x = ``right``."""
        ...


DEFAULT_METHOD = "nested_dissection"
Entries = Float[np.ndarray, " nonzero"]


class Factoriser(Protocol):
    """A way to factor the matrices of one sparsity."""

    def __call__(self, entries: Entries, convexified: bool = False) -> Factors | None:
        """Factor a matrix, or return ``None`` if it is not positive definite.

        Args:
            entries: its non-zeros. The factors hold until the next call by the same thread.
            convexified: whether to factor, if it is not, a matrix nearby that is. Only nested
                dissection can.
        """
        ...


def factoriser(
    free: FreeStiffness, method: str | None = None, threads: Threads = ALONE
) -> Factoriser:
    """Factoriser of the stiffness of a mesh shape's free unknowns.

    Its plan is made here; nested dissection keeps it, so that it is made once a mesh shape.

    Args:
        free: the sparsity.
        method: a key of :data:`METHODS`; nested dissection by default.
        threads: that may share a factorisation; only nested dissection uses them.
    """
    return METHODS[method or DEFAULT_METHOD](free, threads)


def one_thread_of_blas() -> AbstractContextManager[object]:
    """Within it BLAS uses one thread: on small fronts a second costs more than it brings."""
    return ThreadpoolController().limit(limits=1, user_api="blas")


@lru_cache(maxsize=8)
def _plan(free: FreeStiffness) -> NestedDissection:
    return nested_dissection(free.indptr, free.indices, *free.grid)


def _nested_dissection(free: FreeStiffness, threads: Threads) -> Factoriser:
    plan, own = _plan(free), threading.local()

    def factorise(entries: Entries, convexified: bool = False) -> Factors | None:
        # What factors for several threads at the same time has memory for each.
        if not hasattr(own, "factors"):
            own.factors = Multifrontal(plan, threads)
        factors: Multifrontal = own.factors
        return factors if factors.factorise(entries, convexified) else None

    return factorise


class _CholmodFactors:
    def __init__(self, cholmod: Any, factor: Any, matrix: Callable[..., Any]) -> None:
        self._cholmod, self._factor, self._matrix = cholmod, factor, matrix

    def solve(self, right: Float[np.ndarray, " free"], /) -> Float[np.ndarray, " free"]:
        """The x of matrix × x = ``right``."""
        solution = self._matrix(right)
        self._cholmod.solve(self._factor, solution)
        return np.array(solution).ravel()


def _cholmod(free: FreeStiffness, threads: Threads) -> Factoriser:
    from cvxopt import cholmod, matrix, spmatrix

    size = len(free.places)
    columns = np.repeat(np.arange(size), np.diff(free.indptr))
    lower = spmatrix(1.0, free.indices.tolist(), columns.tolist(), (size, size))
    cholmod.options["supernodal"] = 2
    factor = cholmod.symbolic(lower)

    def factorise(entries: Entries, convexified: bool = False) -> Factors | None:
        if not np.isfinite(entries).all():
            return None
        lower.V = matrix(entries)
        try:
            cholmod.numeric(lower, factor)
        except ArithmeticError:
            return None
        return _CholmodFactors(cholmod, factor, matrix)

    return factorise


METHODS: dict[str, Callable[[FreeStiffness, Threads], Factoriser]] = {
    "nested_dissection": _nested_dissection,
    "cholmod": _cholmod,
}
