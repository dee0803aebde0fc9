"""Runners: they run the solvers of fabrics of one mesh shape.

:func:`run_all` chooses: on an accelerator all fabrics run in lockstep
(:mod:`knitlab.solvers.batch`); on a CPU, packs of small fabrics run concurrently, one pack to a
thread (:mod:`knitlab.solvers.pack`), and large fabrics one after another.
"""

from collections.abc import Sequence
from threading import Event
from typing import Protocol, TypeVar

import jax

from knitlab.elasticity.fabric_pack import pack_size
from knitlab.elasticity.factorisation import one_thread_of_blas
from knitlab.linalg.threads import Threads, allowed_threads
from knitlab.model.fabric import Fabric
from knitlab.model.network import MeshShape
from knitlab.solvers.batch import run_in_lockstep
from knitlab.solvers.executor import Executor, run, run_to_end
from knitlab.solvers.pack import run_pack
from knitlab.solvers.solver import Solver

LARGEST_CONCURRENT = 4096
"""Number of nodes up to which fabrics run concurrently on a CPU."""

Result = TypeVar("Result")


class Runner(Protocol):
    """Runs solvers of fabrics of one mesh shape."""

    def __call__(
        self, shape: MeshShape, fabrics: Sequence[Fabric], solvers: Sequence[Solver[Result]], /
    ) -> list[Result]:
        """Run one solver for each fabric and return their results in order."""


def run_sequentially(
    shape: MeshShape, fabrics: Sequence[Fabric], solvers: Sequence[Solver[Result]]
) -> list[Result]:
    """The :class:`Runner` that runs one solver after another, each on all threads."""
    return [run(shape, *each) for each in zip(fabrics, solvers, strict=True)]


def run_concurrently(
    shape: MeshShape, fabrics: Sequence[Fabric], solvers: Sequence[Solver[Result]]
) -> list[Result]:
    """The :class:`Runner` that runs as many packs at the same time as there are threads.

    A pack has as many fabrics as fill its chunks of elements well; one if the fabric is larger. A
    thread whose pack has ended takes the next one. The results are those of one after another, to
    round-off.
    """
    stopped, count = Event(), min(allowed_threads(), len(fabrics))
    # Rather small packs than an idle thread.
    size = min(pack_size(shape.nodes), -(-len(fabrics) // count)) if _alike(fabrics) else 1
    cases = list(zip(fabrics, solvers, strict=True))
    packs = [cases[first : first + size] for first in range(0, len(cases), size)]

    def run_together(pack: Sequence[tuple[Fabric, Solver[Result]]]) -> list[Result]:
        if len(pack) == 1:
            ((fabric, solver),) = pack
            return [run_to_end(Executor(shape, fabric), solver, stopped)]
        return run_pack(shape, pack, stopped)

    try:
        with one_thread_of_blas():
            found = Threads(min(count, len(packs))).each(run_together, packs)
            return [result for results in found for result in results]
    except BaseException:
        # Python would wait for the other threads before it exits.
        stopped.set()
        raise


def _alike(fabrics: Sequence[Fabric]) -> bool:
    """Whether fabrics have one kind of fold angle and of spring law."""
    kinds = {
        (jax.tree.structure(fabric), tuple(leaf.shape for leaf in jax.tree.leaves(fabric)))
        for fabric in fabrics
    }
    return len(kinds) == 1


def run_all(
    shape: MeshShape, fabrics: Sequence[Fabric], solvers: Sequence[Solver[Result]]
) -> list[Result]:
    """The :class:`Runner` that suits the machine and the mesh shape.

    On an accelerator the fabrics run in lockstep, vmapped, including the factorisation. On a CPU
    small fabrics run concurrently and in packs; large ones one after another, as their elements and
    fronts keep all threads busy.
    """
    if jax.default_backend() != "cpu":
        runner: Runner = run_in_lockstep
    else:
        small = shape.nodes <= LARGEST_CONCURRENT and len(fabrics) > 1
        runner = run_concurrently if small else run_sequentially
    return runner(shape, fabrics, solvers)
