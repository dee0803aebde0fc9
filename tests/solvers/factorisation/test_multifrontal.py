from dataclasses import dataclass

import numpy as np
import pytest
import scipy.sparse as sp
from jaxtyping import Float, Int
from scipy.sparse.linalg import spsolve

from knitlab.model.threads import Threads
from knitlab.solvers.factorisation import multifrontal, triangular_solves
from knitlab.solvers.factorisation.multifrontal import Multifrontal
from knitlab.solvers.factorisation.symbolic_factorisation import (
    Front,
    GridOrder,
    NestedDissection,
    grid_order,
    planned,
)

OFFSETS = [
    (down, across)
    for down in range(-2, 3)
    for across in range(-2, 3)
    if abs(down) + abs(across) <= 3
]


@dataclass(frozen=True, eq=False)
class Case:
    """A positive definite matrix, and the positions of its unknowns on the grid."""

    matrix: sp.csc_array
    rows: Int[np.ndarray, " unknown"]
    columns: Int[np.ndarray, " unknown"]

    @property
    def lower(self) -> sp.csc_array:
        lower = sp.csc_array(sp.tril(self.matrix))
        lower.sort_indices()
        return lower

    @property
    def order(self) -> GridOrder:
        lower = self.lower
        return grid_order(lower.indptr, lower.indices, self.rows, self.columns)

    @property
    def plan(self) -> NestedDissection:
        return planned(self.order, self.lower.indptr, self.lower.indices)

    def factors(self) -> Multifrontal:
        return factored(self.plan, self.lower.data)


def factored(
    plan: NestedDissection, entries: Float[np.ndarray, " nonzero"], convexified: bool = False
) -> Multifrontal:
    factors = Multifrontal(plan)
    assert factors.factorise(entries, convexified)
    return factors


def fronts(plan: NestedDissection) -> list[Front]:
    return [front for part in plan.parts for front in part]


def sheet(height: int, width: int, periodic: bool = False, held: int = 0) -> Case:
    """Nodes coupled as in fabric; ``held`` rows at either end are not free."""
    row, column = (place.ravel() for place in np.indices((height, width)))
    pairs = []
    for down, across in OFFSETS:
        to_row, to_column = row + down, column + across
        if periodic:
            to_row, to_column = to_row % height, to_column % width
        inside = (to_row >= 0) & (to_row < height) & (to_column >= 0) & (to_column < width)
        pairs.append(np.stack([np.flatnonzero(inside), (to_row * width + to_column)[inside]]))
    one, other = np.concatenate(pairs, axis=1)
    blocks = (np.ones(len(one)), (one, other))
    pattern = sp.kron(sp.coo_array(blocks, shape=(row.size,) * 2), np.ones((3, 3)))
    rows, columns = np.repeat(row, 3), np.repeat(column, 3)
    if periodic:
        seams = np.stack([columns < 2, rows < 2]).astype(float)
        pattern = sp.block_array([[pattern, seams.T], [seams, np.ones((2, 2))]])
        rows, columns = (np.append(line, [-1, -1]) for line in (rows, columns))
    free = (rows < 0) | ((rows >= held) & (rows < height - held))
    pattern = sp.csc_array(pattern)[free][:, free]
    random = sp.tril(pattern, -1, format="csc")
    random.data = np.random.default_rng(0).normal(size=random.nnz)
    matrix = random + random.T
    matrix += sp.diags_array(abs(matrix).sum(axis=0) + 0.1)
    return Case(sp.csc_array(matrix), rows[free], columns[free])


def half_free() -> Case:
    """A sheet of which any single unknown of a node may be held."""
    case = sheet(20, 30)
    free = np.random.default_rng(3).random(len(case.rows)) < 0.5
    return Case(sp.csc_array(case.matrix[free][:, free]), case.rows[free], case.columns[free])


CASES = {
    "one node": sheet(1, 1),
    "one row": sheet(1, 70),
    "3 × 3": sheet(3, 3),
    "3 × 3, held": sheet(3, 3, held=1),
    "narrow": sheet(60, 3),
    "free": sheet(23, 31),
    "held": sheet(25, 18, held=1),
    "held twice": sheet(21, 40, held=2),
    "half free": half_free(),
    "periodic 3 × 3": sheet(3, 3, periodic=True),
    "periodic 4 × 30": sheet(4, 30, periodic=True),
    "periodic 7 × 8": sheet(7, 8, periodic=True),
    "periodic": sheet(24, 37, periodic=True),
    "periodic, tall": sheet(41, 20, periodic=True),
}


@pytest.fixture(params=CASES.values(), ids=CASES.keys())
def case(request: pytest.FixtureRequest) -> Case:
    return request.param


def triangle(factors: Multifrontal) -> np.ndarray:
    """L as a dense matrix, in the order of elimination."""
    dense = np.zeros((len(factors.plan.order),) * 2)
    for front in fronts(factors.plan):
        pivots, coupling = front.columns(factors.stored)
        lower = np.tril(pivots)
        dense[front.pivots, front.pivots] = np.linalg.inv(lower) if front.inverted else lower
        dense[front.boundary, front.pivots] = coupling
    return dense


def test_a_factorisation_solves(case: Case) -> None:
    rhs = np.random.default_rng(1).normal(size=len(case.rows))
    before = rhs.copy()
    solution = case.factors().solve(rhs)
    np.testing.assert_allclose(solution, spsolve(case.matrix, rhs), rtol=0, atol=1e-12)
    np.testing.assert_array_equal(rhs, before)


