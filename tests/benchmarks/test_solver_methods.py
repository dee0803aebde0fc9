"""The benchmark's other methods are an independent check of the equilibrium solver."""

import numpy as np
import pytest
from benchmarks.solver.message import Problem

from benchmarks.solver import limit, methods
from benchmarks.solver.measurement import TOLERANCE, Measurement
from benchmarks.solver.watch import GivenUp, Watch
from knitlab.solvers.equilibrium.loading import all_free

SMALL = {"n_stripe": 4, "n_subunit": 8, "size": "1x1"}
PLENTY = 300.0


@pytest.mark.slow
@pytest.mark.parametrize("boundary", [pytest.param("clamped", marks=pytest.mark.slow), "periodic"])
def test_fire_and_l_bfgs_relax_to_the_state_of_the_equilibrium_solver(boundary):
    problem = Problem.of(
        Measurement("relaxation", "knitlab", **SMALL, boundary=boundary).case("strain_max=0"),
        TOLERANCE,
    )
    free = all_free(problem.shape)
    energies = {}
    for solver in ("knitlab", "fire", "lbfgs"):
        named = Measurement("relaxation", solver, **SMALL, boundary=boundary)
        relaxed = methods.method(named).relax(problem, Watch(PLENTY))
        evaluation = problem.evaluate(relaxed)
        assert np.abs(evaluation.gradient[free]).max() <= TOLERANCE
        energies[solver] = float(evaluation.energy.total)
    # A residual force equal to the tolerance on a soft mode changes the energy by this amount.
    assert energies == pytest.approx(dict.fromkeys(energies, energies["knitlab"]), rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(
    "solver", [*filter(methods.installed, ["knitlab_direct", "knitlab_cholmod", "fire", "lbfgs"])]
)
def test_methods_pull_a_sample_to_the_same_state(solver):
    case = Measurement("tension", solver, **SMALL).case("strain_max=0.06")
    problem = Problem.of(case, TOLERANCE)
    named, shipped = (Measurement("tension", each, **SMALL) for each in (solver, "knitlab"))
    watch = Watch(PLENTY)
    pulled, expected = (
        methods.method(measurement).pull(problem, each)
        for measurement, each in ((named, watch), (shipped, Watch(PLENTY)))
    )
    assert watch.states == len(pulled) == len(expected) == 3
    energies = [float(problem.evaluate(states[-1]).energy.total) for states in (pulled, expected)]
    # Each starts from its own relaxed shape, whose length varies with the residual force.
    assert energies[0] == pytest.approx(energies[1], rel=5e-5)


@pytest.mark.slow
def test_a_method_that_fails_records_its_residual_but_no_time():
    record = methods.measure(Measurement("relaxation", "fire", **SMALL, time_limit=0.0))
    assert not record["reached"]
    assert "limit" in record["reason"]
    assert "seconds" not in record
    assert TOLERANCE < record["residual"] < 1
    assert record["first_times"][-1] is None


@pytest.mark.parametrize("solver", [*filter(methods.installed, limit.FACTORISATIONS)])
def test_every_factorisation_solves_the_stiffness(solver):
    record = limit.measure(Measurement("iteration", solver, **SMALL))
    assert record["residual"] < 1e-12
    parts = ("hessian", "factorise", "solve", "evaluation")
    assert record["seconds"] == pytest.approx(sum(record[f"{part}_seconds"] for part in parts))


def test_a_watch_reports_when_a_residual_was_first_reached():
    watch = Watch(np.inf, trace=[(1.0, 0.5), (2.0, 0.05), (3.0, 0.2), (4.0, 0.01)])
    assert watch.first_times(np.array([1.0, 0.1, 0.01, 1e-3])) == [1.0, 2.0, 4.0, None]


def test_a_watch_gives_up_when_time_is_up():
    with pytest.raises(GivenUp):
        Watch(limit=0.0).sees(1.0)
