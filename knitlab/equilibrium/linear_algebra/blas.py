"""Prepared calls of BLAS and LAPACK that release the global interpreter lock.

The functions of ``scipy.linalg.blas`` hold the lock while they work, so that two threads would
factorise no faster than one. The same routines, which SciPy exports to Cython and ctypes by their
addresses, do not need it, and ctypes releases it. The addresses of all arguments are prepared once
for matrices that stay in place.

All arrays of a call are of one precision, single or double. Matrices are in Fortran order; only the
lower triangle of a symmetric or triangular one is read.
"""

import ctypes
from collections.abc import Callable, Iterable
from types import ModuleType
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy import LowLevelCallable
from scipy.linalg import cython_blas, cython_lapack

Call = tuple[Callable[..., None], tuple[int, ...], tuple[np.ndarray, ...]]
"""A routine, the addresses of its arguments, and the arrays there, to keep them alive."""

Matrix = Float[np.ndarray, "_ _"]
Vector = Float[np.ndarray, " _"]
Status = Int[np.ndarray, "1"]
"""Status of a LAPACK call, a 32-bit integer; 0 if it succeeded."""


def run(calls: Iterable[Call]) -> None:
    """Run calls one after another."""
    for routine, addresses, _ in calls:
        routine(*addresses)


def _routine(module: ModuleType, name: str) -> Callable[..., None]:
    """A routine by name; as in Fortran, it takes the addresses of all arguments."""
    exported = LowLevelCallable.from_cython(module, name)
    address_of = ctypes.pythonapi.PyCapsule_GetPointer
    address_of.restype, address_of.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    arguments = [ctypes.c_void_p] * (exported.signature.count(",") + 1)
    address = address_of(exported.function, exported.signature.encode())
    return ctypes.CFUNCTYPE(None, *arguments)(address)


_INTEGERS = np.arange(2**16, dtype=np.int32)
_LETTERS = np.frombuffer(b"LNTR", dtype=np.uint8)
_FIRST_INTEGER = _INTEGERS.ctypes.data
_LOWER, _NOT, _TRANSPOSED, _RIGHT = (_LETTERS.ctypes.data + place for place in range(4))


class _Precision:
    """Routines and scalars of single or double precision.

    Args:
        letter: first letter of the names of its routines.
        kind: its numbers.
    """

    def __init__(self, letter: str, kind: type[np.floating[Any]]) -> None:
        self.lacpy, self.potrf, self.trtri = (
            _routine(cython_lapack, letter + name) for name in ("lacpy", "potrf", "trtri")
        )
        self.gemm, self.gemv, self.syrk, self.trmm, self.trmv, self.trsv = (
            _routine(cython_blas, letter + name)
            for name in ("gemm", "gemv", "syrk", "trmm", "trmv", "trsv")
        )
        self._scalars = np.array([1.0, -1.0, 0.0], dtype=kind)
        self.one, self.minus_one, self.zero = (
            self._scalars.ctypes.data + place * self._scalars.itemsize for place in range(3)
        )


_PRECISIONS = {
    np.dtype(np.float32): _Precision("s", np.float32),
    np.dtype(np.float64): _Precision("d", np.float64),
}


def copy(target: Matrix, triangle: Matrix) -> Call:
    """``target`` ← triangle."""
    precision = _PRECISIONS[target.dtype]
    return (
        precision.lacpy,
        (_LOWER, *_sizes(triangle), *_at(triangle), *_at(target)),
        (target, triangle),
    )


def cholesky(matrix: Matrix, status: Status) -> Call:
    """``matrix`` ← its Cholesky factor."""
    precision = _PRECISIONS[matrix.dtype]
    arguments = _LOWER, _integer(len(matrix)), *_at(matrix), status.ctypes.data
    return precision.potrf, arguments, (matrix, status)


def invert(triangle: Matrix, status: Status) -> Call:
    """``triangle`` ← triangle⁻¹."""
    precision = _PRECISIONS[triangle.dtype]
    arguments = _LOWER, _NOT, _integer(len(triangle)), *_at(triangle), status.ctypes.data
    return precision.trtri, arguments, (triangle, status)