@pytest.mark.parametrize("least", [1, 10**9])
def test_solutions_do_not_depend_on_how_many_fronts_make_a_group(case: Case, least, monkeypatch):
    monkeypatch.setattr(triangular_solves, "MIN_GROUP", least)
    rhs = np.random.default_rng(1).normal(size=len(case.rows))
    np.testing.assert_allclose(case.matrix @ case.factors().solve(rhs), rhs, rtol=0, atol=1e-12)


def test_couplings_beyond_those_of_the_grid_are_factorised_in_its_order(case: Case) -> None:
    """As those of plies that touch: of a few unknowns anywhere."""
    numbers = np.random.default_rng(5)
    touching = numbers.choice(len(case.rows), min(12, len(case.rows)), replace=False)
    block = np.zeros((len(case.rows), 1))
    block[touching] = 3.0
    matrix = sp.csc_array(case.matrix + sp.csc_array(block) @ sp.csc_array(block.T))
    whole = sp.csc_array(sp.tril(matrix))
    whole.sort_indices()
    rhs = numbers.normal(size=len(case.rows))
    solution = factored(planned(case.order, whole.indptr, whole.indices), whole.data).solve(rhs)
    np.testing.assert_allclose(solution, spsolve(matrix, rhs), rtol=0, atol=1e-12)


def test_single_precision_solves_to_its_round_off(case: Case) -> None:
    factors = Multifrontal(case.plan, precision=np.float32)
    assert factors.factorise(case.lower.data)
    right = np.random.default_rng(1).normal(size=len(case.rows))
    solution = factors.solve(right)
    assert solution.dtype == np.float64
    exact = spsolve(case.matrix, right) if len(right) > 1 else right / case.matrix.toarray()[0]
    error = np.linalg.norm(solution - exact) / np.linalg.norm(exact)
    assert 1e-9 < error < 1e-4


@pytest.mark.parametrize(
    ("bad", "convexified"), [(0.0, False), (-1.0, False), (np.nan, False), (np.nan, True)]
)
def test_one_bad_pivot_anywhere_is_reported(bad, convexified) -> None:
    case = sheet(12, 17, periodic=True)
    factors, lower = case.factors(), case.lower
    for column in range(0, len(case.rows), 7):
        entries = lower.data.copy()
        entries[lower.indptr[column]] = bad
        assert not factors.factorise(entries, convexified)


@pytest.mark.slow
def test_convexifying_adds_only_where_the_matrix_curves_down(case: Case) -> None:
    plan, lower = case.plan, case.lower
    np.testing.assert_array_equal(
        triangle(factored(plan, lower.data, convexified=True)), triangle(case.factors())
    )
    down = len(case.rows) // 2
    entries = lower.data.copy()
    entries[lower.indptr[down]] *= -1
    assert not Multifrontal(plan).factorise(entries)
    factors = factored(plan, entries, convexified=True)
    matrix = sp.csc_array((entries, lower.indices, lower.indptr), shape=lower.shape).toarray()
    matrix += np.tril(matrix, -1).T
    added = (
        triangle(factors) @ triangle(factors).T
        - matrix[np.ix_(factors.plan.order, factors.plan.order)]
    )
    assert np.linalg.eigvalsh(added)[0] > -1e-9
    (place,) = np.flatnonzero(factors.plan.order == down)
    (front,) = (f.pivots for f in fronts(plan) if f.pivots.start <= place < f.pivots.stop)
    assert added[place, place] > 1
    added[front, front] = 0
    np.testing.assert_allclose(added, 0, atol=1e-9)


def test_a_single_front_is_convexified_to_its_absolute_eigenvalues() -> None:
    case = sheet(3, 3)
    values, vectors = np.linalg.eigh(case.matrix.toarray())
    values -= values.mean()
    matrix = (vectors * values) @ vectors.T
    lower = case.lower
    columns = np.repeat(np.arange(len(values)), np.diff(lower.indptr))
    factors = factored(case.plan, matrix[lower.indices, columns], convexified=True)
    assert len(fronts(factors.plan)) == 1
    convex = (vectors * np.abs(values)) @ vectors.T
    np.testing.assert_allclose(
        triangle(factors) @ triangle(factors).T,
        convex[np.ix_(factors.plan.order, factors.plan.order)],
        atol=1e-12,
    )


@pytest.mark.slow
def test_two_threads_give_identical_results(case: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(multifrontal, "WORTH_SHARING", 0)
    monkeypatch.setattr(triangular_solves, "WORTH_SHARING", 0)
    lower, plan = case.lower, case.plan
    rhs = np.random.default_rng(1).normal(size=len(case.rows))
    indefinite = lower.data.copy()
    indefinite[lower.indptr[:-1][::9]] *= -1
    alone, shared = Multifrontal(plan), Multifrontal(plan, Threads(2))
    for entries, convexified in ((lower.data, False), (indefinite, True), (lower.data, False)):
        for factors in (alone, shared):
            assert not factors.factorise(indefinite)
            assert factors.factorise(entries, convexified)
        np.testing.assert_array_equal(triangle(shared), triangle(alone))
        np.testing.assert_array_equal(shared.solve(rhs), alone.solve(rhs))


def test_ill_conditioned_matrices_are_solved_as_well_as_by_dense_cholesky() -> None:
    case = sheet(20, 26)
    lower, plan = case.lower, case.plan
    smallest = np.linalg.eigvalsh(case.matrix.toarray())[0]
    shift = smallest * (1 - 1e-9)
    entries = lower.data.copy()
    entries[lower.indptr[:-1]] -= shift
    matrix = case.matrix - shift * sp.eye_array(len(case.rows), format="csc")
    rhs = np.ones(len(case.rows))
    solution = factored(plan, entries).solve(rhs)
    backward = abs(matrix @ solution - rhs).max() / abs(solution).max()
    assert backward < 1e-14 * abs(matrix).max()
