"""The contact of the fabric of a case with itself."""

from typing import TYPE_CHECKING

import numpy as np

from knitlab.solvers.case import Case

if TYPE_CHECKING:
    from knitlab.solvers.equilibrium.contact_barrier import Barrier


def contact_of(case: Case) -> "Barrier | None":
    """The contact of the fabric of a case; ``None`` if it may pass through itself."""
    if case.options.contact == "none":
        return None
    from knitlab.solvers.equilibrium.contact_barrier import Barrier

    _, fabric = case.assemble()
    cell = float(np.mean(fabric.cell_x)), float(np.mean(fabric.cell_y))
    sheet, refinement = case.sheet_of_network, case.options.cells_per_period
    return Barrier(case.mesh_shape, sheet.thickness, sheet.contact_pressure, cell, refinement)
