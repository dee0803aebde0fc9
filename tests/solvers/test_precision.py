"""Searches with factors in single precision reach the states of those in double precision."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from knitlab.elasticity.factorisation import one_thread_of_blas
from knitlab.mechanics.loading import tensile
from knitlab.mechanics.relaxation import relax
from knitlab.mechanics.tensile_test import stretch
from knitlab.solvers.equilibrium import find_equilibrium
from knitlab.solvers.equilibrium_search import NEARLY, SearchRules
from knitlab.solvers.executor import Executor, run_to_end
from knitlab.solvers.solver import Evaluate, Factorise, Solve
from tests.fabrics import DEFAULT, FINE, PERIODIC, checkered


class Recorded(Executor):
    """An executor that keeps the factorisations asked for, with the force left before each.

    Args:
        net, fabric: the fabric.
        useless: what single precision is of no use for near the end of a search: ``factor`` or
            ``solve``.
    """

    def __init__(self, net, fabric, useless=""):
        super().__init__(net.shape, fabric)
        self.useless, self.asked, self.force = useless, [], np.inf
        self.free = None

    def answer(self, request):
        useless = self.force < NEARLY * DEFAULT.tolerance and not self.exact
        if isinstance(request, Factorise):
            self.asked.append((request, self.force))
            if useless and self.useless == "factor" and not request.exact:
                return False
        if isinstance(request, Solve) and useless and self.useless == "solve":
            return np.full_like(request.right, np.nan)
        answer = super().answer(request)
        if isinstance(request, Evaluate) and self.free is not None:
            self.force = float(np.abs(np.asarray(answer.gradient)[self.free]).max())
        return answer

    @property
    def exact(self):
        """Whether the last factor is in double precision."""
        return bool(self.asked) and self.asked[-1][0].exact


def pulled(strain, useless="", settings=DEFAULT):
    """A strain step from a relaxed fabric, and the factorisations that it asked for."""
    net, fabric = checkered(4, 1, PERIODIC)
    with one_thread_of_blas():
        relaxed = run_to_end(Executor(net.shape, fabric), relax(net, fabric, FINE))
        loading = tensile(net.shape, relaxed.configuration)
        executor = Recorded(net, fabric, useless)
        executor.free = loading.free
        rules = SearchRules.of(net.shape, loading.free, fabric, settings, convexified=False)
        start = Evaluate(relaxed.unknowns + strain * loading.drive)
        return run_to_end(executor, find_equilibrium(start, rules)), executor.asked


@pytest.mark.parametrize(("useless", "strain"), [("factor", 1e-7), ("solve", 0.01)])
def test_a_search_that_single_precision_cannot_end_is_ended_in_double(useless, strain):
    state, asked = pulled(strain)
    assert state.converged
    assert not any(request.exact for request, _ in asked)
    other, asked = pulled(strain, useless)
    assert other.converged
    assert float(other.energy.total) == pytest.approx(float(state.energy.total), rel=1e-12)
    exact = [request.exact for request, _ in asked]
    first = exact.index(True)
    assert all(exact[first:]), "a search that needed double precision returned to single"
    # Not with a larger μ, which would slow the search instead.
    assert asked[first][0].shift == asked[first - 1][0].shift
    assert asked[first][1] < NEARLY * DEFAULT.tolerance


def test_an_intermediate_state_far_from_a_minimum_is_found_in_single_precision():
    state, asked = pulled(-0.05, settings=replace(DEFAULT, tolerance=1e-3))
    assert state.converged
    failed = [again.shift > before.shift for (before, _), (again, _) in pairwise(asked)]
    assert any(failed), "the stiffness never failed to be positive definite"
    assert not any(request.exact for request, _ in asked)


def test_strain_steps_follow_the_path_of_double_precision(monkeypatch):
    net, fabric = checkered(4, 1, PERIODIC)
    strains = [0.0, 0.03, 0.1]

    def states():
        with one_thread_of_blas():
            return run_to_end(
                Executor(net.shape, fabric), stretch(net, fabric, strains, FINE)
            ).states

    single = states()
    exactly = Executor._factorise
    monkeypatch.setattr(
        Executor, "_factorise", lambda self, request: exactly(self, replace(request, exact=True))
    )
    for one, other in zip(single, states(), strict=True):
        assert one.converged
        assert other.converged
        assert float(one.energy.total) == pytest.approx(float(other.energy.total), rel=1e-12)
        lengths = (state.configuration.lengths for state in (one, other))
        np.testing.assert_allclose(*lengths, rtol=1e-9)
