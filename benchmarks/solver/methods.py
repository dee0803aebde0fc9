"""The methods by name, and what is measured of each on one sample."""

import time
from functools import partial
from importlib.util import find_spec

import numpy as np

from benchmarks.solver import dynamics, fire, knitlab_solver, lbfgs
from benchmarks.solver.cholmod import CholmodSystem
from benchmarks.solver.measurement import ACROSS_EDGE, TOLERANCE, Measurement, Record
from benchmarks.solver.problem import Method, Problem, by
from benchmarks.solver.watch import GivenUp, OutOfTime, Watch

TRIALS = {
    "dynamics": (0.015, 0.03, 0.05, 0.1, 0.2, 0.4),
    "fire": (0.005, 0.01, 0.015, 0.02, 0.03),
    "lbfgs": (5, 10, 20, 40),
}
"""Values tried of the one number of a method: damping ratio [1], initial time step
[√(g mm/N)], steps remembered."""
UNTRIED = {"dynamics": 0.1, "fire": 0.01, "lbfgs": 20}
"""What is taken while none has been tried."""
SOLVERS = ("knitlab", "knitlab_direct", "knitlab_cholmod", "dynamics", "fire", "lbfgs")
"""Methods that start from the flat sheet."""
AS_SWEPT = "knitlab_as_swept"
"""knitlab, starting as a sweep does from relaxed periodic fabric."""
SWEPT = (AS_SWEPT, ACROSS_EDGE)
"""Methods that run as a sweep runs one case, on as many threads as a measurement says."""
RESIDUAL_LEVELS = 10.0 ** np.arange(0, -6.01, -0.25)
"""Residuals whose first times are kept [N]."""


def installed(solver: str) -> bool:
    """Whether what a solver needs is there."""
    needs = {"knitlab_cholmod": "cvxopt", "cholmod": "cvxopt", "pardiso": "pypardiso"}
    return solver not in needs or find_spec(needs[solver]) is not None


def method(measurement: Measurement) -> Method:
    """The method that a measurement names."""
    solver, setting = measurement.solver, measurement.setting
    moving = measurement.case("method=dynamics").motion
    still = measurement.case().equilibrium_solver
    if setting is None:
        setting = UNTRIED.get(solver, 0.0)
    match solver:
        case "knitlab":
            return knitlab_solver.knitlab(still)
        case _ if solver in SWEPT:
            return knitlab_solver.knitlab(still, periodic=measurement.case().periodic_cell)
        case "knitlab_direct":
            return knitlab_solver.knitlab(still, direct=True)
        case "knitlab_cholmod":
            return knitlab_solver.knitlab(still, CholmodSystem)
        case "dynamics":
            return by(dynamics.dynamics(moving, setting), partial(dynamics.prepare, moving))
        case "fire":
            return by(fire.fire(setting), fire.prepare)
        case "lbfgs":
            return by(lbfgs.lbfgs(setting), lbfgs.prepare)
    known = ", ".join((*SOLVERS, *SWEPT))
    raise ValueError(f"{solver} is not a solver; choose from {known}")


def measure(measurement: Measurement) -> Record:
    """Relax a sample, and pull it where tension is asked for."""
    problem = Problem.of(measurement.case("method=dynamics"), TOLERANCE)
    chosen = method(measurement)
    began = time.perf_counter()
    chosen.prepare(problem)
    compiled = time.perf_counter() - began
    watch, reason = Watch(measurement.time_limit, measurement.workers), ""
    values: Record = {}
    try:
        if measurement.task == "tension":
            last = chosen.pull(problem, watch)[-1]
        else:
            last = chosen.relax(problem, watch)
        values["seconds"] = watch.seconds
        values["energy"] = float(problem.evaluate(last).energy.total)
    except GivenUp as error:
        reason = str(error)
        if isinstance(error, OutOfTime):
            values["given_up_after"] = watch.seconds
    free = 3 * problem.shape.nodes
    return (
        values
        | _cost(watch, reason)
        | {
            "compile_seconds": compiled,
            "unknowns": free,
            "nodes": problem.shape.nodes,
            "first_times": watch.first_times(RESIDUAL_LEVELS),
        }
    )


def measure_shipped(measurement: Measurement) -> Record:
    """Relax a sample as a sweep does; factorisations are those of the sample itself."""
    case, reason = measurement.case(), ""
    watch = Watch(measurement.time_limit, measurement.workers)
    values: Record = {"nodes": case.mesh_shape.nodes, "unknowns": 3 * case.mesh_shape.nodes}
    try:
        state = knitlab_solver.shipped_relaxation(case, watch)
    except GivenUp as error:
        return values | _cost(watch, str(error))
    if not state.converged:
        reason = f"the search {state.outcome.name.replace('_', ' ')}"
    values |= _cost(watch, reason)
    if state.converged:
        values |= {"seconds": watch.seconds, "energy": float(state.energy.total)}
    return values | {"factorisations": state.factorisations, "evaluations": state.iterations}


def _cost(watch: Watch, reason: str) -> Record:
    return {
        "reached": not reason,
        "reason": reason,
        "residual": watch.residual,
        "states": watch.states,
        "evaluations": watch.evaluations,
        "factorisations": watch.factorisations,
        **watch.parts,
    }
