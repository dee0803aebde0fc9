"""A batch: fabrics of one mesh shape, one after the other, or in step on the device JAX sees.

In step they are evaluated, factored and solved with vmapped, which a sweep does where JAX sees an
accelerator. Where it sees none they do so on the processor, to show what that costs there.
"""

import time
from dataclasses import replace

import jax
import numpy as np

from benchmarks.solver.measurement import CONCURRENT, IN_STEP, IN_TURN, Measurement, Record
from knitlab.simulation.simulate import equilibrium_tests
from knitlab.solvers.batch import run_in_lockstep
from knitlab.solvers.runners import Runner, run_concurrently, run_sequentially

FABRICS, SOFTEST, STIFFEST = 16, 0.7, 1.4
"""How many there are, and from what to what their bending stiffness is multiplied."""
STRAINS_TO_COMPILE = 2
"""With the relaxed shape and one strain, all is compiled that a test of many needs."""

RUNNERS: dict[str, Runner] = {
    IN_TURN: run_sequentially,
    CONCURRENT: run_concurrently,
    IN_STEP: run_in_lockstep,
}


def measure(measurement: Measurement, fabrics: int = FABRICS) -> Record:
    """Relax and pull the fabrics of a batch, after a first one that compiles.

    Args:
        measurement: the sample, and how its fabrics are run.
        fabrics: how many they are.
    """
    factors = ",".join(f"{each:.4f}" for each in np.geomspace(SOFTEST, STIFFEST, fabrics))
    cases = measurement.cases(f"k_t_factor={factors}")
    short = [
        replace(case, applied_strain=case.applied_strain[:STRAINS_TO_COMPILE]) for case in cases
    ]
    runner = RUNNERS[measurement.solver]
    began = time.perf_counter()
    equilibrium_tests(short, lambda *_: None, runner)
    compiled = time.perf_counter()
    tests = equilibrium_tests(cases, lambda *_: None, runner)
    ended = time.perf_counter()
    states = [state for test in tests for state in test.states]
    reached = all(state.converged for state in states)
    record: Record = {
        "reached": reached,
        "reason": "" if reached else "a fabric did not reach the last strain",
        "device": jax.devices()[0].device_kind,
        "nodes": cases[0].mesh_shape.nodes,
        "compile_seconds": compiled - began,
        "residual": max(state.residual for state in states),
        "states": sum(state.converged for state in states),
        "evaluations": sum(state.iterations for state in states),
        "factorisations": sum(state.factorisations for state in states),
    }
    return record | ({"seconds": ended - compiled} if reached else {})
