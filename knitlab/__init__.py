"""knitlab simulates folding knits and finds the one an engineer needs.

Results are netCDF cubes: :func:`open_cube` reads one.
"""

from importlib.metadata import version

from knitlab.maps.accessor import KnitlabAccessor
from knitlab.sweep.cube_file import open_cube

__version__ = version("knitlab")
__all__ = ["KnitlabAccessor", "__version__", "open_cube"]
