"""knitlab simulates folding knits and finds the one an engineer needs.

All that it offers is listed in ``dir(knitlab)``: designs, simulations and sweeps give xarray
datasets, which ``cube.knitlab.query`` and ``knitlab.plot`` turn into tables and figures.

Example:
    >>> import knitlab as kl
    >>> cube = kl.open_cube("results/reference/periodic")
    >>> len(cube.knitlab.query("poisson_ratio_min < -0.8"))
    5
"""

import sys
from importlib.metadata import version
from pathlib import Path
from types import ModuleType

import lazy_loader

_program = Path((sys.argv or [""])[0]).stem
if _program not in ("knitlab", "-m"):  # the help of the command needs no pandas
    import knitlab.cubes.query  # noqa: F401, registers cube.knitlab

# Names are stated in __init__.pyi, and imported when first used: a query needs no JAX.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__version__ = version("knitlab")


class _Public(ModuleType):
    """This module: the package ``knitlab.design``, say, does not hide the function of its name."""

    def __setattr__(self, name: str, value: object) -> None:
        if name in ("claims", "design", "export") and isinstance(value, ModuleType):
            return
        super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Public
