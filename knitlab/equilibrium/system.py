"""The equations of one fabric: its energy, forces and factorised stiffness, as solvers use them."""

from collections.abc import Callable
from threading import Event

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from knitlab.equilibrium.factorisation import (
    Factoriser,
    Factorisers,
    Factors,
    factorise_with_contact,
    factoriser,
)
from knitlab.equilibrium.stiffness import FreeStiffness
from knitlab.fabric.element_chunks import ChunkedFabric
from knitlab.fabric.energy import Evaluation, Point
from knitlab.fabric.fabric import Fabric
from knitlab.fabric.network import MeshShape
from knitlab.fabric.threads import ALONE, Threads


class System:
    """Energy, forces and factorised stiffness of one fabric.

    Args:
        shape: mesh shape of the fabric.
        fabric: the fabric.
        factorisers: cache of factorisers, to which new ones are added.
        threads: threads that share the work.
        stopped: if this is set by another thread, the next evaluation raises ``InterruptedError``.

    Attributes:
        factorised: called after every factorisation, to report progress.
    """

    def __init__(
        self,
        shape: MeshShape,
        fabric: Fabric,
        factorisers: Factorisers | None = None,
        threads: Threads = ALONE,
        stopped: Event | None = None,
    ) -> None:
        self.shape, self.fabric, self.threads = shape, fabric, threads
        self.factorised: Callable[[], None] = lambda: None
        self.factorisers = {} if factorisers is None else factorisers
        self._elements, self._stopped = ChunkedFabric(shape, fabric, threads), stopped
        self._free: FreeStiffness | None = None
        self._entries = np.zeros(0)
        self._factors: Factors | None = None

    def evaluate(self, at: Point) -> Evaluation:
        """Energy and gradient, in NumPy arrays."""
        if self._stopped is not None and self._stopped.is_set():
            raise InterruptedError("the search was abandoned")
        return self._elements.evaluate(at.stage, at.unknowns)

    def assemble(self, at: Point, free: FreeStiffness) -> None:
        """Assemble the stiffness of the free unknowns."""
        hessians = self._elements.element_hessians(at.stage, at.unknowns)
        self._free, self._entries = free, free.entries(hessians, self.threads)

    def factorise(
        self,
        shift: float,
        convexified: bool,
        contact: sp.csc_array | None = None,
        exact: bool = False,
    ) -> bool:
        """Factorise the assembled stiffness plus a shift; whether it is positive definite.

        Args:
            shift: added to the diagonal [N/mm].
            convexified: whether to factorise a nearby positive definite matrix instead of failing.
            contact: Hessian of the contact, if any is active, to be added; it may couple any two
                unknowns. The matrix is not convexified then, and factorised in double precision:
                the long steps that convexity allows would end at the next collision [N/mm].
            exact: whether in double precision. Single precision takes half the time and memory,
                and is enough for a search, whose forces are those of the exact energy.
        """
        if self._free is None:
            raise RuntimeError("nothing is assembled")
        free, entries = self._free, self._free.shifted(self._entries, shift)
        if contact is not None:
            self._factors = factorise_with_contact(free, entries, contact, self.threads)
        else:
            if (free, exact) not in self.factorisers:
                self.release_factors()
                self.factorisers[free, exact] = self.new_factoriser(free, exact)
            self._factors = self.factorisers[free, exact](entries, convexified)
        self.factorised()
        return self._factors is not None

    def new_factoriser(self, free: FreeStiffness, exact: bool) -> Factoriser:
        """What factorises the stiffness of these free unknowns; ``exact`` in double precision."""
        return factoriser(free, self.threads, np.float64 if exact else np.float32)

    def release_factors(self) -> None:
        """Release the memory of factors that are not needed any more; here it is little."""

    def change_diagonal(
        self, places: Int[np.ndarray, " changed"], changes: Float[np.ndarray, " changed"]
    ) -> bool:
        """Change the diagonal of the factorised stiffness for the next solves.

        It replaces earlier changes.

        Args:
            places: indices among the free unknowns.
            changes: what is added at each, not 0 [N/mm].

        Returns:
            Whether the stiffness is positive definite then; if not it is as it was factorised.
        """
        return self._factor.change_diagonal(places, changes)

    def solve(self, right: Float[np.ndarray, " free"]) -> Float[np.ndarray, " free"]:
        """K⁻¹ times a vector, with the last factorisation."""
        return self._factor.solve(right)

    @property
    def _factor(self) -> Factors:
        if self._factors is None:
            raise RuntimeError("nothing is factorised")
        return self._factors
