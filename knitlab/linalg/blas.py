"""BLAS and LAPACK without the interpreter's lock.

SciPy's functions keep the lock while they work, so that two threads factor no faster than one. The
routines behind them, which SciPy lends to Cython and ctypes by their addresses, know of no lock,
and ctypes gives it up while they run. What one is to work on is noted beforehand, as addresses.

Matrices lie in Fortran's order; only the lower triangle of a symmetric or triangular one is read.
"""

import ctypes
from collections.abc import Callable, Iterable
from types import ModuleType

import numpy as np
from jaxtyping import Float, Int
from scipy import LowLevelCallable
from scipy.linalg import cython_blas, cython_lapack

Call = tuple[Callable[..., None], tuple[int, ...], tuple[np.ndarray, ...]]
"""A routine, the addresses of its arguments, and the arrays that lie there, lest they go."""

Matrix = Float[np.ndarray, "_ _"]
Vector = Float[np.ndarray, " _"]
Flag = Int[np.ndarray, "1"]
"""Status of a LAPACK call, an integer of 32 bits: 0 if it succeeded."""


def _routine(module: ModuleType, name: str) -> Callable[..., None]:
    """A routine by its name, to be called with addresses, as Fortran takes all its arguments."""
    lent = LowLevelCallable.from_cython(module, name)
    address = ctypes.pythonapi.PyCapsule_GetPointer
    address.restype, address.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    places = [ctypes.c_void_p] * (lent.signature.count(",") + 1)
    pointer = address(lent.function, lent.signature.encode())
    return ctypes.CFUNCTYPE(None, *places)(pointer)


_LACPY, _POTRF, _TRTRI = (_routine(cython_lapack, name) for name in ("dlacpy", "dpotrf", "dtrtri"))
_GEMM, _GEMV, _SYRK, _TRMM, _TRSV = (
    _routine(cython_blas, name) for name in ("dgemm", "dgemv", "dsyrk", "dtrmm", "dtrsv")
)

_COUNTS = np.arange(2**16, dtype=np.int32)
_NUMBERS = np.array([1.0, -1.0, 0.0])
_LETTERS = np.frombuffer(b"LNTR", dtype=np.uint8)
_ADD, _SUBTRACT, _FORGET = (_NUMBERS.ctypes.data + 8 * place for place in range(3))
_LOWER, _PLAIN, _TRANSPOSED, _RIGHT = (_LETTERS.ctypes.data + place for place in range(4))
_FIRST_COUNT = _COUNTS.ctypes.data


def carry_out(calls: Iterable[Call]) -> None:
    """Make calls, one after the other."""
    for routine, places, _ in calls:
        routine(*places)


def copied(into: Matrix, triangle: Matrix) -> Call:
    """``into`` ← triangle."""
    places = _LOWER, *_counts(triangle), *_of(triangle), *_of(into)
    return _LACPY, places, (into, triangle)


def cholesky(matrix: Matrix, failed: Flag) -> Call:
    """``matrix`` ← its Cholesky factor."""
    places = _LOWER, _count(len(matrix)), *_of(matrix), failed.ctypes.data
    return _POTRF, places, (matrix, failed)


def inverse(triangle: Matrix, failed: Flag) -> Call:
    """``triangle`` ← its inverse."""
    size = _count(len(triangle))
    places = _LOWER, _PLAIN, size, *_of(triangle), failed.ctypes.data
    return _TRTRI, places, (triangle, failed)


def times_transposed(matrix: Matrix, triangle: Matrix) -> Call:
    """``matrix`` ← matrix × triangleᵀ."""
    sides = _RIGHT, _LOWER, _TRANSPOSED, _PLAIN
    places = *sides, *_counts(matrix), _ADD, *_of(triangle), *_of(matrix)
    return _TRMM, places, (matrix, triangle)


def minus_product(matrix: Matrix, one: Matrix, other: Matrix) -> Call:
    """``matrix`` ← matrix − one × otherᵀ."""
    sizes = *_counts(matrix), _count(one.shape[1])
    parts = *_of(one), *_of(other), _ADD, *_of(matrix)
    return _GEMM, (_PLAIN, _TRANSPOSED, *sizes, _SUBTRACT, *parts), (matrix, one, other)


def minus_square(matrix: Matrix, factor: Matrix) -> Call:
    """``matrix`` ← matrix − factor × factorᵀ."""
    parts = *_counts(factor), _SUBTRACT, *_of(factor), _ADD, *_of(matrix)
    return _SYRK, (_LOWER, _PLAIN, *parts), (matrix, factor)


def substituted(triangle: Matrix, vector: Vector, transposed: bool = False) -> Call:
    """``vector`` ← triangle⁻¹ × vector, or triangle⁻ᵀ × vector."""
    how = _LOWER, _TRANSPOSED if transposed else _PLAIN, _PLAIN
    places = *how, _count(len(triangle)), *_of(triangle), vector.ctypes.data, _count(1)
    return _TRSV, places, (triangle, vector)


def product(vector: Vector, matrix: Matrix, factor: Vector) -> Call:
    """``vector`` ← matrix × factor."""
    ends = factor.ctypes.data, _count(1), _FORGET, vector.ctypes.data, _count(1)
    places = _PLAIN, *_counts(matrix), _ADD, *_of(matrix), *ends
    return _GEMV, places, (vector, matrix, factor)


def minus_transposed_product(vector: Vector, matrix: Matrix, factor: Vector) -> Call:
    """``vector`` ← vector − matrixᵀ × factor."""
    ends = factor.ctypes.data, _count(1), _ADD, vector.ctypes.data, _count(1)
    places = _TRANSPOSED, *_counts(matrix), _SUBTRACT, *_of(matrix), *ends
    return _GEMV, places, (vector, matrix, factor)


def _count(number: int) -> int:
    """Where a whole number is to be found.

    Raises:
        ValueError: if it is larger than any front of a sheet.
    """
    if number >= len(_COUNTS):
        raise ValueError(f"{number} unknowns in one front; at most {len(_COUNTS) - 1} can be")
    return _FIRST_COUNT + _COUNTS.itemsize * number


def _counts(matrix: Matrix) -> tuple[int, int]:
    """Where its numbers of rows and of columns are to be found."""
    rows, columns = matrix.shape
    return _count(rows), _count(columns)


def _of(matrix: Matrix) -> tuple[int, int]:
    """Where a matrix is to be found, and the distance of its columns."""
    # NumPy gives a single column any stride.
    distance = max(matrix.strides[1] // matrix.itemsize, len(matrix), 1)
    return matrix.ctypes.data, _count(distance)
