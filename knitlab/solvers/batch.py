"""Batched execution of the solvers of many fabrics of one mesh shape, for accelerators.

In every round the requests of all solvers are answered together: evaluations and element Hessians
are vmapped; the stiffness is assembled, factorised and solved with on the device
(:mod:`knitlab.linalg.block_tridiagonal`). A solver that has ended, or that makes another kind of
request in this round, keeps its place, so that the compiled batch size is constant; its results
are discarded. The solvers are independent of each other.
"""

from collections.abc import Sequence
from functools import lru_cache, partial
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jaxtyping import Array, Bool, Float

from knitlab.elasticity.evaluation import Stage, element_hessians, evaluate
from knitlab.elasticity.stiffness import FreeStiffness
from knitlab.linalg.block_tridiagonal import (
    BlockFactors,
    BlockTridiagonal,
    block_tridiagonal,
    narrower,
)
from knitlab.model.fabric import Fabric
from knitlab.model.network import MeshShape, network
from knitlab.solvers.solver import (
    Assemble,
    ChangeDiagonal,
    Evaluate,
    Factorise,
    Request,
    Solver,
    SolveSubdomains,
)

Result = TypeVar("Result")
Numbers = TypeVar("Numbers")


def stacked(cases: Sequence[Numbers]) -> Numbers:
    """Stack pytrees of equal structure, such as fabrics of one mesh shape, along a first axis."""
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *cases)


@lru_cache(maxsize=16)
def _evaluator(shape: MeshShape) -> Any:
    return jax.jit(jax.vmap(partial(evaluate, network(shape))))


class _BatchStiffness:
    """Stiffness of all fabrics of a batch, for one choice of free unknowns, on the device."""

    def __init__(self, free: FreeStiffness, cases: int) -> None:
        net = network(free.shape)
        plan = block_tridiagonal(free.indptr, free.indices, narrower(*free.grid))
        mesh = free.mesh
        maps = [_SparseSum.of(m) for m in (mesh.from_springs, mesh.from_hinges, mesh.from_walls)]
        selected = jnp.asarray(free.selected)
        diagonal = jnp.asarray(free.diagonal)

        def entries(
            fabric: Fabric, stage: Stage, unknowns: Float[Array, " unknown"]
        ) -> Float[Array, " nonzero"]:
            hessians = element_hessians(net, fabric, stage, unknowns)
            parts = hessians.springs, hessians.hinges, hessians.walls
            sums = (apply(part) for apply, part in zip(maps, parts, strict=True))
            return sum(sums, jnp.zeros(()))[selected]

        def factors(
            plan: BlockTridiagonal, entries: Float[Array, " nonzero"], shift: Float[Array, ""]
        ) -> BlockFactors:
            return plan.factorise(entries.at[diagonal].add(shift))

        self._plan, self._assemble = plan, jax.jit(jax.vmap(entries))
        self._factorise = jax.jit(jax.vmap(factors, (None, 0, 0)))
        self._solve = jax.jit(jax.vmap(BlockFactors.solve))
        self.entries = jnp.zeros((cases, len(free.indices)))
        self.factors: BlockFactors | None = None

    def assemble(self, selected: Bool[Array, " case"], *points: Any) -> None:
        self.entries = _chosen(selected, self._assemble(*points), self.entries)

    def factorise(
        self, selected: Bool[Array, " case"], shifts: Float[Array, " case"]
    ) -> Bool[np.ndarray, " case"]:
        new = self._factorise(self._plan, self.entries, shifts)
        self.factors = new if self.factors is None else _chosen(selected, new, self.factors)
        return np.asarray(new.positive)

    def solve(self, right: Float[Array, "case free"]) -> Float[np.ndarray, "case free"]:
        if self.factors is None:
            raise RuntimeError("nothing is factorised")
        return np.asarray(self._solve(self.factors, right))


class _SparseSum(eqx.Module):
    """A constant sparse matrix on the device, applied by a segmented sum."""

    rows: Array
    columns: Array
    factors: Array
    size: int = eqx.field(static=True)

    @classmethod
    def of(cls, matrix: sp.csr_array) -> "_SparseSum":
        rows = np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))
        return cls(
            rows=jnp.asarray(rows),
            columns=jnp.asarray(matrix.indices),
            factors=jnp.asarray(matrix.data),
            size=matrix.shape[0],
        )

    def __call__(self, values: Float[Array | np.ndarray, "..."]) -> Float[Array, " nonzero"]:
        terms = self.factors * values.ravel()[self.columns]
        return jax.ops.segment_sum(terms, self.rows, self.size, indices_are_sorted=True)


