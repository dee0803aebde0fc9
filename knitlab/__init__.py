"""knitlab simulates folding knits and finds the one an engineer needs.

Results are netCDF cubes: ``knitlab.open_cube`` reads one as an xarray Dataset, on which
``cube.knitlab`` has the verbs of the command line.
"""

from importlib.metadata import version
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from knitlab.query.accessor import open_cube

__version__ = version("knitlab")
__all__ = ["__version__", "open_cube"]


def __getattr__(name: str) -> Any:
    # Only who opens a cube in Python waits for xarray.
    if name == "open_cube":
        from knitlab.query.accessor import open_cube

        return open_cube
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
