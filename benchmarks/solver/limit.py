"""How close to the limit one iteration is: its parts, and other sparse Cholesky factorisations.

Every method factors one and the same matrix, the stiffness of a clamped sample laid out of relaxed
periodic fabric. Its plan, which is made once for a sparsity, is timed apart.
"""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from benchmarks.solver.cholmod import CholmodFactors, Vector
from benchmarks.solver.measurement import Measurement, Record
from knitlab.model.energy import COMPLETE
from knitlab.model.threads import Threads, allowed_threads
from knitlab.runs.simulate import starts
from knitlab.solvers.element_chunks import ChunkedFabric
from knitlab.solvers.equilibrium.loading import loading_of
from knitlab.solvers.equilibrium.stiffness import FreeStiffness, free_stiffness
from knitlab.solvers.equilibrium.system import one_thread_of_blas
from knitlab.solvers.factorisation.multifrontal import Multifrontal

TIMED, LONG = 5, 30.0
"""Times that a part is done after a first that is not counted, and time after which no more [s]."""
SHIFT = 0.1
"""Added to the diagonal, so that the matrix is positive definite whatever buckles [N/mm]."""
SYMMETRIC_DEFINITE, SYMBOLIC, NUMERIC, BACKWARD = 2, 11, 22, 33

Plan = tuple[Callable[[], Any], Callable[[Any], Vector]]
"""The numeric factorisation, and the solution with what that returned. SuperLU's alone includes
its symbolic one: it has no way to keep it."""


def _nested_dissection(free: FreeStiffness, entries: np.ndarray, right: Vector) -> Plan:
    # As knitlab uses it: threads of its own, and of BLAS one.
    factors = Multifrontal(free.plan, Threads(allowed_threads()))

    def factorise() -> Any:
        with one_thread_of_blas():
            return factors.factorise(entries)

    return factorise, lambda _: factors.solve(right)


def _cholmod(free: FreeStiffness, entries: np.ndarray, right: Vector) -> Plan:
    factors = CholmodFactors(free)
    return lambda: factors.factorise(entries), lambda _: factors.solve(right)


def _pardiso(free: FreeStiffness, entries: np.ndarray, right: Vector) -> Plan:
    from pypardiso import PyPardisoSolver

    solver = PyPardisoSolver(mtype=SYMMETRIC_DEFINITE)
    # The columns of the lower triangle are the rows of the upper, which is what it takes.
    upper = sp.csr_matrix(free.lower(entries).T)
    upper.sort_indices()

    def phase(number: int) -> Any:
        solver.set_phase(number)
        return solver._call_pardiso(upper, right)

    phase(SYMBOLIC)
    return lambda: phase(NUMERIC), lambda _: phase(BACKWARD)


def _superlu(free: FreeStiffness, entries: np.ndarray, right: Vector) -> Plan:
    lower = free.lower(entries)
    matrix = sp.csc_matrix(lower + sp.tril(lower, -1).T)

    def factorise() -> Any:
        symmetric = {"SymmetricMode": True}
        return splu(matrix, "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=symmetric)

    return factorise, lambda factors: factors.solve(right)


FACTORISATIONS = {
    "nested_dissection": _nested_dissection,
    "cholmod": _cholmod,
    "pardiso": _pardiso,
    "superlu": _superlu,
}


def measure(measurement: Measurement) -> Record:
    """Time the parts of one iteration with one method of factorisation."""
    case = measurement.case()
    net, fabric = case.assemble()
    (start,) = starts([case])
    if start is None:
        raise RuntimeError("periodic fabric did not relax")
    shape, unknowns = net.shape, np.asarray(start.flattened())
    sample = ChunkedFabric(shape, fabric, Threads(allowed_threads()))
    free = free_stiffness(shape, loading_of(shape, start).free)

    def assembled() -> np.ndarray:
        return free.shifted(free.entries(sample.element_hessians(COMPLETE, unknowns)), SHIFT)

    def evaluated() -> Vector:
        return np.asarray(sample.evaluate(COMPLETE, unknowns).gradient)[free.dofs]

    hessian_seconds, entries = _timed(assembled)
    evaluation_seconds, gradient = _timed(evaluated)
    right = -gradient
    began = time.perf_counter()
    factorise, solve = FACTORISATIONS[measurement.solver](free, entries, right)
    symbolic_seconds = time.perf_counter() - began
    factorise_seconds, factors = _timed(factorise)
    solve_seconds, solution = _timed(lambda: solve(factors))
    lower = free.lower(entries)
    left = lower @ solution + sp.tril(lower, -1).T @ solution - right
    return {
        "reached": True,
        "reason": "",
        "nodes": shape.nodes,
        "unknowns": len(free.dofs),
        "residual": float(np.abs(left).max()),
        "seconds": hessian_seconds + factorise_seconds + solve_seconds + evaluation_seconds,
        "symbolic_seconds": symbolic_seconds,
        "hessian_seconds": hessian_seconds,
        "factorise_seconds": factorise_seconds,
        "solve_seconds": solve_seconds,
        "evaluation_seconds": evaluation_seconds,
    }


def _timed(part: Callable[[], Any]) -> tuple[float, Any]:
    """Median time of a part after a first that is not counted, and what it returned [s]."""
    result, seconds = part(), list[float]()
    while len(seconds) < TIMED and sum(seconds) < LONG:
        began = time.perf_counter()
        result = part()
        seconds.append(time.perf_counter() - began)
    return float(np.median(seconds)), result
