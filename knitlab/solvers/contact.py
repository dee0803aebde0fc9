"""The contact of the fabric of a case with itself."""

from typing import TYPE_CHECKING

from knitlab.solvers.case import Case

if TYPE_CHECKING:
    from knitlab.solvers.equilibrium.contact_barrier import Barrier


def contact_of(case: Case) -> "Barrier | None":
    """The contact of the fabric of a case; ``None`` if it may pass through itself."""
    if case.options.contact == "none":
        return None
    from knitlab.solvers.equilibrium.contact_barrier import Barrier

    return Barrier(case.mesh_shape, case.contact_layers)
