"""Factorisation of any sparsity: solutions, and definiteness by eigenvalues."""

import numpy as np
import scipy.sparse as sp
from hypothesis import given
from hypothesis import strategies as st

from knitlab.linalg.superlu import factorise


@given(st.integers(2, 12), st.integers(0, 2**32 - 1), st.floats(-2, 2))
def test_a_matrix_is_factorised_if_and_only_if_it_is_positive_definite(size, seed, shift):
    numbers = np.random.default_rng(seed)
    full = numbers.normal(size=(size, size)) * (numbers.random((size, size)) < 0.4)
    matrix = full + full.T + shift * np.eye(size)
    least = np.linalg.eigvalsh(matrix)[0]
    factors = factorise(sp.csc_array(matrix))
    if least > 1e-8:
        right = numbers.normal(size=size)
        np.testing.assert_allclose(matrix @ factors.solve(right), right, atol=1e-6)
    elif least < -1e-8:
        assert factors is None
