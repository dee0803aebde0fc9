"""Times of equilibrium: ``python -m pytest benchmarks/bench_solvers.py``.

Choose with ``-k``, keep a record with ``--benchmark-json``, and count processor time with
``--benchmark-timer=time.process_time``. Set ``OMP_NUM_THREADS`` and ``PJRT_NPROC`` to the number
of threads. Numbers of steps and factorisations are in ``extra_info``.
"""

from collections.abc import Callable
from typing import Any

import pytest

import knitlab as kl
from benchmarks.solver import factorisations
from benchmarks.solver.dynamics import dynamics
from benchmarks.solver.fire import fire
from benchmarks.solver.lbfgs import lbfgs
from benchmarks.solver.problem import Problem, Search, pulled_by
from knitlab.runs.plan import make_plan
from knitlab.solvers.case import Case
from knitlab.solvers.equilibrium.state import TensileTest
from knitlab.solvers.methods import METHODS

TOLERANCE = 1e-6  # largest force that every method may leave on a free unknown [N]
PAPER = kl.defaults().designs.root["paper"].pairs
FACTORISATIONS = (
    factorisations.nested_dissection,
    factorisations.cholmod,
    factorisations.pardiso,
    factorisations.superlu,
)


def sample(*settings: str) -> Case:
    """A design in 15 strain steps of 3 %; no path is finer, as no other method's is."""
    common = ("path_step=0.03", "smallest_step=1", "contact=none", "robustness=0")
    usual = ("n_stripe=4", "n_subunit=16", f"tolerance={TOLERANCE}", "strain_max=0.45")
    (case,) = make_plan("periodic", (*common, *usual, *settings)).cases.values()
    return case


def simulated(case: Case) -> TensileTest:
    """The tensile test of a case by knitlab's own solver."""
    (test,) = METHODS[case.method].stretch([case], lambda *_: None)
    assert test.states[-1].converged
    return test


def timed(benchmark: Any, function: Callable[[], Any], rounds: int = 3) -> Any:
    """Time a function several times, after a call that compiles."""
    return benchmark.pedantic(function, rounds=rounds, warmup_rounds=1)


@pytest.mark.parametrize("unit_cells", ["1,1", "3,2"])
@pytest.mark.parametrize("method", ["knitlab", "fire", "lbfgs", "dynamics"])
def test_method(benchmark: Any, method: str, unit_cells: str) -> None:
    """A tensile test from the flat sheet by different methods."""
    clamped = ("boundary=clamped", f"unit_cells={unit_cells}", "start=flat")
    if method == "knitlab":
        case = sample(*clamped)
        energy = timed(benchmark, lambda: simulated(case)).states[-1].energy.total
    else:
        moving = sample(*clamped, "method=dynamics")
        problem = Problem.of(moving, TOLERANCE)
        searches: dict[str, Search] = {
            "fire": fire(0.01),
            "lbfgs": lbfgs(20),
            "dynamics": dynamics(moving.motion, 0.1),
        }
        states = timed(benchmark, lambda: pulled_by(searches[method], problem))
        energy = problem.evaluate(states[-1]).energy.total
    benchmark.extra_info["energy [N mm]"] = float(energy)


@pytest.mark.parametrize("unit_cells", ["2,2", "4,2", "6,3", "8,4", "12,6", "16,8", "22,11"])
def test_size(benchmark: Any, unit_cells: str) -> None:
    """A tensile test of a large sample, from relaxed periodic fabric."""
    case = sample("boundary=clamped", f"unit_cells={unit_cells}", "start=periodic")
    test = timed(benchmark, lambda: simulated(case))
    benchmark.extra_info["nodes"] = case.mesh_shape.nodes
    benchmark.extra_info["evaluations"] = sum(state.iterations for state in test.states)
    benchmark.extra_info["factorisations"] = sum(state.factorisations for state in test.states)


@pytest.mark.parametrize("design", PAPER, ids=lambda pair: "-".join(map(str, pair)))
@pytest.mark.parametrize("boundary", ["periodic", "clamped"])
def test_relaxation(benchmark: Any, design: tuple[int, int], boundary: str) -> None:
    """The relaxation of a design of the paper, to 1e-8 N."""
    cells = ("unit_cells=5,3", "start=periodic") if boundary == "clamped" else ()
    names = (f"n_stripe={design[0]}", f"n_subunit={design[1]}", f"boundary={boundary}")
    case = sample(*names, *cells, "tolerance=1e-8", "strain_max=0")
    test = timed(benchmark, lambda: simulated(case), rounds=1)
    benchmark.extra_info["factorisations"] = test.states[0].factorisations


@pytest.mark.parametrize("unit_cells", ["7,4", "24,11"])
@pytest.mark.parametrize("method", FACTORISATIONS, ids=lambda method: method.__name__)
def test_factorisation(benchmark: Any, method: Callable[..., Any], unit_cells: str) -> None:
    """The numeric factorisation of a stiffness matrix."""
    case = sample("boundary=clamped", f"unit_cells={unit_cells}", "start=periodic")
    matrix = factorisations.Stiffness.of_case(case)
    timed(benchmark, method(matrix), rounds=5)
    benchmark.extra_info["unknowns"] = len(matrix.free.dofs)
