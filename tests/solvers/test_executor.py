"""Solvers alone, concurrent and in lockstep: the same states, and none affects another."""

from threading import Event

import equinox as eqx
import numpy as np
import pytest

from knitlab.mechanics.tensile_test import stretch
from knitlab.model.fabric import Sheet, flat_sheet
from knitlab.solvers import runners
from knitlab.solvers.batch import run_in_lockstep
from knitlab.solvers.runners import run_concurrently, run_sequentially
from knitlab.solvers.solver import Evaluate, SolverSettings
from tests.fabrics import (
    CLAMPED,
    FINE,
    PERIODIC,
    SHEET,
    checkerboard,
    checkered,
    patterned,
    stretched,
)

STRAINS = [0.0, 0.05, 0.1]
RUNNERS = run_sequentially, run_concurrently


def stretches(net, fabrics):
    return [stretch(net, fabric, STRAINS, SolverSettings()) for fabric in fabrics]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "sheet"),
    [
        pytest.param(PERIODIC, SHEET, id="periodic"),
        pytest.param(PERIODIC, Sheet(z_max=0.4, k_wall=100.0), id="between narrow walls"),
        pytest.param(CLAMPED, SHEET, id="clamped"),
    ],
)
def test_a_batch_on_the_device_equals_single_fabrics(options, sheet):
    net, four = patterned(4, checkerboard(1), options, sheet)
    _, eight = patterned(8, checkerboard(1), options, sheet)
    # Close to a snap, an energy accurate to 1e-7 needs a smaller tolerance.
    solvers = [stretch(net, fabric, STRAINS, FINE) for fabric in (four, eight)]
    batch = run_in_lockstep(net.shape, [four, eight], solvers)
    for fabric, together in zip((four, eight), batch, strict=True):
        alone = stretched(net, fabric, STRAINS, FINE)
        for state, other in zip(alone.states, together.states, strict=True):
            assert other.converged
            assert float(state.energy.total) == pytest.approx(float(other.energy.total), rel=1e-7)
            assert np.allclose(state.configuration.lengths, other.configuration.lengths, rtol=1e-6)


@pytest.mark.slow
def test_a_fabric_with_nan_does_not_affect_the_others_of_a_batch():
    net, sound = checkered(4, 1, PERIODIC)
    poisoned = eqx.tree_at(
        lambda f: f.rest_length,
        sound,
        np.where(np.arange(len(sound.rest_length)) == 3, np.nan, sound.rest_length),
    )
    fabrics = [sound, poisoned, sound]
    for runner in (run_sequentially, run_concurrently, run_in_lockstep):
        first, broken, last = runner(net.shape, fabrics, stretches(net, fabrics))
        assert all(state.converged for state in first.states)
        assert first.states[-1].residual == last.states[-1].residual
        assert not broken.states[0].converged
        assert broken.loading is None


@pytest.mark.parametrize("threads", [1, 3])
def test_fabrics_in_packs_end_as_one_after_another(monkeypatch, threads):
    monkeypatch.setenv("OMP_NUM_THREADS", str(threads))
    net, four = checkered(4, 1, PERIODIC)
    _, eight = checkered(8, 1, PERIODIC)
    fabrics = [four, eight, four, eight]

    def tests():
        # One ends early, and leaves its pack.
        lengths = 3, 2, 3, 3
        return [
            stretch(net, fabric, STRAINS[:length], FINE)
            for fabric, length in zip(fabrics, lengths, strict=True)
        ]

    expected = run_sequentially(net.shape, fabrics, tests())
    found = run_concurrently(net.shape, fabrics, tests())
    for one, other in zip(expected, found, strict=True):
        for state, same in zip(one.states, other.states, strict=True):
            assert same.converged
            np.testing.assert_allclose(state.unknowns, same.unknowns, atol=1e-6)


def test_fabrics_too_large_for_packs_end_exactly_as_one_after_another(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    monkeypatch.setattr(runners, "pack_size", lambda nodes: 1)
    net, four = checkered(4, 1, PERIODIC)
    _, eight = checkered(8, 1, PERIODIC)
    fabrics = [four, eight]
    results = (run(net.shape, fabrics, stretches(net, fabrics)) for run in RUNNERS)
    for one, other in zip(*results, strict=True):
        for state, same in zip(one.states, other.states, strict=True):
            np.testing.assert_array_equal(state.unknowns, same.unknowns)


def test_an_exception_of_one_fabric_abandons_the_others_that_run_concurrently(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    net, fabric = checkered(4, 1, PERIODIC)
    asked, abandoned = Event(), Event()

    def endless():
        try:
            while True:
                yield Evaluate(np.asarray(flat_sheet(net, fabric).flattened()))
                asked.set()
        finally:
            abandoned.set()

    def failing():
        yield Evaluate(np.asarray(flat_sheet(net, fabric).flattened()))
        asked.wait(60)
        raise RuntimeError("broken")

    with pytest.raises(RuntimeError, match="broken"):
        run_concurrently(net.shape, [fabric, fabric], [failing(), endless()])
    assert abandoned.wait(60)
