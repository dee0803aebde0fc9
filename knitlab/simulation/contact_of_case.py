"""Contact of a case with itself, as its model options ask for it."""

from importlib.util import find_spec
from typing import TYPE_CHECKING

import numpy as np

from knitlab.fabric.fabric import Fabric
from knitlab.io.errors import fault
from knitlab.simulation.case import Case

if TYPE_CHECKING:
    from knitlab.fabric.barrier import Barrier


def contact_of(case: Case, fabric: Fabric) -> "Barrier | None":
    """The contact of a case; ``None`` if its fabric may pass through itself.

    Args:
        case: the case.
        fabric: its fabric.

    Raises:
        BadInput: if the library of the contact is not installed.
    """
    if case.options.contact == "none":
        return None
    if find_spec("ipctk") is None:
        raise fault("contact = barrier", "needs the package ipctk; pip install 'knitlab[contact]'")
    from knitlab.fabric.barrier import Barrier

    return Barrier(
        case.mesh_shape,
        case.sheet.thickness,
        case.sheet.contact_pressure,
        (float(np.mean(fabric.cell_x)), float(np.mean(fabric.cell_y))),
        case.options.cells_per_period,
    )
