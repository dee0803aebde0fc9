"""A problem: one sample to relax and to pull, and the protocol that every method follows."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from knitlab.model.energy import COMPLETE, Evaluation
from knitlab.model.fabric import Configuration, Fabric, flat_sheet
from knitlab.model.inertia import Inertia
from knitlab.model.network import MeshShape, Network
from knitlab.solvers.case import Case
from knitlab.solvers.element_chunks import ChunkedFabric
from knitlab.solvers.equilibrium.alignment import rigidly_aligned
from knitlab.solvers.loads.loading import all_free, loading_of

Unknowns = Float[np.ndarray, " unknown"]
"""A configuration, flattened [mm]."""
Free = Int[np.ndarray, " free"]


@dataclass(frozen=True, eq=False)
class Problem:
    """A sample, and how far its forces are to fall.

    Attributes:
        net: its network.
        fabric: its numbers.
        inertia: its mass and drag, where they are asked for.
        applied_strain: of its tensile test, ascending from 0.
        tolerance: largest force that may be left on a free unknown [N].
    """

    net: Network
    fabric: Fabric
    inertia: Inertia | None
    applied_strain: Sequence[float]
    tolerance: float

    @classmethod
    def of(cls, case: Case, tolerance: float) -> "Problem":
        """The problem that a case poses."""
        its = case.inertia() if case.dynamics else None
        return cls(*case.assemble(), its, case.applied_strain, tolerance)

    @property
    def shape(self) -> MeshShape:
        """Its mesh shape."""
        return self.net.shape

    @cached_property
    def flat(self) -> Unknowns:
        """The flat sheet, from which everyone starts [mm]."""
        return np.asarray(flat_sheet(self.net, self.fabric).flattened())

    @cached_property
    def chunked(self) -> ChunkedFabric:
        """Its fabric in chunks of elements."""
        return ChunkedFabric(self.shape, self.fabric)

    def which(self, free: Free) -> Bool[np.ndarray, " unknown"]:
        """Of every unknown, whether it is free."""
        return np.isin(np.arange(self.shape.unknowns), free)

    def evaluate(self, unknowns: Unknowns) -> Evaluation:
        """Energy and gradient."""
        return self.chunked.evaluate(COMPLETE, unknowns)


Search = Callable[[Problem, Unknowns, Free], Unknowns]
"""Moves the free unknowns to where no force above the tolerance is left on them, or raises
:class:`GivenUp`."""


class GivenUp(Exception):
    """A search that is not going to reach the tolerance."""


def relaxed_by(search: Search, problem: Problem) -> Unknowns:
    """Relax a flat sheet; a sample for clamping is aligned and relaxed again, as by knitlab."""
    free = all_free(problem.shape)
    relaxed = search(problem, problem.flat, free)
    if problem.shape.periodic:
        return relaxed
    flat, shape = (Configuration.of(of, problem.shape) for of in (problem.flat, relaxed))
    aligned = np.asarray(rigidly_aligned(problem.shape, flat, shape).flattened())
    return search(problem, aligned, free)


def pulled_by(search: Search, problem: Problem) -> list[Unknowns]:
    """Relax and pull in as many steps as there are strains; every state in turn.

    The first step starts from an affine stretch, the others from the line through the last two
    states.
    """
    states = [relaxed_by(search, problem)]
    loading = loading_of(problem.shape, Configuration.of(states[0], problem.shape))
    strains = problem.applied_strain
    for place in range(1, len(strains)):
        passed = list(zip(strains[:place], states, strict=True))[-2:]
        states.append(search(problem, loading.ahead(passed, strains[place]), loading.free))
    return states
