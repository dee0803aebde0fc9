"""BLAS calls against NumPy, on whole matrices and on parts of larger ones."""

import gc
import threading
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from knitlab.solvers.factorisation import blas

SIZES = st.integers(1, 9)
SEEDS = st.integers(0, 2**32 - 1)


class Samples:
    """Random matrices and vectors; a matrix may be part of a larger one."""

    def __init__(self, seed: int) -> None:
        self._random = np.random.default_rng(seed)

    def matrix(self, rows: int, columns: int) -> np.ndarray:
        above, beside = self._random.integers(0, 3, 2)
        whole = np.asfortranarray(self._random.normal(size=(rows + above, columns + beside)))
        return whole[above:, beside:]

    def triangle(self, size: int) -> np.ndarray:
        """A lower triangle, with entries above the diagonal that must not be read."""
        triangle = self.matrix(size, size)
        triangle[np.diag_indices(size)] = 1 + self._random.random(size)
        return triangle

    def positive_definite(self, size: int) -> np.ndarray:
        matrix = self.matrix(size, size)
        matrix[:] = matrix @ matrix.T + np.eye(size)
        return matrix

    def vector(self, size: int) -> np.ndarray:
        return self._random.normal(size=size)


def unset_status() -> np.ndarray:
    return np.full(1, 7, dtype=np.int32)


@given(SIZES, SIZES, SIZES, SEEDS)
def test_products(rows, columns, inner, seed):
    samples = Samples(seed)
    left, right = samples.matrix(rows, inner), samples.matrix(columns, inner)
    target = samples.matrix(rows, columns)
    expected = target - left @ right.T
    blas.run([blas.subtract_product(target, left, right)])
    np.testing.assert_allclose(target, expected, atol=1e-12)

    square = samples.matrix(rows, rows)
    before = square.copy()
    blas.run([blas.subtract_square(square, left)])
    np.testing.assert_allclose(np.tril(square), np.tril(before - left @ left.T), atol=1e-12)
    np.testing.assert_array_equal(np.triu(square, 1), np.triu(before, 1))

    triangle = samples.triangle(inner)
    expected = left @ np.tril(triangle).T
    blas.run([blas.multiply_by_transposed(left, triangle)])
    np.testing.assert_allclose(left, expected, atol=1e-12)


@given(SIZES, SIZES, SEEDS)
def test_products_with_vectors(rows, columns, seed):
    samples = Samples(seed)
    matrix, short, long = (
        samples.matrix(rows, columns),
        samples.vector(columns),
        samples.vector(rows),
    )
    overwritten = np.full(rows, np.nan)
    blas.run([blas.multiply(overwritten, matrix, short)])
    np.testing.assert_allclose(overwritten, matrix @ short, atol=1e-12)
    expected = short - matrix.T @ long
    blas.run([blas.subtract_transposed_product(short, matrix, long)])
    np.testing.assert_allclose(short, expected, atol=1e-12)


@given(SIZES, SEEDS)
def test_factors_and_triangles(size, seed):
    samples = Samples(seed)
    matrix, status = samples.positive_definite(size), unset_status()
    expected = np.linalg.cholesky(matrix)
    blas.run([blas.cholesky(matrix, status)])
    assert status[0] == 0
    np.testing.assert_allclose(np.tril(matrix), expected, atol=1e-12)

    triangle, vector = samples.triangle(size), samples.vector(size)
    lower = np.tril(triangle)
    for transposed in (False, True):
        solution = vector.copy()
        blas.run([blas.solve(triangle, solution, transposed)])
        np.testing.assert_allclose((lower.T if transposed else lower) @ solution, vector, atol=1e-9)
        blas.run([blas.multiply_by_triangle(triangle, solution, transposed)])
        np.testing.assert_allclose(solution, vector, atol=1e-9)
    inverse, status = np.asfortranarray(np.zeros((size, size))), unset_status()
    blas.run([blas.copy(inverse, triangle), blas.invert(inverse, status)])
    assert status[0] == 0
    np.testing.assert_allclose(inverse @ lower, np.eye(size), atol=1e-9)


def test_status_names_the_pivot_that_is_not_positive():
    matrix, status = np.asfortranarray(np.diag([1.0, -1.0, 1.0])), unset_status()
    blas.run([blas.cholesky(matrix, status)])
    assert status[0] == 2


@pytest.mark.slow
def test_a_call_keeps_its_arrays_alive():
    target = np.asfortranarray(np.zeros((300, 300)))
    call = blas.subtract_square(target, np.asfortranarray(np.full((300, 300), 2.0)))
    gc.collect()
    occupied = [np.full((300, 300), 9.0) for _ in range(20)]
    blas.run([call])
    np.testing.assert_allclose(np.tril(target), np.tril(np.full((300, 300), -1200.0)))
    assert occupied


def test_other_threads_run_during_a_call():
    factor, square = (np.asfortranarray(np.ones((1500, 1500))) for _ in range(2))
    call, times = blas.subtract_square(square, factor), list[float]()

    def work() -> None:
        times.append(time.perf_counter())
        blas.run([call])
        times.append(time.perf_counter())

    thread, ticks = threading.Thread(target=work), list[float]()
    thread.start()
    while thread.is_alive():
        ticks.append(time.perf_counter())
    began, ended = times
    margin = (ended - began) / 4
    assert any(began + margin < tick < ended - margin for tick in ticks)


def test_a_front_that_is_too_large_is_refused():
    matrix = np.lib.stride_tricks.as_strided(np.zeros(1), (2**16, 1), (0, 8))
    with pytest.raises(ValueError, match="a front has 65536 unknowns"):
        blas.cholesky(matrix, unset_status())
