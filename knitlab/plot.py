"""Figures of cubes and tests: one function for each, which returns a matplotlib figure.

Save a figure with ``figure.savefig("map.png")``. Keyword arguments select along the coordinates of
a cube: ``plot.shape(cube, n_stripe=4, n_subunit=16, applied_strain=0.15)``. A figure that shows a
shape takes it from a test, or from the case files beside the file that the cube was opened from.

All of them raise :class:`knitlab.InputError` if a cube does not hold what they show, or a selection
is at fault.

Example:
    >>> import knitlab as kl
    >>> cube = kl.open_cube("results/reference/periodic")
    >>> kl.plot.auxetic(cube).savefig(folder / "auxetic.png")
"""

import inspect
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from matplotlib.figure import Figure

from knitlab.api.cubes import Cube, opened
from knitlab.figures.drawing import FIGURES, draw

__all__ = list(FIGURES)


def _plot_function(name: str) -> Callable[..., Figure]:
    """The public function of a figure."""
    kind = FIGURES[name]

    def plot(*cubes: Cube, **keywords: Any) -> Figure:
        options = {key: keywords.pop(key) for key in kind.options if key in keywords}
        return draw(name, [opened(cube) for cube in cubes], keywords, options)

    what = f"; and {', '.join(kind.options)}: names of dimensions and of a variable"
    what = what if kind.options else ""
    summary, *_ = (inspect.getdoc(kind.draw) or "").split("\n\n")
    plot.__name__ = plot.__qualname__ = name
    plot.__doc__ = f"""{summary}

Args:
    cubes: {kind.takes}; or paths of these.
    keywords: a value or a list of values for each coordinate{what}.
"""
    return plot


globals().update({name: _plot_function(name) for name in FIGURES})

if TYPE_CHECKING:

    def __getattr__(name: str) -> Callable[..., Any]: ...
