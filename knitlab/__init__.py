"""knitlab simulates folding knits and finds the one an engineer needs.

All that it offers is listed in ``dir(knitlab)``: designs, simulations and sweeps give xarray
datasets, which ``cube.knitlab.query`` and ``knitlab.plot`` turn into tables and figures.

Example:
    >>> import knitlab as kl
    >>> cube = kl.open_cube("results/reference/periodic")
    >>> len(cube.knitlab.query("poisson_ratio_min < -0.6"))
    4
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

import knitlab.cube.query  # noqa: F401, registers cube.knitlab

if TYPE_CHECKING:
    from knitlab import plot
    from knitlab.api.cubes import claims, compare, explore, export, find, query
    from knitlab.api.design import design
    from knitlab.api.knitting import knit
    from knitlab.api.laboratory import calibrate, fit, import_records
    from knitlab.api.simulation import Design, NotConverged, evaluate, simulate
    from knitlab.api.sweeps import NotAllOk, merge, plan, reproduce, run, status
    from knitlab.cube.cube_file import open_cube
    from knitlab.dynamics.settings import DynamicsSettings
    from knitlab.equilibrium.settings import SolverSettings
    from knitlab.fabric.electrodes import ElectrodeLayout
    from knitlab.fabric.settings import PlainKnit, Sheet
    from knitlab.fabric.stripe import Stripe
    from knitlab.io.errors import BadInput
    from knitlab.laboratory.tension_record import read_tension_record
    from knitlab.measure.capacitance.capacitor import Capacitor
    from knitlab.measure.knit_size import Gauge
    from knitlab.sweep.material import Material
    from knitlab.sweep.parameters import Model, defaults
    from knitlab.sweep.patterns import Pattern
    from knitlab.sweep.workflow import Protocol

    __version__: str

__all__ = [
    "BadInput", "Capacitor", "Design", "DynamicsSettings", "ElectrodeLayout", "Gauge", "Material",
    "Model", "NotAllOk", "NotConverged", "Pattern", "PlainKnit", "Protocol", "Sheet",
    "SolverSettings", "Stripe", "__version__", "calibrate", "claims", "compare", "defaults",
    "design", "evaluate", "explore", "export", "find", "fit", "import_records", "knit", "merge",
    "open_cube", "plan", "plot", "query", "read_tension_record",
    "reproduce", "run", "simulate", "status",
]  # fmt: skip
_NAMES_OF_MODULES = {
    "api.cubes": ("claims", "compare", "explore", "export", "find", "query"),
    "api.design": ("design",),
    "api.knitting": ("knit",),
    "api.laboratory": ("calibrate", "fit", "import_records"),
    "api.simulation": ("Design", "NotConverged", "evaluate", "simulate"),
    "api.sweeps": ("NotAllOk", "merge", "plan", "reproduce", "run", "status"),
    "cube.cube_file": ("open_cube",),
    "dynamics.settings": ("DynamicsSettings",),
    "equilibrium.settings": ("SolverSettings",),
    "fabric.electrodes": ("ElectrodeLayout",),
    "fabric.settings": ("PlainKnit", "Sheet"),
    "fabric.stripe": ("Stripe",),
    "io.errors": ("BadInput",),
    "laboratory.tension_record": ("read_tension_record",),
    "measure.capacitance.capacitor": ("Capacitor",),
    "measure.knit_size": ("Gauge",),
    "sweep.material": ("Material",),
    "sweep.parameters": ("Model", "defaults"),
    "sweep.patterns": ("Pattern",),
    "sweep.workflow": ("Protocol",),
}
"""Names by their modules, which are imported when a name is first used: a query needs no JAX."""


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return import_module("importlib.metadata").version("knitlab")
    if name == "plot":
        return import_module("knitlab.plot")
    for module, names in _NAMES_OF_MODULES.items():
        if name in names:
            return getattr(import_module(f"knitlab.{module}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
