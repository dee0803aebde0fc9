"""Searches with factors in single precision reach the states of those in double precision."""

from dataclasses import dataclass

import numpy as np
import pytest

from knitlab.model.energy import Point
from knitlab.solvers.equilibrium.equilibrium import find_equilibrium
from knitlab.solvers.equilibrium.search import NEARLY, SearchRules
from knitlab.solvers.equilibrium.stiffness import free_stiffness
from knitlab.solvers.equilibrium.system import System, one_thread_of_blas
from knitlab.solvers.equilibrium.tensile_test import relax, stretch
from knitlab.solvers.loads.loading import loading_of
from tests.fabrics import DEFAULT, FINE, PERIODIC, checkered, equations


@dataclass
class Factorisation:
    """A factorisation, and the largest force on a free unknown before it."""

    shift: float
    exact: bool
    force: float


class Recorded(System):
    """A system that keeps its factorisations, with the force left before each.

    Args:
        net, fabric: the fabric.
        free: its free unknowns.
        useless: what single precision is of no use for near the end of a search: ``factor`` or
            ``solve``.
    """

    def __init__(self, net, fabric, free, useless=""):
        super().__init__(net.shape, fabric)
        self.free, self.useless, self.asked, self.force = free, useless, [], np.inf

    def single_fails(self, what):
        near_the_end = self.force < NEARLY * DEFAULT.tolerance
        return self.useless == what and near_the_end and not self.asked[-1].exact

    def factorise(self, shift, convexified, exact=False):
        self.asked.append(Factorisation(shift, exact, self.force))
        if self.single_fails("factor"):
            return False
        return super().factorise(shift, convexified, exact)

    def solve(self, right):
        return np.full_like(right, np.nan) if self.single_fails("solve") else super().solve(right)

    def evaluate(self, at, drag=None):
        evaluation = super().evaluate(at, drag)
        self.force = float(np.abs(np.asarray(evaluation.gradient)[self.free]).max())
        return evaluation


def pulled(strain, useless="", settings=DEFAULT):
    """A strain step from a relaxed fabric, and the factorisations that it asked for."""
    net, fabric = checkered(4, 1, PERIODIC)
    with one_thread_of_blas():
        relaxed = relax(equations(net, fabric), FINE)
        loading = loading_of(net.shape, relaxed.configuration)
        system = Recorded(net, fabric, loading.free, useless)
        rules = SearchRules(free_stiffness(net.shape, loading.free), settings, convexified=False)
        start = Point(relaxed.unknowns + strain * loading.drive)
        return find_equilibrium(system, start, rules), system.asked


@pytest.mark.parametrize(("useless", "strain"), [("factor", 1e-7), ("solve", 0.01)])
def test_a_search_that_single_precision_cannot_end_is_ended_in_double(useless, strain):
    state, asked = pulled(strain)
    assert state.converged
    assert not any(each.exact for each in asked)
    other, asked = pulled(strain, useless)
    assert other.converged
    assert float(other.energy.total) == pytest.approx(float(state.energy.total), rel=1e-12)
    exact = [each.exact for each in asked]
    first = exact.index(True)
    assert all(exact[first:]), "a search that needed double precision returned to single"
    # Not with a larger μ, which would slow the search instead.
    assert asked[first].shift == asked[first - 1].shift
    assert asked[first].force < NEARLY * DEFAULT.tolerance


def test_strain_steps_follow_the_path_of_double_precision(monkeypatch):
    net, fabric = checkered(4, 1, PERIODIC)
    strains = [0.0, 0.03, 0.1]

    def states():
        with one_thread_of_blas():
            return stretch(equations(net, fabric), strains, FINE).states

    single, factorised = states(), System.factorise

    def exactly(self, shift, convexified, exact=False):
        return factorised(self, shift, convexified, exact=True)

    monkeypatch.setattr(System, "factorise", exactly)
    for one, other in zip(single, states(), strict=True):
        assert one.converged
        assert other.converged
        assert float(one.energy.total) == pytest.approx(float(other.energy.total), rel=1e-12)
        lengths = (state.configuration.lengths for state in (one, other))
        np.testing.assert_allclose(*lengths, rtol=1e-9)
