"""The schema: every variable and coordinate of a case and of a cube. Imports no JAX.

Variables are declared beside the functions that compute them, in the modules listed here; to add an
observable is to write such a module and to import it here.
"""

from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np

from knitlab.observables.capacitance.sensor import CapacitorStatus
from knitlab.observables.observable import REGISTRY, Variable
from knitlab.observables.status import Status

# isort: off
# Every module of observables, in the order in which cubes and the reference list their variables.
from knitlab.observables import convergence as convergence
from knitlab.observables import of_cubes as of_cubes
from knitlab.observables import strains as strains
from knitlab.observables import poisson_ratio as poisson_ratio
from knitlab.observables import forces as forces
from knitlab.observables import energies as energies
from knitlab.observables import shapes as shapes
from knitlab.observables import relaxed_patches as relaxed_patches
from knitlab.observables import sensitivity_curves as sensitivity_curves
from knitlab.observables import capacitors as capacitors
from knitlab.observables import spread as spread
from knitlab.observables import motion_history as motion_history
# isort: on

if TYPE_CHECKING:
    import xarray as xr

VARIABLES = REGISTRY.variables  # every variable, by name
FLAGS: dict[str, type[IntEnum]] = {"status": Status, "capacitor_status": CapacitorStatus}
"""Variables whose values are flags, and their flags."""
INTEGERS = tuple(name for name, variable in VARIABLES.items() if variable.integer)
"""Variables that are stored as integers."""
MISSING = -1  # value of a missing integer
DESIGN_DIMS = ("n_stripe", "n_subunit")  # dimensions of a cube of checkerboards
STRIPE_DIMS = ("knit", "n", "boundary")
STRAIN = "applied_strain"  # dimension of curves
LOAD_RATIO = "load_ratio"  # dimension of biaxial tests
CYCLE = "cycle"  # dimension of an experiment with several cycles
SAMPLE = "sample"  # dimension of settings that a workflow changes together
SOURCE = "source"  # coordinate that states the source of a cube
SIMULATION = "simulation"  # source of a simulated cube; that of an experiment is its name

COORDINATES = {
    "n_stripe": Variable(("n_stripe",), "stitches across a rib stripe"),
    "n_subunit": Variable(("n_subunit",), "stitches along a garter stripe"),
    "knit": Variable(("knit",), "knit of a pure stripe"),
    "n": Variable(("n",), "stitches across a stripe"),
    "boundary": Variable(("boundary",), "clamped sample, or periodic fabric"),
    "source": Variable((), "simulation, or the name of an experiment"),
    "cycle": Variable(("cycle",), "cycle of a tensile test"),
    "applied_strain": Variable(
        ("applied_strain",),
        "applied strain",
        description="displacement of the driven end over the relaxed length",
    ),
    "cell_y": Variable(("cell_y",), "unit cell along the warp"),
    "cell_x": Variable(("cell_x",), "unit cell along the weft"),
    "stripe_parameter": Variable(
        ("stripe_parameter",),
        "parameter of the rib or of the garter stripe",
        description="rib_period is the paper's w, garter_period its h; k_s of springs, k_t,"
        " theta_0 of folds",
    ),
    "boundary_point": Variable(
        ("boundary_point",), "position along a boundary, over its length from end to end"
    ),
    "node_y": Variable(("node_y",), "node row along the warp"),
    "node_x": Variable(("node_x",), "node column along the weft"),
    "component": Variable(("component",), "component of a position"),
    "candidate": Variable(("candidate",), "candidate of a design"),
    "time": Variable(("time",), "time since the flat sheet was released", "ms"),
    "snapshot": Variable(("snapshot",), "time since the flat sheet was released", "ms"),
}


def described(dataset: "xr.Dataset") -> "xr.Dataset":
    """The dataset with the CF attributes of every variable and coordinate of the schema."""
    for name, variable in (COORDINATES | VARIABLES).items():
        if name in dataset.variables:
            dataset.variables[name].attrs |= variable.attributes
    for name, meanings in FLAGS.items():
        if name in dataset.variables:
            dataset.variables[name].attrs |= {
                # Of the type in which the variable is stored, as CF has it.
                "flag_values": np.array([*meanings], np.int32 if name in INTEGERS else np.int8),
                "flag_meanings": " ".join(flag.name for flag in meanings),
            }
    return dataset


SMALL = 4096  # bytes of an array up to which HDF5's index of a compressed one is larger


def encoding(dataset: "xr.Dataset", compressed: bool = True) -> dict[str, dict[str, object]]:
    """NetCDF encoding of a case or cube: integers stored as such, large arrays compressed."""
    chosen: dict[str, dict[str, object]] = {str(name): {} for name in dataset.data_vars}
    for name, settings in chosen.items():
        if compressed and dataset[name].nbytes > SMALL and dataset[name].dtype.kind in "fi":
            settings |= {"zlib": True, "complevel": 4}
        if blocks := dataset[name].chunks:
            settings["chunksizes"] = tuple(lengths[0] for lengths in blocks)
        if name in INTEGERS:
            settings |= {"dtype": "int32", "_FillValue": MISSING}
    return chosen | {str(name): {"_FillValue": None} for name in dataset.indexes}
