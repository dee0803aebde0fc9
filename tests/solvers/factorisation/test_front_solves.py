"""Solves of groups of fronts, against those of one front after another."""

from itertools import groupby

import numpy as np
import pytest

from knitlab.solvers.factorisation import triangular_solves
from knitlab.solvers.factorisation.symbolic_factorisation import Front, NestedDissection
from knitlab.solvers.factorisation.triangular_solves import (
    FrontSolves,
    GroupSolves,
    groupable,
)
from tests.solvers.factorisation.test_multifrontal import CASES, Case, fronts, sheet


def groups(plan: NestedDissection) -> list[list[Front]]:
    """Fronts of one half, level and size, in the order in which they are stored."""
    found = []
    for half in plan.parts[:2]:
        ordered = sorted(half, key=lambda front: front.stored)
        kinds = groupby(ordered, key=lambda front: front.kind)
        found += [list(members) for _, members in kinds]
    return [members for members in found if groupable(members[0])]


def test_fronts_of_a_group_are_stored_one_after_another_and_do_not_depend_on_each_other():
    plan = sheet(70, 60).plan
    assert max(map(len, groups(plan))) >= 16
    for members in groups(plan):
        length = members[0].size * (members[0].size + len(members[0].boundary))
        assert [front.stored for front in members] == [
            members[0].stored + k * length for k in range(len(members))
        ]
        pivots = np.concatenate(
            [np.arange(each.pivots.start, each.pivots.stop) for each in members]
        )
        assert not np.intersect1d(pivots, np.concatenate([each.boundary for each in members])).size
    ordered = [front for members in groups(plan) for front in members]
    for front in fronts(plan):
        assert all(child.level < front.level for child, _ in front.children)
    stored = sorted(fronts(plan), key=lambda front: front.stored)
    ends = [each.stored + each.size * (each.size + len(each.boundary)) for each in stored]
    assert [each.stored for each in stored] == [0, *ends[:-1]]
    assert ends[-1] == plan.stored
    assert len(ordered) > len(stored) / 2


@pytest.mark.parametrize("precision", [np.float32, np.float64])
def test_a_group_is_solved_as_its_fronts_one_by_one(precision):
    plan, random = sheet(40, 44).plan, np.random.default_rng(5)
    stored = random.normal(size=plan.stored).astype(precision)
    for front in fronts(plan):
        pivots, _ = front.columns(stored)
        pivots[:] = np.tril(pivots)
    start = random.normal(size=len(plan.order)).astype(precision)
    together, alone = start.copy(), start.copy()
    for members in groups(plan):
        together[:] = alone[:] = start
        boundaries = [front.boundary for front in members]
        group = GroupSolves(members, boundaries, stored, together)
        single = [FrontSolves(each, each.boundary, stored, alone) for each in members]
        accuracy = 2e3 * np.finfo(precision).eps
        group.reduce()
        for each in single:
            each.reduce()
        np.testing.assert_allclose(together, alone, rtol=0, atol=accuracy * abs(alone).max())
        assert (together != start).any()
        together[:] = alone
        group.substitute_back()
        for each in single:
            each.substitute_back()
        np.testing.assert_allclose(together, alone, rtol=0, atol=accuracy * abs(alone).max())


@pytest.mark.parametrize("least", [1, 10**9])
@pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())
def test_solutions_do_not_depend_on_how_many_fronts_make_a_group(
    case: Case, least: int, monkeypatch
) -> None:
    monkeypatch.setattr(triangular_solves, "MIN_GROUP", least)
    rhs = np.random.default_rng(1).normal(size=len(case.rows))
    solution = case.factors().solve(rhs)
    np.testing.assert_allclose(case.matrix @ solution, rhs, rtol=0, atol=1e-12)
