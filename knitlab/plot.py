"""Figures of cubes and tests: one function for each, which returns a matplotlib figure.

Save a figure with ``figure.savefig("map.png")``. Keyword arguments select along the coordinates of
a cube: ``plot.shape(cube, n_stripe=4, n_subunit=16, applied_strain=0.15)``. A figure that shows a
shape takes it from a test, or from the case files beside the file that the cube was opened from.

All of them raise :class:`knitlab.InputError` if a cube does not hold what they show, or a selection
is invalid.

Example:
    >>> import knitlab as kl
    >>> cube = kl.open_cube("results/reference/periodic")
    >>> kl.plot.auxetic(cube).savefig(folder / "auxetic.png")
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from knitlab.runs.figure_names import FIGURE_NAMES

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from knitlab.api.cubes import Cube

__all__ = [*FIGURE_NAMES]


def __getattr__(name: str) -> "Callable[..., Figure]":
    """The public function of a figure; it imports the file of that figure alone."""
    if name not in FIGURE_NAMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from knitlab.api.cubes import as_cube
    from knitlab.figures.drawing import draw
    from knitlab.figures.registry import figure_kind

    kind = figure_kind(name)

    def plot(*cubes: "Cube", **keywords: Any) -> "Figure":
        options = {key: keywords.pop(key) for key in kind.options if key in keywords}
        return draw(name, [as_cube(cube) for cube in cubes], keywords, options)

    named = f"; and {', '.join(kind.options)}: names of dimensions and of a variable"
    plot.__name__ = plot.__qualname__ = name
    plot.__doc__ = f"""{kind.summary}

Args:
    cubes: {kind.takes}; or paths of these.
    keywords: a value or a list of values for each coordinate{named if kind.options else ""}.
"""
    globals()[name] = plot
    return plot


def __dir__() -> list[str]:
    return __all__
