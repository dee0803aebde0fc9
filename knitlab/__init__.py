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

from knitlab.xarray_accessor import register_accessor

if TYPE_CHECKING:
    from knitlab import plot
    from knitlab.api.calibration import calibrate
    from knitlab.api.claims import claims
    from knitlab.api.comparison import compare, query
    from knitlab.api.design import Design
    from knitlab.api.designing import design
    from knitlab.api.explorer import explore
    from knitlab.api.exporting import export
    from knitlab.api.finding import find
    from knitlab.api.knitting import knit
    from knitlab.api.laboratory import fit, import_records
    from knitlab.api.measures import evaluate
    from knitlab.api.simulation import NotConverged, simulate
    from knitlab.api.sweeps import NotAllOk, merge, plan, reproduce, run, status
    from knitlab.cube.cube_file import open_cube
    from knitlab.dynamics.settings import DynamicsSettings
    from knitlab.equilibrium.settings import SolverSettings
    from knitlab.fabric.electrodes import ElectrodeLayout
    from knitlab.fabric.settings import PlainKnit, Sheet
    from knitlab.fabric.stripe import Stripe
    from knitlab.io.errors import BadInput
    from knitlab.measure.capacitance.capacitor import Capacitor
    from knitlab.measure.knit_size import Gauge
    from knitlab.sweep.parameters import Model, defaults
    from knitlab.sweep.patterns import Pattern

    __version__: str

register_accessor()

__all__ = [
    "BadInput",
    "Capacitor",
    "Design",
    "DynamicsSettings",
    "ElectrodeLayout",
    "Gauge",
    "Model",
    "NotAllOk",
    "NotConverged",
    "Pattern",
    "PlainKnit",
    "Sheet",
    "SolverSettings",
    "Stripe",
    "__version__",
    "calibrate",
    "claims",
    "compare",
    "defaults",
    "design",
    "evaluate",
    "explore",
    "export",
    "find",
    "fit",
    "import_records",
    "knit",
    "merge",
    "open_cube",
    "plan",
    "plot",
    "query",
    "reproduce",
    "run",
    "simulate",
    "status",
]
_MODULES = {
    "BadInput": "knitlab.io.errors",
    "Capacitor": "knitlab.measure.capacitance.capacitor",
    "Design": "knitlab.api.design",
    "DynamicsSettings": "knitlab.dynamics.settings",
    "ElectrodeLayout": "knitlab.fabric.electrode_layout",
    "Gauge": "knitlab.measure.knit_size",
    "Model": "knitlab.sweep.parameters",
    "NotAllOk": "knitlab.api.sweeps",
    "NotConverged": "knitlab.api.simulation",
    "Pattern": "knitlab.sweep.patterns",
    "PlainKnit": "knitlab.fabric.plain",
    "Sheet": "knitlab.fabric.fabric",
    "SolverSettings": "knitlab.equilibrium.settings",
    "Stripe": "knitlab.fabric.stripe",
    "calibrate": "knitlab.api.calibration",
    "claims": "knitlab.api.claims",
    "compare": "knitlab.api.comparison",
    "defaults": "knitlab.sweep.parameters",
    "design": "knitlab.api.designing",
    "evaluate": "knitlab.api.measures",
    "explore": "knitlab.api.explorer",
    "export": "knitlab.api.exporting",
    "find": "knitlab.api.finding",
    "fit": "knitlab.api.laboratory",
    "import_records": "knitlab.api.laboratory",
    "knit": "knitlab.api.knitting",
    "merge": "knitlab.api.sweeps",
    "open_cube": "knitlab.cube.cube_file",
    "plan": "knitlab.api.sweeps",
    "query": "knitlab.api.comparison",
    "reproduce": "knitlab.api.sweeps",
    "run": "knitlab.api.sweeps",
    "simulate": "knitlab.api.simulation",
    "status": "knitlab.api.sweeps",
}
"""Where each name is defined; it is imported when it is first used, for a query needs no JAX."""


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return import_module("importlib.metadata").version("knitlab")
    if name == "plot":
        return import_module("knitlab.plot")
    if name in _MODULES:
        return getattr(import_module(_MODULES[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
