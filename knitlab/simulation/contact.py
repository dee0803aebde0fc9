"""The contact of the fabric of a case with itself."""

from importlib.util import find_spec
from typing import TYPE_CHECKING

import numpy as np

from knitlab.io.errors import fault
from knitlab.simulation.case import Case

if TYPE_CHECKING:
    from knitlab.fabric.barrier import Barrier


def contact_of(case: Case) -> "Barrier | None":
    """The contact of the fabric of a case; ``None`` if it may pass through itself."""
    if case.options.contact == "none":
        return None
    if find_spec("ipctk") is None:
        raise fault("contact = barrier", "needs the package ipctk; pip install 'knitlab[contact]'")
    from knitlab.fabric.barrier import Barrier

    _, fabric = case.assemble()
    cell = float(np.mean(fabric.cell_x)), float(np.mean(fabric.cell_y))
    sheet, refinement = case.sheet, case.options.cells_per_period
    return Barrier(case.mesh_shape, sheet.thickness, sheet.contact_pressure, cell, refinement)
