from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.sparse as sp

from knitlab.linalg.block_tridiagonal import (
    BlockFactors,
    BlockTridiagonal,
    block_tridiagonal,
    narrower,
)
from knitlab.model.network import MeshShape, network

factorise = jax.jit(BlockTridiagonal.factorise)
factorise_all = jax.jit(jax.vmap(BlockTridiagonal.factorise, (None, 0)))
solve, solve_all = jax.jit(BlockFactors.solve), jax.jit(jax.vmap(BlockFactors.solve))


@dataclass
class Case:
    full: np.ndarray
    plan: BlockTridiagonal
    lower: tuple[np.ndarray, np.ndarray]

    def shifted(self, shift: float) -> np.ndarray:
        return self.full + shift * np.eye(len(self.full))

    def entries(self, shift: float) -> jnp.ndarray:
        return jnp.asarray(self.shifted(shift)[self.lower])


def clamped(shape: MeshShape) -> np.ndarray:
    return np.arange(3 * shape.nodes_x, 3 * (shape.nodes - shape.nodes_x))


def unpinned(shape: MeshShape) -> np.ndarray:
    return np.arange(3 * shape.nodes)


def one_length(shape: MeshShape) -> np.ndarray:
    return np.arange(shape.unknowns - 1)


def two_lengths(shape: MeshShape) -> np.ndarray:
    return np.arange(shape.unknowns)


def random_stiffness(shape: MeshShape) -> np.ndarray:
    """Positive semidefinite, like the stiffness of springs in tension and of hinges."""
    rng, full, net = np.random.default_rng(0), np.zeros((shape.unknowns,) * 2), network(shape)
    for elements in (net.springs, net.hinges):
        for nodes, periods in zip(elements.nodes, elements.periods.T, strict=True):
            slope = np.zeros((len(elements.ends), 3, shape.unknowns))
            for vector, (start, end) in zip(slope, elements.ends, strict=True):
                vector[range(3), 3 * nodes[end] + range(3)] += 1
                vector[range(3), 3 * nodes[start] + range(3)] -= 1
            slope[:, range(2), 3 * shape.nodes + np.arange(2)] = periods.T
            slope = slope.reshape(-1, shape.unknowns)
            touched = np.flatnonzero(slope.any(axis=0))
            root = rng.normal(size=(len(slope),) * 2) @ slope[:, touched]
            full[np.ix_(touched, touched)] += root.T @ root
    return full


def case(cells_y, cells_x, of, line=None) -> Case:
    shape = MeshShape(cells_y, cells_x, of in (one_length, two_lengths))
    unknowns = of(shape)
    full = random_stiffness(shape)[np.ix_(unknowns, unknowns)]
    lower = sp.csc_array(np.tril(full))
    columns = np.repeat(np.arange(len(full)), np.diff(lower.indptr))
    grid = np.array(np.divmod(unknowns // 3, shape.nodes_x))
    grid[:, unknowns >= 3 * shape.nodes] = -1
    lines = narrower(*grid) if line is None else grid[("row", "column").index(line)]
    plan = block_tridiagonal(lower.indptr, lower.indices, lines)
    return Case(full, plan, (lower.indices, columns))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cells_y", "cells_x", "of", "line"),
    [
        (5, 4, clamped, "row"),
        (7, 9, clamped, "column"),
        (2, 3, clamped, "row"),
        (5, 4, unpinned, "row"),
        (4, 7, unpinned, None),
        (4, 4, one_length, "row"),
        (8, 5, one_length, "row"),
        (3, 5, one_length, "row"),
        (4, 4, two_lengths, "column"),
        (5, 8, two_lengths, "column"),
        (5, 5, two_lengths, "row"),
        (7, 9, two_lengths, None),
    ],
)
def test_a_sheet_is_factorised_and_solved_as_a_dense_matrix(cells_y, cells_x, of, line):
    sheet = case(cells_y, cells_x, of, line)
    factors = factorise(sheet.plan, sheet.entries(0.1))
    matrix = sheet.shifted(0.1)
    right = np.random.default_rng(1).normal(size=len(matrix))
    assert factors.positive
    assert np.allclose(solve(factors, right), np.linalg.solve(matrix, right), rtol=1e-10)
    order = np.argsort(sheet.plan.layout.places)
    pivots = np.append(np.diagonal(factors.pivots, axis1=1, axis2=2), np.diagonal(factors.corner))[
        sheet.plan.layout.places
    ][order]
    assert np.allclose(pivots, np.diag(np.linalg.cholesky(matrix[np.ix_(order, order)])))


@pytest.mark.slow
@pytest.mark.parametrize("of", [clamped, unpinned, one_length, two_lengths])
@pytest.mark.parametrize("size", [4, 7])
def test_positive_if_and_only_if_every_eigenvalue_is(of, size):
    sheet = case(size, size, of)
    smallest = np.linalg.eigvalsh(sheet.full)[0]
    for excess in (1e-9, 1e-3):
        assert factorise(sheet.plan, sheet.entries(excess - smallest)).positive
        assert not factorise(sheet.plan, sheet.entries(-excess - smallest)).positive


@pytest.mark.slow
@pytest.mark.parametrize("of", [clamped, two_lengths])
def test_a_negative_pivot_is_detected_anywhere(of):
    sheet = case(6, 5, of)
    entries = sheet.entries(0.1)
    rows, columns = sheet.lower
    for place in np.flatnonzero(rows == columns):
        assert not factorise(sheet.plan, entries.at[place].set(-1.0)).positive


@pytest.mark.slow
@pytest.mark.parametrize("of", [clamped, unpinned, one_length, two_lengths])
def test_an_indefinite_matrix_leaves_the_others_of_a_batch_untouched(of):
    sheet = case(6, 5, of)
    shifts = [0.1, -100.0, 3.0]
    entries = jnp.stack([sheet.entries(shift) for shift in shifts])
    rights = np.random.default_rng(2).normal(size=(3, len(sheet.full)))
    factors = factorise_all(sheet.plan, entries)
    assert factors.positive.tolist() == [True, False, True]
    solutions = solve_all(factors, rights)
    for i in (0, 2):
        assert np.allclose(sheet.shifted(shifts[i]) @ solutions[i], rights[i], rtol=0, atol=1e-10)
        alone = factorise(sheet.plan, entries[i])
        assert np.allclose(alone.panels, factors.panels[i], rtol=1e-13, atol=1e-13)
    assert not np.isfinite(solutions[1]).all()


def test_not_a_number_is_not_positive():
    sheet = case(5, 5, clamped)
    entries = sheet.entries(1.0)
    assert not factorise(sheet.plan, entries.at[len(entries) // 2].set(jnp.nan)).positive


def test_narrower_lines_are_chosen():
    rows, columns = np.append(np.indices((9, 4)).repeat(3, axis=-1).reshape(2, -1), [[-1]] * 2, 1)
    assert narrower(rows, columns) is rows
    assert narrower(columns, rows) is rows


def test_lines_that_couple_too_far_are_refused():
    lower = sp.csc_array(np.tril(np.ones((7, 7))))
    with pytest.raises(ValueError, match="more than 2 apart"):
        block_tridiagonal(lower.indptr, lower.indices, np.arange(7))
