"""BLAS by address: every call against NumPy, in matrices and in parts of larger ones."""

import gc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from knitlab.linalg import blas
from knitlab.linalg.blas import carry_out

SIZES = st.integers(1, 9)
SEEDS = st.integers(0, 2**32 - 1)


class Made:
    """Random matrices and vectors, each a part of a larger one or not."""

    def __init__(self, seed: int) -> None:
        self._random = np.random.default_rng(seed)

    def matrix(self, rows: int, columns: int) -> np.ndarray:
        above, beside = self._random.integers(0, 3, 2)
        whole = np.asfortranarray(self._random.normal(size=(rows + above, columns + beside)))
        return whole[above:, beside:]

    def triangle(self, size: int) -> np.ndarray:
        """With something above the diagonal that is not to be read."""
        triangle = self.matrix(size, size)
        triangle[np.diag_indices(size)] = 1 + self._random.random(size)
        return triangle

    def definite(self, size: int) -> np.ndarray:
        matrix = self.matrix(size, size)
        matrix[:] = matrix @ matrix.T + np.eye(size)
        return matrix

    def vector(self, size: int) -> np.ndarray:
        return self._random.normal(size=size)


def flag() -> np.ndarray:
    return np.full(1, 7, dtype=np.int32)


@given(SIZES, SIZES, SIZES, SEEDS)
def test_products(rows, columns, inner, seed):
    made = Made(seed)
    one, other = made.matrix(rows, inner), made.matrix(columns, inner)
    target = made.matrix(rows, columns)
    expected = target - one @ other.T
    carry_out([blas.minus_product(target, one, other)])
    np.testing.assert_allclose(target, expected, atol=1e-12)

    square = made.matrix(rows, rows)
    before = square.copy()
    carry_out([blas.minus_square(square, one)])
    np.testing.assert_allclose(np.tril(square), np.tril(before - one @ one.T), atol=1e-12)
    np.testing.assert_array_equal(np.triu(square, 1), np.triu(before, 1))

    triangle = made.triangle(inner)
    expected = one @ np.tril(triangle).T
    carry_out([blas.times_transposed(one, triangle)])
    np.testing.assert_allclose(one, expected, atol=1e-12)


@given(SIZES, SIZES, SEEDS)
def test_products_with_vectors(rows, columns, seed):
    made = Made(seed)
    matrix, along, across = made.matrix(rows, columns), made.vector(columns), made.vector(rows)
    forgotten = np.full(rows, np.nan)
    carry_out([blas.product(forgotten, matrix, along)])
    np.testing.assert_allclose(forgotten, matrix @ along, atol=1e-12)
    expected = along - matrix.T @ across
    carry_out([blas.minus_transposed_product(along, matrix, across)])
    np.testing.assert_allclose(along, expected, atol=1e-12)


@given(SIZES, SEEDS)
def test_factors_and_triangles(size, seed):
    made = Made(seed)
    matrix, failed = made.definite(size), flag()
    expected = np.linalg.cholesky(matrix)
    carry_out([blas.cholesky(matrix, failed)])
    assert not failed[0]
    np.testing.assert_allclose(np.tril(matrix), expected, atol=1e-12)

    triangle, vector = made.triangle(size), made.vector(size)
    lower = np.tril(triangle)
    for transposed in (False, True):
        solution = vector.copy()
        carry_out([blas.substituted(triangle, solution, transposed)])
        np.testing.assert_allclose((lower.T if transposed else lower) @ solution, vector, atol=1e-9)
    here, failed = np.asfortranarray(np.zeros((size, size))), flag()
    carry_out([blas.copied(here, triangle), blas.inverse(here, failed)])
    assert not failed[0]
    np.testing.assert_allclose(here @ lower, np.eye(size), atol=1e-9)


def test_what_is_not_positive_definite_is_told():
    matrix, failed = np.asfortranarray(np.diag([1.0, -1.0, 1.0])), flag()
    carry_out([blas.cholesky(matrix, failed)])
    assert failed[0] == 2


def test_a_call_keeps_its_arrays():
    def noted():
        inner = np.asfortranarray(np.full((300, 300), 2.0))
        return blas.minus_square(target, inner)

    target = np.asfortranarray(np.zeros((300, 300)))
    call = noted()
    gc.collect()
    occupied = [np.full((300, 300), 9.0) for _ in range(20)]
    carry_out([call])
    np.testing.assert_allclose(np.tril(target), np.tril(np.full((300, 300), -1200.0)))
    assert occupied


def test_a_front_that_is_too_large_is_named():
    matrix = np.lib.stride_tricks.as_strided(np.zeros(1), (2**16, 1), (0, 8))
    with pytest.raises(ValueError, match="65536 unknowns in one front"):
        blas.cholesky(matrix, flag())
