"""Lockstep: the solvers of several fabrics of one mesh shape, sharing one vmapped evaluation."""

from collections.abc import Sequence
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from knitlab.mechanics.evaluation import batch_evaluator
from knitlab.mechanics.newton import Solver
from knitlab.model.fabric import Fabric
from knitlab.model.network import MeshShape

Result = TypeVar("Result")
Numbers = TypeVar("Numbers", bound=eqx.Module)


def stacked(cases: Sequence[Numbers]) -> Numbers:
    """One batch of fabrics of one mesh shape, or what drives them, along a first axis."""
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *cases)


def run_in_lockstep(
    shape: MeshShape, fabrics: Sequence[Fabric], solvers: Sequence[Solver[Result]]
) -> list[Result]:
    """Run one solver a fabric to its end and return what each returns, in order.

    In every round the configurations that the solvers ask for are evaluated in one call. A
    solver that has ended keeps its place, with its last configuration, so that the compiled
    batch size stays; the solvers share nothing, so none can disturb another.
    """
    evaluator, batch = batch_evaluator(shape), stacked(fabrics)
    requests = [next(solver) for solver in solvers]
    results: dict[int, Result] = {}
    while len(results) < len(solvers):
        evaluations = evaluator(
            batch,
            jnp.array([request.fold_fraction for request in requests]),
            jnp.array([request.configuration for request in requests]),
        )
        leaves, structure = jax.tree.flatten(jax.tree.map(np.asarray, evaluations))
        own = [jax.tree.unflatten(structure, parts) for parts in zip(*leaves, strict=True)]
        for case, solver in enumerate(solvers):
            if case in results:
                continue
            try:
                requests[case] = solver.send(own[case])
            except StopIteration as end:
                results[case] = end.value
    return [results[case] for case in range(len(solvers))]
