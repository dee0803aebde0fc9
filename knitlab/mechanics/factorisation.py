"""Factorisation of the stiffness by a sparse Cholesky, ordered by nested dissection.

:mod:`knitlab.linalg.symbolic_factorisation` is the fastest that was measured in knitlab:
``benchmarks.solver`` compares it with CHOLMOD, PARDISO and SuperLU.
"""

import threading
from contextlib import AbstractContextManager
from functools import lru_cache
from typing import Protocol

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


Entries = Float[np.ndarray, " nonzero"]


class Factoriser(Protocol):
    """A way to factor the matrices of one sparsity."""

    def __call__(self, entries: Entries, convexified: bool = False) -> Factors | None:
        """Factor a matrix, or return ``None`` if it is not positive definite.

        Args:
            entries: its non-zeros. The factors hold until the next call by the same thread.
            convexified: whether to factor, if it is not, a matrix nearby that is.
        """
        ...


def factoriser(free: FreeStiffness, threads: Threads = ALONE) -> Factoriser:
    """Factoriser of the stiffness of a mesh shape's free unknowns.

    Its plan is made here, once for a mesh shape.

    Args:
        free: the sparsity.
        threads: that may share a factorisation.
    """
    plan, own = _plan(free), threading.local()

    def factorise(entries: Entries, convexified: bool = False) -> Factors | None:
        # What factors for several threads at the same time has memory for each.
        if not hasattr(own, "factors"):
            own.factors = Multifrontal(plan, threads)
        factors: Multifrontal = own.factors
        return factors if factors.factorise(entries, convexified) else None

    return factorise


def one_thread_of_blas() -> AbstractContextManager[object]:
    """Within it BLAS uses one thread: on small fronts a second costs more than it brings."""
    return ThreadpoolController().limit(limits=1, user_api="blas")


@lru_cache(maxsize=8)
def _plan(free: FreeStiffness) -> NestedDissection:
    return nested_dissection(free.indptr, free.indices, *free.grid)
