"""Figures of cubes and tests: one function for each, which returns a matplotlib figure.

Save one with ``figure.savefig("map.png")``. Keyword arguments select along the coordinates of a
cube: ``plot.shape(cube, n_stripe=4, n_subunit=16, applied_strain=0.15)``. A figure that shows a
shape takes it from a test, or from the case files beside the file that the cube was opened from.

All of them raise :class:`knitlab.BadInput` if a cube does not hold what they show, or a selection
is at fault.

Example:
    >>> import knitlab as kl
    >>> cube = kl.open_cube("results/reference/preview")
    >>> kl.plot.auxetic(cube).savefig(folder / "auxetic.png")
"""

from typing import Any

from matplotlib.animation import FuncAnimation
from matplotlib.figure import Figure

from knitlab.api.comparison import Cube, opened
from knitlab.figures.drawing import Drawing, draw
from knitlab.tables.selection import selection_texts

__all__ = [
    "auxetic",
    "capacitors",
    "curves",
    "departure",
    "electrodes",
    "folding",
    "network",
    "readings",
    "relaxation",
    "samples",
    "sensitivity",
    "sensor",
    "shape",
    "shapes",
    "stripes",
    "tension",
    "wavelength",
    "wedge",
]


def _figure(kind: str, cubes: tuple[Cube, ...], selections: dict[str, Any]) -> Any:
    drawing: Drawing = draw(kind, [opened(cube) for cube in cubes], selection_texts(selections))
    return drawing


def auxetic(*cubes: Cube, **selections: Any) -> Figure:
    """Design map: lowest Poisson's ratio of every design, and the strain it occurs at.

    Args:
        cubes: one simulated cube, and measured ones of other designs; or their paths.
        selections: a value or a list of values for each coordinate.
    """
    return _figure("auxetic", cubes, selections)


def curves(*cubes: Cube, **selections: Any) -> Figure:
    """ε_xx, ε_yy and ν against applied strain (paper, Fig. "tension plots").

    Args:
        cubes: one simulated cube or test, and experiments beside it; or their paths.
        selections: a value or a list of values for each coordinate.
    """
    return _figure("curves", cubes, selections)


def tension(*cubes: Cube, **selections: Any) -> Figure:
    """Local strain over samples between clamps (paper, Fig. "tension images").

    Args:
        cubes: one simulated cube, and experiments beside it; or their paths.
        selections: a value or a list of values for each coordinate.
    """
    return _figure("tension", cubes, selections)


def sensor(*cubes: Cube, **selections: Any) -> Figure:
    """Sensor design map: sensitivity and working range of every design, and their trade-off.

    Args:
        cubes: one simulated cube, and measured ones of other designs; or their paths.
        selections: a value or a list of values for each coordinate.
    """
    return _figure("sensor", cubes, selections)


def capacitors(*cubes: Cube, **selections: Any) -> Figure:
    """C/C0 against applied strain, and the slopes, side by side (paper, Fig. "capacitor testing").

    Args:
        cubes: cubes with capacitors; or their paths.
        selections: a value or a list of values for each coordinate.
    """
    return _figure("capacitors", cubes, selections)


def wedge(*cubes: Cube, **selections: Any) -> Figure:
    """The fast wedge estimate of a capacitance against boundary elements.

    Args:
        cubes: cubes with capacitors; or their paths.
        selections: a value or a list of values for each coordinate.
    """
    return _figure("wedge", cubes, selections)


def readings(*cubes: Cube, **selections: Any) -> Figure:
    """Which of the paper's claims each set of model options meets, the best set first.

    Args:
        cubes: cubes to judge the claims by; or their paths.
        selections: a value or a list of values for each coordinate.
    """
    return _figure("readings", cubes, selections)


def shape(cube: Cube, **selections: Any) -> Figure:
    """Relief of a fabric seen from the technical face; relaxed, or at ``applied_strain``.

    Args:
        cube: a test of :func:`knitlab.simulate`, or a cube, of which the most auxetic design is
            shown; or its path.
        selections: a value for each coordinate.
    """
    return _figure("shape", (cube,), selections)


def network(cube: Cube, **selections: Any) -> Figure:
    """Springs and folds of a unit cell, on the chart and on the fabric (paper, Fig. 1F).

    Args:
        cube: a test or a cube; or its path.
        selections: a value for each coordinate.
    """
    return _figure("network", (cube,), selections)


def shapes(cube: Cube, **selections: Any) -> Figure:
    """Relaxed shapes of several designs side by side (paper, Fig. "relaxed configurations").

    Args:
        cube: a cube with its case files; or its path.
        selections: a value for each coordinate.
    """
    return _figure("shapes", (cube,), selections)


def samples(cube: Cube, **selections: Any) -> Figure:
    """Samples between clamps, relaxed and stretched (paper, Fig. "tension images").

    Args:
        cube: a cube with its case files; or its path.
        selections: a value for each coordinate.
    """
    return _figure("samples", (cube,), selections)


def wavelength(cube: Cube, **selections: Any) -> Figure:
    """Boundaries, their spectra, and wavelengths against n_subunit (paper, Fig. "wavelength").

    Args:
        cube: a cube; or its path.
        selections: a value for each coordinate.
    """
    return _figure("wavelength", (cube,), selections)


def sensitivity(cube: Cube, **selections: Any) -> Figure:
    """Which stripe parameter the Poisson's ratio of each design depends on.

    Args:
        cube: a cube run with ``sensitivities=True``; or its path.
        selections: a value for each coordinate.
    """
    return _figure("sensitivity", (cube,), selections)


def electrodes(cube: Cube, **selections: Any) -> Figure:
    """Where the electrodes run, on the chart and on the relaxed fabric.

    Args:
        cube: a test or a cube with electrodes; or its path.
        selections: a value for each coordinate.
    """
    return _figure("electrodes", (cube,), selections)


def relaxation(cube: Cube, **selections: Any) -> Figure:
    """Kinetic energy against time, and snapshots (paper, Fig. "unit simulation").

    Args:
        cube: a test or a cube with ``method="dynamics"``; or its path.
        selections: a value for each coordinate.
    """
    return _figure("relaxation", (cube,), selections)


def folding(cube: Cube, **selections: Any) -> FuncAnimation:
    """Film of a fabric that folds itself.

    Args:
        cube: a test or a cube with ``method="dynamics"``; or its path.
        selections: a value for each coordinate.
    """
    return _figure("folding", (cube,), selections)


def stripes(cube: Cube, **selections: Any) -> Figure:
    """Tension curves of pure stripes: zigzag as lines, sheet as points (paper, Fig. 1D, E).

    Args:
        cube: a cube of pure stripes; or its path.
        selections: a value for each coordinate.
    """
    return _figure("stripes", (cube,), selections)


def departure(cube: Cube, **selections: Any) -> Figure:
    """How far the sheet of a pure stripe departs from its zigzag.

    Args:
        cube: a cube of pure stripes; or its path.
        selections: a value for each coordinate.
    """
    return _figure("departure", (cube,), selections)
