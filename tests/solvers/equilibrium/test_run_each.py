"""Several fabrics at the same time: the same states, and none affects another."""

from functools import partial
from threading import Event

import equinox as eqx
import numpy as np
import pytest

from knitlab.model.energy import Point
from knitlab.model.fabric import flat_sheet
from knitlab.solvers.equilibrium import equilibrium
from knitlab.solvers.equilibrium.equilibrium import run_each
from knitlab.solvers.equilibrium.settings import Solver
from knitlab.solvers.equilibrium.tensile_test import stretch
from tests.fabrics import PERIODIC, checkered

STRAINS = [0.0, 0.05, 0.1]
TEST = partial(stretch, applied_strain=STRAINS, settings=Solver())


def test_fabrics_end_concurrently_exactly_as_one_after_another(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    net, four = checkered(4, 1, PERIODIC)
    _, eight = checkered(8, 1, PERIODIC)
    fabrics = [four, eight]
    concurrently = run_each(net.shape, fabrics, [TEST, TEST])
    monkeypatch.setattr(equilibrium, "MAX_CONCURRENT_NODES", 0)
    in_turn = run_each(net.shape, fabrics, [TEST, TEST])
    for one, other in zip(concurrently, in_turn, strict=True):
        for state, same in zip(one.states, other.states, strict=True):
            assert same.converged
            np.testing.assert_array_equal(state.unknowns, same.unknowns)


def test_a_fabric_with_nan_does_not_affect_the_others():
    net, sound = checkered(4, 1, PERIODIC)
    poisoned = eqx.tree_at(
        lambda f: f.rest_length,
        sound,
        np.where(np.arange(len(sound.rest_length)) == 3, np.nan, sound.rest_length),
    )
    first, broken, last = run_each(net.shape, [sound, poisoned, sound], [TEST] * 3)
    assert all(state.converged for state in first.states)
    assert first.states[-1].residual == last.states[-1].residual
    assert not broken.states[0].converged
    assert broken.loading is None


def test_an_exception_of_one_fabric_abandons_the_others_that_run_concurrently(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    net, fabric = checkered(4, 1, PERIODIC)
    asked, abandoned = Event(), Event()
    flat = Point(np.asarray(flat_sheet(net, fabric).flattened()))

    def endless(equations):
        try:
            while True:
                equations.evaluate(flat)
                asked.set()
        finally:
            abandoned.set()

    def failing(equations):
        asked.wait(60)
        raise RuntimeError("broken")

    with pytest.raises(RuntimeError, match="broken"):
        run_each(net.shape, [fabric, fabric], [failing, endless])
    assert abandoned.wait(60)
