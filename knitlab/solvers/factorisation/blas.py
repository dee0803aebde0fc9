"""Prepared calls of BLAS and LAPACK that release the global interpreter lock.

``scipy.linalg.blas`` holds the lock, so that two threads would factorise no faster than one. The
same routines, which SciPy exports by their addresses, are called through ctypes, which releases it;
addresses of arguments are prepared once for matrices that stay in place.

All arrays of a call are of one precision. Matrices are in Fortran order; only the lower triangle of
a symmetric or triangular one is read.
"""

import ctypes
from collections.abc import Callable, Iterable
from functools import cache

import numpy as np
from jaxtyping import Float, Int
from scipy import LowLevelCallable
from scipy.linalg import cython_blas, cython_lapack

Call = tuple[Callable[..., None], list[int], tuple[object, ...]]  # routine, addresses, arguments

Matrix = Float[np.ndarray, "_ _"]
Vector = Float[np.ndarray, " _"]
Status = Int[np.ndarray, "1"]  # status of a LAPACK call, a 32-bit integer; 0 if it succeeded

_INTEGERS = np.arange(2**16, dtype=np.int32)
_LETTERS = np.frombuffer(b"LNTR", dtype=np.uint8)
_SCALARS = {letter: np.array([-1, 0, 1], dtype=letter) for letter in "fd"}
_FIRST_INTEGER = _INTEGERS.ctypes.data
_ONE = _INTEGERS[1:].ctypes.data
_LETTER_AT = {letter: _LETTERS.ctypes.data + k for k, letter in enumerate("LNTR")}
_SCALAR_AT = {
    (letter, value): scalars.ctypes.data + k * scalars.itemsize
    for letter, scalars in _SCALARS.items()
    for k, value in enumerate((-1.0, 0.0, 1.0))
}


def run(calls: Iterable[Call]) -> None:
    """Run calls one after another."""
    for routine, addresses, _ in calls:
        routine(*addresses)


def copy(target: Matrix, triangle: Matrix) -> Call:
    """``target`` ← triangle."""
    return _call("lacpy", "L", *triangle.shape, triangle, target)


def cholesky(matrix: Matrix, status: Status) -> Call:
    """``matrix`` ← its Cholesky factor."""
    return _call("potrf", "L", len(matrix), matrix, status)


def invert(triangle: Matrix, status: Status) -> Call:
    """``triangle`` ← triangle⁻¹."""
    return _call("trtri", "L", "N", len(triangle), triangle, status)


def multiply_by_transposed(matrix: Matrix, triangle: Matrix) -> Call:
    """``matrix`` ← matrix × triangleᵀ."""
    return _call("trmm", "R", "L", "T", "N", *matrix.shape, 1.0, triangle, matrix)


def subtract_product(matrix: Matrix, left: Matrix, right: Matrix) -> Call:
    """``matrix`` ← matrix − left × rightᵀ."""
    sizes = *matrix.shape, left.shape[1]
    return _call("gemm", "N", "T", *sizes, -1.0, left, right, 1.0, matrix)


def subtract_square(matrix: Matrix, factor: Matrix) -> Call:
    """``matrix`` ← matrix − factor × factorᵀ."""
    return _call("syrk", "L", "N", *factor.shape, -1.0, factor, 1.0, matrix)


def solve(triangle: Matrix, vector: Vector, transposed: bool = False) -> Call:
    """``vector`` ← triangle⁻¹ × vector, or triangle⁻ᵀ × vector."""
    return _call("trsv", "L", "T" if transposed else "N", "N", len(triangle), triangle, vector)


def multiply_by_triangle(triangle: Matrix, vector: Vector, transposed: bool = False) -> Call:
    """``vector`` ← triangle × vector, or triangleᵀ × vector."""
    return _call("trmv", "L", "T" if transposed else "N", "N", len(triangle), triangle, vector)


def multiply(target: Vector, matrix: Matrix, vector: Vector) -> Call:
    """``target`` ← matrix × vector."""
    return _call("gemv", "N", *matrix.shape, 1.0, matrix, vector, 0.0, target)


def subtract_transposed_product(target: Vector, matrix: Matrix, vector: Vector) -> Call:
    """``target`` ← target − matrixᵀ × vector."""
    return _call("gemv", "T", *matrix.shape, -1.0, matrix, vector, 1.0, target)


def _call(name: str, *arguments: str | int | float | np.ndarray) -> Call:
    """A call of a routine, named without its letter of precision."""
    kind = next(each.dtype.char for each in arguments if isinstance(each, np.ndarray))
    addresses: list[int] = []
    for each in arguments:
        if isinstance(each, str):
            addresses.append(_LETTER_AT[each])
        elif isinstance(each, float):
            addresses.append(_SCALAR_AT[kind, each])
        elif isinstance(each, int):
            addresses.append(_integer(each))
        else:
            addresses.append(each.ctypes.data)
            if each.ndim == 2:
                # NumPy may give a single column any stride.
                distance = max(each.strides[1] // each.itemsize, len(each), 1)
                addresses.append(_integer(distance))
            elif each.dtype.char == kind:
                addresses.append(_ONE)
    return _routine(name, kind), addresses, arguments


def _integer(number: int) -> int:
    if number >= len(_INTEGERS):
        raise ValueError(
            f"a front has {number} unknowns; at most {len(_INTEGERS) - 1} are supported"
        )
    return _FIRST_INTEGER + _INTEGERS.itemsize * number


@cache
def _routine(name: str, kind: str) -> Callable[..., None]:
    """A routine in single (``f``) or double precision; it takes the addresses of all arguments."""
    module = cython_lapack if name in ("lacpy", "potrf", "trtri") else cython_blas
    exported = LowLevelCallable.from_cython(module, {"f": "s", "d": "d"}[kind] + name)
    address_of = ctypes.pythonapi.PyCapsule_GetPointer
    address_of.restype = ctypes.c_void_p
    address_of.argtypes = [ctypes.py_object, ctypes.c_char_p]
    arguments = [ctypes.c_void_p] * (exported.signature.count(",") + 1)
    address = address_of(exported.function, exported.signature.encode())
    return ctypes.CFUNCTYPE(None, *arguments)(address)
