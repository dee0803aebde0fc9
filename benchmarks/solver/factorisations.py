"""Sparse Cholesky factorisations of one matrix: knitlab's, CHOLMOD, Pardiso, SuperLU.

The matrix is the stiffness of a clamped sample laid out of relaxed periodic fabric. The plan of a
factorisation, which is made once for a sparsity, is not part of it; SuperLU cannot keep its own.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from knitlab.io.job_limits import threads
from knitlab.model.energy import COMPLETE
from knitlab.model.threads import Threads
from knitlab.solvers.case import Case
from knitlab.solvers.element_chunks import ChunkedFabric
from knitlab.solvers.equilibrium.stiffness import FreeStiffness, free_stiffness
from knitlab.solvers.equilibrium.system import one_thread_of_blas
from knitlab.solvers.equilibrium.tests_of_cases import tilings
from knitlab.solvers.factorisation.multifrontal import Multifrontal
from knitlab.solvers.loads.loading import loading_of

SHIFT = 0.1  # added to the diagonal [N/mm], so that the matrix is positive definite
SYMMETRIC_DEFINITE, SYMBOLIC, NUMERIC = 2, 11, 22  # numbers of Pardiso
SUPERNODAL = 2  # of CHOLMOD


@dataclass(frozen=True)
class Stiffness:
    """A matrix to factorise: its sparsity and its lower entries [N/mm]."""

    free: FreeStiffness
    entries: np.ndarray

    @classmethod
    def of_case(cls, case: Case) -> "Stiffness":
        """The stiffness of a sample that starts as relaxed periodic fabric."""
        net, fabric = case.assemble()
        (start,) = tilings([case])
        if start is None:
            raise RuntimeError("periodic fabric did not relax")
        sample = ChunkedFabric(net.shape, fabric, Threads(threads()))
        free = free_stiffness(net.shape, loading_of(net.shape, start).free)
        hessians = sample.element_hessians(COMPLETE, np.asarray(start.flattened()))
        return cls(free, free.shifted(free.entries(hessians), SHIFT))


def nested_dissection(matrix: Stiffness) -> Callable[[], Any]:
    """The factorisation of knitlab, as it uses it: threads of its own, and of BLAS one."""
    factors = Multifrontal(matrix.free.plan, Threads(threads()))

    def factorise() -> Any:
        with one_thread_of_blas():
            return factors.factorise(matrix.entries)

    return factorise


def cholmod(matrix: Stiffness) -> Callable[[], Any]:
    """CHOLMOD through cvxopt (GPL)."""
    cvxopt = pytest.importorskip("cvxopt")
    free, size = matrix.free, len(matrix.free.dofs)
    columns = np.repeat(np.arange(size), np.diff(free.indptr))
    lower = cvxopt.spmatrix(1.0, free.indices.tolist(), columns.tolist(), (size, size))
    cvxopt.cholmod.options["supernodal"] = SUPERNODAL
    factor = cvxopt.cholmod.symbolic(lower)
    lower.V = cvxopt.matrix(matrix.entries)
    return lambda: cvxopt.cholmod.numeric(lower, factor)


def pardiso(matrix: Stiffness) -> Callable[[], Any]:
    """Intel's Pardiso."""
    solver = pytest.importorskip("pypardiso").PyPardisoSolver(mtype=SYMMETRIC_DEFINITE)
    # The columns of the lower triangle are the rows of the upper, which is what it takes.
    upper = sp.csr_matrix(matrix.free.lower(matrix.entries).T)
    upper.sort_indices()

    def phase(number: int) -> Any:
        solver.set_phase(number)
        return solver._call_pardiso(upper, np.ones(upper.shape[0]))

    phase(SYMBOLIC)
    return lambda: phase(NUMERIC)


def superlu(matrix: Stiffness) -> Callable[[], Any]:
    """SciPy's SuperLU, its symbolic factorisation included."""
    lower = matrix.free.lower(matrix.entries)
    whole = sp.csc_matrix(lower + sp.tril(lower, -1).T)
    options = {"SymmetricMode": True}
    return lambda: splu(whole, "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
