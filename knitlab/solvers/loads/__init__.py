"""Loads: how a fabric is strained. Each is one file; :data:`LOADS` lists them by name.

A load says what is held and what is driven, which force is conjugate to the applied strain, in
which direction it pulls, and what it cannot be combined with. ``load.py`` has what loads share,
``loading.py`` the test of one relaxed shape under a load.
"""

from knitlab.solvers.loads.biaxial import Biaxial
from knitlab.solvers.loads.biaxial_weft import BiaxialWeft
from knitlab.solvers.loads.load import Load
from knitlab.solvers.loads.off_axis import OffAxis
from knitlab.solvers.loads.shear import Shear
from knitlab.solvers.loads.warp import Warp
from knitlab.solvers.loads.weft import Weft

LOADS: dict[str, type[Load]] = {
    load.kind: load for load in (Warp, Weft, Biaxial, BiaxialWeft, Shear, OffAxis)
}
"""Every load, by the name that workflows and cubes give it."""
WARP = Warp()
"""The paper's load."""


def load_of(record: Load | dict[str, object]) -> Load:
    """The load of a record, which names its kind; a load is returned as it is."""
    if isinstance(record, Load):
        return record
    return LOADS[str(record.get("kind", WARP.kind))](**record)  # type: ignore[arg-type]
