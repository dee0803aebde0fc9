"""Factorisation of the stiffness by a sparse Cholesky, ordered by nested dissection.

The multifrontal method (:mod:`knitlab.equilibrium.linear_algebra`) is faster here than CHOLMOD,
PARDISO and SuperLU, with which ``benchmarks.solver`` compares it.
"""

from contextlib import AbstractContextManager
from typing import Protocol

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int
from threadpoolctl import ThreadpoolController

from knitlab.equilibrium.linear_algebra.multifrontal import Multifrontal, Precision
from knitlab.equilibrium.linear_algebra.symbolic_factorisation import (
    GridOrder,
    NestedDissection,
    grid_order,
    planned,
)
from knitlab.equilibrium.stiffness import FreeStiffness
from knitlab.fabric.network import MeshShape, cached_by_shape
from knitlab.fabric.threads import ALONE, Threads


class Factors(Protocol):
    """A factored matrix."""

    def solve(self, right: Float[np.ndarray, " free"], /) -> Float[np.ndarray, " free"]:
        """The x of matrix × x = ``right``."""
        ...

    def change_diagonal(
        self, unknowns: Int[np.ndarray, " changed"], changes: Float[np.ndarray, " changed"], /
    ) -> bool:
        """Change entries of the diagonal for the next solves.

        Returns whether the matrix is positive definite then; if not, it is as it was factorised.
        """
        ...


Entries = Float[np.ndarray, " nonzero"]


class Factoriser(Protocol):
    """Factorises matrices of one sparsity."""

    def __call__(self, entries: Entries, convexified: bool = False) -> Factors | None:
        """Factorise a matrix, or return ``None`` if it is not positive definite.

        Args:
            entries: its non-zeros. The factors are valid until the next call.
            convexified: whether to factorise a nearby positive definite matrix instead of failing.
        """
        ...


Factorisers = dict[tuple[FreeStiffness, bool], Factoriser]
"""Factorisers by free unknowns, and by whether they use double precision."""


def factoriser(
    free: FreeStiffness, threads: Threads = ALONE, precision: Precision = np.float64
) -> Factoriser:
    """Factoriser of the stiffness of the free unknowns of a mesh shape.

    The symbolic factorisation is done here, once for a mesh shape. All calls use the same memory:
    only one thread may factorise, solve or change the diagonal at a time.

    Args:
        free: the sparsity.
        threads: threads that may share a factorisation.
        precision: single or double; see :class:`.Multifrontal`.
    """
    factors = Multifrontal(_plan(free.shape, free), threads, precision)

    def factorise(entries: Entries, convexified: bool = False) -> Factors | None:
        return factors if factors.factorise(entries, convexified) else None

    return factorise


def factorise_with_contact(
    free: FreeStiffness,
    entries: Entries,
    contact: sp.csc_array,
    threads: Threads = ALONE,
) -> Factors | None:
    """Factorise the stiffness and the Hessian of contact, which may couple any unknowns.

    Returns ``None`` if their sum is not positive definite.

    The order is that of the grid; the symbolic factorisation is done again for every matrix, as the
    plies that touch change. It takes less time than the numeric one.

    Args:
        free: sparsity of the stiffness.
        entries: its non-zeros.
        contact: Hessian of the contact, both triangles.
        threads: threads that may share the factorisation.
    """
    whole = sp.csc_array(free.lower(entries) + sp.tril(contact))
    whole.sort_indices()
    factors = Multifrontal(planned(_order(free.shape, free), whole.indptr, whole.indices), threads)
    return factors if factors.factorise(whole.data) else None


def one_thread_of_blas() -> AbstractContextManager[object]:
    """Limit BLAS to one thread, as more threads slow down small fronts."""
    return ThreadpoolController().limit(limits=1, user_api="blas")


@cached_by_shape
def _order(shape: MeshShape, free: FreeStiffness) -> GridOrder:
    return grid_order(free.indptr, free.indices, *free.grid)


@cached_by_shape
def _plan(shape: MeshShape, free: FreeStiffness) -> NestedDissection:
    return planned(_order(shape, free), free.indptr, free.indices)
