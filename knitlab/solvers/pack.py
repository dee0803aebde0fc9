"""Packs on a CPU: solvers of small fabrics that are evaluated together.

All solvers of a pack are run to their next evaluation or assembly. These are computed together,
vmapped over the elements of all fabrics (:mod:`knitlab.elasticity.fabric_pack`); factorisations and
solves, whose cost depends on the fabric, are done one by one. A solver that has ended leaves the
pack.
"""

from collections.abc import Sequence
from threading import Event
from typing import Any, TypeVar

from knitlab.elasticity.fabric_pack import FabricPack
from knitlab.model.fabric import Fabric
from knitlab.model.network import MeshShape
from knitlab.solvers.executor import Executor
from knitlab.solvers.solver import Assemble, Evaluate, Solver

Result = TypeVar("Result")


def run_pack(
    shape: MeshShape, cases: Sequence[tuple[Fabric, Solver[Result]]], stopped: Event
) -> list[Result]:
    """Run the solvers of the fabrics of a pack and return their results in order.

    Args:
        shape: mesh shape of all fabrics.
        cases: fabrics with one kind of fold angle and spring law, and the solver of each.
        stopped: if this is set meanwhile, the solvers are abandoned.

    Raises:
        InterruptedError: if they were abandoned.
    """
    fabrics, solvers = [fabric for fabric, _ in cases], [solver for _, solver in cases]
    pack = FabricPack(shape, fabrics)
    executors = [Executor(shape, fabric) for fabric in fabrics]
    results: dict[int, Result] = {}
    answers: dict[int, Any] = dict.fromkeys(range(len(solvers)))
    waiting: dict[int, Evaluate | Assemble] = {}
    while answers or waiting:
        if stopped.is_set():
            for solver in solvers:
                solver.close()
            raise InterruptedError("the solvers were abandoned")
        for member, answer in answers.items():
            try:
                waiting[member] = _next_joint_request(executors[member], solvers[member], answer)
            except StopIteration as end:
                results[member] = end.value
        assembling = {k: request for k, request in waiting.items() if isinstance(request, Assemble)}
        joint = assembling or waiting
        points = {k: (joint[k].stage, joint[k].unknowns) for k in sorted(joint)}
        if assembling:
            for member, hessians in pack.element_hessians(points).items():
                executors[member].assemble(assembling[member].free, hessians)
            answers = dict.fromkeys(points)
        else:
            answers = dict(pack.evaluate(points)) if points else {}
        waiting = {k: request for k, request in waiting.items() if k not in answers}
    return [results[member] for member in range(len(solvers))]


def _next_joint_request(
    executor: Executor, solver: Solver[Result], answer: Any
) -> Evaluate | Assemble:
    """The next request of a solver that the fabrics of a pack are answered together.

    Raises:
        StopIteration: if the solver ends.
    """
    while True:
        request = solver.send(answer)
        if isinstance(request, Evaluate | Assemble):
            return request
        answer = executor.answer(request)