def multiply_by_transposed(matrix: Matrix, triangle: Matrix) -> Call:
    """``matrix`` ← matrix × triangleᵀ."""
    precision = _PRECISIONS[matrix.dtype]
    options = _RIGHT, _LOWER, _TRANSPOSED, _NOT
    arguments = *options, *_sizes(matrix), precision.one, *_at(triangle), *_at(matrix)
    return precision.trmm, arguments, (matrix, triangle)


def subtract_product(matrix: Matrix, left: Matrix, right: Matrix) -> Call:
    """``matrix`` ← matrix − left × rightᵀ."""
    precision = _PRECISIONS[matrix.dtype]
    sizes = *_sizes(matrix), _integer(left.shape[1])
    operands = precision.minus_one, *_at(left), *_at(right), precision.one, *_at(matrix)
    return precision.gemm, (_NOT, _TRANSPOSED, *sizes, *operands), (matrix, left, right)


def subtract_square(matrix: Matrix, factor: Matrix) -> Call:
    """``matrix`` ← matrix − factor × factorᵀ."""
    precision = _PRECISIONS[matrix.dtype]
    operands = *_sizes(factor), precision.minus_one, *_at(factor), precision.one, *_at(matrix)
    return precision.syrk, (_LOWER, _NOT, *operands), (matrix, factor)


def solve(triangle: Matrix, vector: Vector, transposed: bool = False) -> Call:
    """``vector`` ← triangle⁻¹ × vector, or triangle⁻ᵀ × vector."""
    return _PRECISIONS[triangle.dtype].trsv, *_with_vector(triangle, vector, transposed)


def multiply_by_triangle(triangle: Matrix, vector: Vector, transposed: bool = False) -> Call:
    """``vector`` ← triangle × vector, or triangleᵀ × vector."""
    return _PRECISIONS[triangle.dtype].trmv, *_with_vector(triangle, vector, transposed)


def _with_vector(
    triangle: Matrix, vector: Vector, transposed: bool
) -> tuple[tuple[int, ...], tuple[np.ndarray, ...]]:
    """Addresses of a triangle and a vector that it is applied to, and these arrays."""
    options = _LOWER, _TRANSPOSED if transposed else _NOT, _NOT
    operands = _integer(len(triangle)), *_at(triangle), vector.ctypes.data, _integer(1)
    return (*options, *operands), (triangle, vector)


def multiply(target: Vector, matrix: Matrix, vector: Vector) -> Call:
    """``target`` ← matrix × vector."""
    precision = _PRECISIONS[target.dtype]
    ends = vector.ctypes.data, _integer(1), precision.zero, target.ctypes.data, _integer(1)
    arguments = _NOT, *_sizes(matrix), precision.one, *_at(matrix), *ends
    return precision.gemv, arguments, (target, matrix, vector)


def subtract_transposed_product(target: Vector, matrix: Matrix, vector: Vector) -> Call:
    """``target`` ← target − matrixᵀ × vector."""
    precision = _PRECISIONS[target.dtype]
    ends = vector.ctypes.data, _integer(1), precision.one, target.ctypes.data, _integer(1)
    arguments = _TRANSPOSED, *_sizes(matrix), precision.minus_one, *_at(matrix), *ends
    return precision.gemv, arguments, (target, matrix, vector)


def _integer(number: int) -> int:
    """Address of an integer.

    Raises:
        ValueError: if it is larger than any front of a sheet.
    """
    if number >= len(_INTEGERS):
        raise ValueError(
            f"a front has {number} unknowns; at most {len(_INTEGERS) - 1} are supported"
        )
    return _FIRST_INTEGER + _INTEGERS.itemsize * number


def _sizes(matrix: Matrix) -> tuple[int, int]:
    """Addresses of the numbers of rows and columns."""
    rows, columns = matrix.shape
    return _integer(rows), _integer(columns)


def _at(matrix: Matrix) -> tuple[int, int]:
    """Addresses of a matrix and of the distance between its columns."""
    # NumPy may give a single column any stride.
    distance = max(matrix.strides[1] // matrix.itemsize, len(matrix), 1)
    return matrix.ctypes.data, _integer(distance)