def _chosen(selected: Bool[Array, " case"], new: Numbers, old: Numbers) -> Numbers:
    def choose(of_new: Array, of_old: Array) -> Array:
        return jnp.where(selected.reshape(-1, *[1] * (of_new.ndim - 1)), of_new, of_old)

    return jax.tree.map(choose, new, old)


class _Batch:
    """Answers the requests of all solvers of a batch."""

    def __init__(self, shape: MeshShape, fabrics: Sequence[Fabric]) -> None:
        self._evaluate, self._fabrics = _evaluator(shape), stacked(fabrics)
        self._cases = len(fabrics)
        self._stiffnesses: dict[FreeStiffness, _BatchStiffness] = {}
        self._free: dict[int, FreeStiffness] = {}
        self._at: list[Evaluate | Assemble | None] = [None] * self._cases

    def answers(self, requests: dict[int, Request]) -> dict[int, Any]:
        """Answers to the requests of these cases."""
        groups: dict[Any, dict[int, Request]] = {}
        results: dict[int, Any] = {}
        for case, request in requests.items():
            if isinstance(request, SolveSubdomains):
                # Subdomains, solved one after another, would leave an accelerator idle.
                self._at[case], results[case] = request.at, (request.at, 0.0)
                continue
            if isinstance(request, Evaluate | Assemble):
                self._at[case] = request
            if isinstance(request, Assemble):
                self._free[case] = request.free
            free = None if isinstance(request, Evaluate) else self._free[case]
            groups.setdefault((type(request), free), {})[case] = request
        for (kind, free), group in groups.items():
            computed = self._computed(kind, free, group)
            results |= {case: computed[case] for case in group}
        return results

    def _computed(self, kind: type, free: Any, group: dict[int, Any]) -> Any:
        selected = jnp.asarray([case in group for case in range(self._cases)])
        if kind is Evaluate:
            return _unstacked(self._evaluate(self._fabrics, *self._points()), self._cases)
        if free not in self._stiffnesses:
            self._stiffnesses[free] = _BatchStiffness(free, self._cases)
        stiffness = self._stiffnesses[free]
        if kind is Assemble:
            stiffness.assemble(selected, self._fabrics, *self._points())
            return dict.fromkeys(group)
        if kind is Factorise:
            shifts = [group[c].shift if c in group else 1.0 for c in range(self._cases)]
            return stiffness.factorise(selected, jnp.asarray(shifts))
        nothing = np.zeros(len(free.places))
        right = [group[c].right if c in group else nothing for c in range(self._cases)]
        return stiffness.solve(jnp.asarray(np.array(right)))

    def _points(self) -> tuple[Stage, Float[Array, "case unknown"]]:
        points = [request for request in self._at if request is not None]
        stages = [Stage(jnp.asarray(p.stage.fold), jnp.asarray(p.stage.wall)) for p in points]
        return stacked(stages), jnp.asarray(np.array([point.unknowns for point in points]))


def _unstacked(batch: Numbers, cases: int) -> list[Numbers]:
    leaves, structure = jax.tree.flatten(jax.tree.map(np.asarray, batch))
    return [jax.tree.unflatten(structure, [leaf[case] for leaf in leaves]) for case in range(cases)]


def run_in_lockstep(
    shape: MeshShape, fabrics: Sequence[Fabric], solvers: Sequence[Solver[Result]]
) -> list[Result]:
    """Run one solver for each fabric, all in lockstep, and return their results in order.

    Args:
        shape: mesh shape of all fabrics.
        fabrics: the fabrics.
        solvers: one for each; its first request must be an evaluation or subdomain solutions.
    """
    batch = _Batch(shape, fabrics)
    results: dict[int, Result] = {}
    answers: dict[int, Any] = dict.fromkeys(range(len(solvers)))
    while answers:
        requests: dict[int, Request] = {}
        for case, answer in answers.items():
            try:
                request = solvers[case].send(answer)
                while isinstance(request, ChangeDiagonal):
                    # Low-rank updates of a few cases would leave an accelerator idle.
                    request = solvers[case].send(False)
                requests[case] = request
            except StopIteration as end:
                results[case] = end.value
        answers = batch.answers(requests)
    return [results[case] for case in range(len(solvers))]
