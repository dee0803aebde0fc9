"""The equations of one fabric: its energy, forces and factorised stiffness, as solvers use them."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from threading import Event
from typing import TYPE_CHECKING, Protocol

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int
from threadpoolctl import ThreadpoolController

from knitlab.model.energy import Evaluation, Point
from knitlab.model.fabric import Fabric
from knitlab.model.network import MeshShape
from knitlab.model.threads import ALONE, Threads
from knitlab.solvers.element_chunks import ChunkedFabric
from knitlab.solvers.equilibrium.drag import Drag
from knitlab.solvers.equilibrium.settings import Solver
from knitlab.solvers.equilibrium.stiffness import FreeStiffness
from knitlab.solvers.equilibrium.subdomains import worth_dividing
from knitlab.solvers.factorisation.multifrontal import Multifrontal
from knitlab.solvers.factorisation.symbolic_factorisation import planned

if TYPE_CHECKING:  # which takes seconds to import
    from knitlab.solvers.equilibrium.contact_barrier import Barrier

MAX_EARLIER_COUPLINGS = 4  # couplings that are kept, over those of the present contact
KeptFactors = dict[tuple[FreeStiffness, bool], Multifrontal]
"""Factors by free unknowns, and by whether they are in double precision; their memory is reused."""


class Subdomains(Protocol):
    """What solves the subdomains of a large sample (``domain_decomposition.py``)."""

    def solve(
        self, system: "System", at: Point, free: FreeStiffness, settings: Solver
    ) -> tuple[Point, float]:
        """The state of the sample after its subdomains are solved, and the number of iterations."""
        ...


class System:
    """Energy, forces and factorised stiffness of one fabric, and of its contact with itself.

    If ``stopped`` is set by another thread, the next evaluation raises ``InterruptedError``.
    Systems of one thread may share the factors ``kept``.
    """

    def __init__(
        self,
        shape: MeshShape,
        fabric: Fabric,
        threads: Threads = ALONE,
        stopped: Event | None = None,
        kept: KeptFactors | None = None,
        contact: "Barrier | None" = None,
    ) -> None:
        self.shape = shape
        self.fabric = fabric
        self.threads = threads
        self.contact = contact
        self.factorised: Callable[[], None] = lambda: None
        self.subdomains: Subdomains | None = None
        self._kept: KeptFactors = {} if kept is None else kept
        self._elements = ChunkedFabric(shape, fabric, threads)
        self._stopped = stopped
        self._free: FreeStiffness | None = None
        self._entries = np.zeros(0)
        self._contact_entries: sp.coo_array | None = None
        self._factors: Multifrontal | None = None
        self._touching: ContactFactors | None = None

    def on(self, shape: MeshShape) -> "System":
        """The same fabric, with the unknowns of another mesh shape."""
        if shape == self.shape:
            return self
        contact = self.contact and self.contact.on(shape)
        system = System(shape, self.fabric, self.threads, self._stopped, contact=contact)
        system.factorised = self.factorised
        return system

    def with_fabric(self, fabric: Fabric) -> "System":
        """The equations of another fabric of the same mesh shape, with the same memory."""
        own = self.threads, self._stopped, self._kept, self.contact
        system = System(self.shape, fabric, *own)
        system.factorised = self.factorised
        return system

    def evaluate(self, at: Point, drag: Drag | None = None) -> Evaluation:
        """Energy and gradient, in NumPy arrays."""
        if self._stopped is not None and self._stopped.is_set():
            raise InterruptedError("the search was abandoned")
        evaluation = self._elements.evaluate(at.stage, at.unknowns)
        if drag is not None:
            evaluation = drag.added(evaluation, at.unknowns)
        if self.contact is None or not np.isfinite(at.unknowns).all():
            return evaluation
        return self.contact.added(evaluation, at.unknowns)

    def assemble(self, at: Point, free: FreeStiffness) -> None:
        """Assemble the stiffness of the free unknowns."""
        hessians = self._elements.element_hessians(at.stage, at.unknowns)
        self._free = free
        self._entries = free.entries(hessians, self.threads)
        pairs = self.contact and self.contact.hessian(at.unknowns, free.dofs)
        self._contact_entries = None if pairs is None else sp.tril(pairs, format="coo")

    def factorise(self, shift: float, convexified: bool, exact: bool = False) -> bool:
        """Factorise the assembled stiffness plus a shift [N/mm]; whether it is positive definite.

        With ``convexified`` it is replaced by a nearby positive definite matrix instead of failing.
        It is in single precision, enough for a search, unless ``exact``.
        """
        free = self._free
        assert free is not None, "nothing is assembled"
        key = (free, exact)
        entries = free.shifted(self._entries, shift)
        lower = self._contact_entries
        if lower is not None:
            if self._touching is None or not self._touching.holds(free, exact, lower):
                self._touching = ContactFactors(free, exact, lower, self._touching, self.threads)
            factors = self._touching.factors
            entries = self._touching.entries(entries, lower)
        elif key in self._kept:
            factors = self._kept[key]
        else:
            if worth_dividing(self.shape):
                # Factors are most of the memory of a large sample, whose free unknowns change only
                # once, between relaxation and tensile test.
                self._factors = None
                for old in [old for old in self._kept if old[0].shape == self.shape]:
                    del self._kept[old]
            precision = np.float64 if exact else np.float32
            factors = self._kept[key] = Multifrontal(free.plan, self.threads, precision)
        self._factors = factors if factors.factorise(entries, convexified) else None
        self.factorised()
        return self._factors is not None

    def change_diagonal(
        self, dofs: Int[np.ndarray, " changed"], changes: Float[np.ndarray, " changed"]
    ) -> bool:
        """Add to the factorised diagonal, in place of earlier changes; False if not definite."""
        return self._factor.change_diagonal(dofs, changes)

    def solve(self, right: Float[np.ndarray, " free"]) -> Float[np.ndarray, " free"]:
        """K⁻¹ times a vector, with the last factorisation."""
        return self._factor.solve(right)

    @property
    def _factor(self) -> Multifrontal:
        assert self._factors is not None, "nothing is factorised"
        return self._factors


class ContactFactors:
    """Factors of the stiffness of fabric that touches itself, for its couplings by contact so far.

    Couplings of earlier contact are kept, as a new symbolic factorisation takes as long as the
    numeric one, unless they are many times those of the present.
    """

    def __init__(
        self,
        free: FreeStiffness,
        exact: bool,
        contact: sp.coo_array,
        before: "ContactFactors | None",
        threads: Threads,
    ) -> None:
        self._free = free
        self._exact = exact
        size = len(free.dofs)
        of_grid = np.repeat(np.arange(size), np.diff(free.indptr)) * size + free.indices
        present = np.setdiff1d(np.unique(self._keys(free, contact)), of_grid, assume_unique=True)
        self._coupled = present
        if before is not None and before._free is free:
            both = np.union1d(present, before._coupled)
            if len(both) <= MAX_EARLIER_COUPLINGS * len(present):
                self._coupled = both
        self._every = np.sort(np.concatenate([of_grid, self._coupled]), kind="stable")
        self._of_grid = np.searchsorted(self._every, of_grid)
        column, row = np.divmod(self._every, size)
        indptr = np.searchsorted(column, np.arange(size + 1))
        precision = np.float64 if exact else np.float32
        self.factors = Multifrontal(planned(free.order, indptr, row), threads, precision)

    @staticmethod
    def _keys(free: FreeStiffness, contact: sp.coo_array) -> Int[np.ndarray, " coupling"]:
        """Places of the entries of contact in the stiffness, column by column."""
        return contact.col.astype(np.int64) * len(free.dofs) + contact.row

    def holds(self, free: FreeStiffness, exact: bool, contact: sp.coo_array) -> bool:
        """Whether they are of these free unknowns and precision, and have all couplings."""
        if (free, exact) != (self._free, self._exact):
            return False
        keys = self._keys(free, contact)
        at = np.minimum(np.searchsorted(self._every, keys), len(self._every) - 1)
        return bool((self._every[at] == keys).all())

    def entries(
        self, entries: Float[np.ndarray, " nonzero"], contact: sp.coo_array
    ) -> Float[np.ndarray, " coupled"]:
        """Non-zeros of the stiffness with those of contact added [N/mm]."""
        every = np.zeros(len(self._every))
        every[self._of_grid] = entries
        places = np.searchsorted(self._every, self._keys(self._free, contact))
        every[places] += contact.data
        return every


def one_thread_of_blas() -> AbstractContextManager[object]:
    """Limit BLAS to one thread, as more threads slow down small fronts."""
    return ThreadpoolController().limit(limits=1, user_api="blas")
