"""Driving solvers: what they ask for is worked out here."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from queue import SimpleQueue
from typing import Any, Protocol, TypeVar

import jax
import numpy as np
from jaxtyping import Bool

from knitlab.linalg.threads import ALONE, Threads, allowed_threads
from knitlab.mechanics.batch import run_in_lockstep
from knitlab.mechanics.element_chunks import ChunkedFabric
from knitlab.mechanics.equilibrium import find_equilibrium
from knitlab.mechanics.equilibrium_search import SearchRules
from knitlab.mechanics.evaluation import Evaluation
from knitlab.mechanics.factorisation import Factoriser, Factors, factoriser, one_thread_of_blas
from knitlab.mechanics.second_process import SecondProcess, SubdomainData, SubdomainTask
from knitlab.mechanics.solver import (
    Assemble,
    Evaluate,
    Factorise,
    Request,
    Solve,
    Solver,
    SolveSubdomains,
)
from knitlab.mechanics.state import Outcome, State
from knitlab.mechanics.stiffness import FreeStiffness
from knitlab.mechanics.subdomains import Block, blocks, meet, rounds
from knitlab.model.fabric import Fabric
from knitlab.model.network import MeshShape

MOST_COMPANIONS = 7
"""Of one sample; each takes 0.4 to 0.9 GB."""

Result = TypeVar("Result")


class Runner(Protocol):
    """Runs solvers of fabrics of one mesh shape."""

    def __call__(
        self, shape: MeshShape, fabrics: Sequence[Fabric], solvers: Sequence[Solver[Result]], /
    ) -> list[Result]:
        """Run one solver a fabric and return what each returns, in order."""


class Executor:
    """Answers the requests of one fabric's solver on this processor.

    Args:
        shape: mesh shape of the fabric.
        fabric: its numbers.
        method: of factorisation; nested dissection by default.
        factorisers: those that there are, to be added to.
        threads: that share the work; where blocks settle, all but one have a companion do theirs.
    """

    def __init__(
        self,
        shape: MeshShape,
        fabric: Fabric,
        method: str | None = None,
        factorisers: dict[FreeStiffness, Factoriser] | None = None,
        threads: Threads = ALONE,
    ) -> None:
        self._whole, self._method, self._threads = fabric, method, threads
        self._fabric = ChunkedFabric.of(shape, fabric, threads)
        self._factorisers = {} if factorisers is None else factorisers
        self._pieces: dict[FreeStiffness, _Pieces] = {}
        self._free: FreeStiffness | None = None
        self._entries = np.zeros(0)
        self._factors: Factors | None = None

    def answer(self, request: Request) -> Any:
        """What a request asks for."""
        match request:
            case Evaluate(unknowns, stage):
                return self._fabric.evaluate(stage, unknowns)
            case Assemble(unknowns, free, stage):
                hessians = self._fabric.element_hessians(stage, unknowns)
                self._free, self._entries = free, free.entries(hessians, self._threads)
                return None
            case Factorise(shift, convexified):
                return self._factorise(shift, convexified)
            case Solve(right):
                if self._factors is None:
                    raise RuntimeError("nothing is factorised")
                return self._factors.solve(right)
            case SolveSubdomains():
                return self._settled(request)

    def _factorise(self, shift: float, convexified: bool) -> bool:
        free = self._free
        if free is None:
            raise RuntimeError("nothing is assembled")
        if free not in self._factorisers:
            self._factorisers[free] = factoriser(free, self._method, self._threads)
        self._factors = self._factorisers[free](free.shifted(self._entries, shift), convexified)
        return self._factors is not None

    def _settled(self, request: SolveSubdomains) -> tuple[Evaluate, float]:
        pieces = self._in_pieces(request.free)
        at, share = request.at.unknowns.copy(), 0.0
        gradient = np.asarray(self._fabric.evaluate(request.at.stage, at).gradient)
        forces = np.array([part.block.force(gradient) for part in pieces.parts])
        sides = self._sides

        def settled(place: int) -> State:
            part = pieces.parts[place]
            start = Evaluate(at[part.block.places], request.at.stage)
            name = pieces.number, place
            subdomain_task = SubdomainTask(name, start, request.step_length, request.settings)
            side = sides.get()
            try:
                state = side.settle(subdomain_task, part.piece) if side else None
                return state or solve_subdomain(part.executor, part.block.free, subdomain_task)
            finally:
                sides.put(side)

        for together in rounds(forces, pieces.meeting):
            for place, state in zip(together, self._threads.each(settled, together), strict=True):
                block = pieces.parts[place].block
                # A block that stalls, or ends further from rest than any was, may have folded a
                # cell to nothing, where no hinge has an angle.
                if state.outcome is not Outcome.stalled and state.residual <= forces.max():
                    at[block.places] = state.unknowns
                share += state.iterations * len(block.free.places) / len(request.free.places)
        return Evaluate(at, request.at.stage), share

    def _in_pieces(self, free: FreeStiffness) -> "_Pieces":
        if free not in self._pieces:
            found = list(blocks(free))
            parts = [self._part(block) for block in found]
            meeting = meet(found, free.shape.unknowns)
            self._pieces[free] = _Pieces(len(self._pieces), parts, meeting)
        return self._pieces[free]

    def _part(self, block: Block) -> "_Part":
        shape, fabric = block.free.shape, block.fabric(self._whole)
        piece = SubdomainData(shape, block.free.places, fabric, self._method)
        return _Part(block, piece, Executor(shape, fabric, self._method, self._factorisers))

    @cached_property
    def _sides(self) -> "SimpleQueue[SecondProcess | None]":
        """Who can settle a block now: this process (``None``) and its companions."""
        sides = SimpleQueue[SecondProcess | None]()
        sides.put(None)
        for _ in range(min(self._threads.count - 1, MOST_COMPANIONS)):
            sides.put(SecondProcess())
        return sides


@dataclass(frozen=True, eq=False)
class _Part:
    """A block, and what it takes to settle it.

    Attributes:
        block: which it is.
        piece: the same, as a companion has to know it.
        desk: for it in this process.
    """

    block: Block
    piece: SubdomainData
    executor: Executor


@dataclass(frozen=True, eq=False)
class _Pieces:
    """A sample in blocks.

    Attributes:
        number: of this way to cut it, of those that the sample has.
        parts: the blocks.
        meeting: which of them meet.
    """

    number: int
    parts: list[_Part]
    meeting: Bool[np.ndarray, "block block"]


def solve_subdomain(
    executor: Executor, free: FreeStiffness, subdomain_task: SubdomainTask
) -> State:
    """Where a block comes to rest by itself."""
    rules = SearchRules(
        free, subdomain_task.step_length, subdomain_task.settings, convexified=False
    )
    return run_to_end(executor, find_equilibrium(subdomain_task.start, rules))


def run(
    shape: MeshShape, fabric: Fabric, solver: Solver[Result], method: str | None = None
) -> Result:
    """Run the solver of one fabric to its end and return what it returns.

    As many threads as this process may use share the work; they change no bit of the result.
    """
    with one_thread_of_blas():
        return run_to_end(
            Executor(shape, fabric, method, threads=Threads(allowed_threads())), solver
        )


def run_to_end(executor: Executor, solver: Solver[Result]) -> Result:
    """Run a solver to its end at a desk and return what it returns."""
    answer: Evaluation | Any = None
    while True:
        try:
            answer = executor.answer(solver.send(answer))
        except StopIteration as end:
            return end.value


def run_in_turn(
    shape: MeshShape, fabrics: Sequence[Fabric], solvers: Sequence[Solver[Result]]
) -> list[Result]:
    """The :class:`Runner` that runs one after the other."""
    return [run(shape, *each) for each in zip(fabrics, solvers, strict=True)]


def run_all(
    shape: MeshShape, fabrics: Sequence[Fabric], solvers: Sequence[Solver[Result]]
) -> list[Result]:
    """The :class:`Runner` that suits the machine.

    On a processor one after the other is faster than any batch; where JAX sees an accelerator
    they run in step, vmapped, factorisation included.
    """
    runner: Runner = run_in_turn if jax.default_backend() == "cpu" else run_in_lockstep
    return runner(shape, fabrics, solvers)
