"""The registry of figures: each is a function in the file of ``kinds`` that has its name."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from inspect import getdoc
from typing import TYPE_CHECKING, Any, Literal, TypeVar

from knitlab.io.errors import invalid, unknown
from knitlab.observables.schema import DESIGN_DIMS
from knitlab.runs.figure_names import FIGURE_NAMES

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class FigureKind:
    """A function that draws a cube, or a case if ``needs`` names a variable, and its inputs."""

    draw: "Callable[..., Figure]"
    dims: tuple[str, ...] | None = DESIGN_DIMS  # of the cubes that it can show; None for any
    needs: str | None = None  # variable that the case must have
    designs: tuple[tuple[int, int], ...] = ()  # shown side by side; if all are missing, others
    coordinates: tuple[str, ...] = ()  # further ones that it can be sliced along
    options: tuple[str, ...] = ()  # keyword arguments that select what it shows
    several: Literal["any", "experiments"] | None = None  # cubes: any, or beside one simulation
    compares: bool = False  # whether it shows several values of swept settings

    @property
    def takes(self) -> str:
        """What it takes, for the documentation."""
        if self.several == "any":
            return "any number of cubes"
        if self.several:
            return "one simulated cube or test, and any experiments"
        if self.designs:
            return "a cube with its case files"
        return "a test, or a cube with its case files" if self.needs else "a cube or a test"

    @property
    def summary(self) -> str:
        """The first paragraph of the function's docstring."""
        return (getdoc(self.draw) or "").split("\n\n")[0]


Draw = TypeVar("Draw", bound="Callable[..., Figure]")
_KINDS: dict[str, FigureKind] = {}


def figure(**declared: Any) -> Callable[[Draw], Draw]:
    """Declare a function as the figure of its name, by fields of :class:`FigureKind`."""

    def declare(draw: Draw) -> Draw:
        _KINDS[draw.__name__] = FigureKind(draw, **declared)
        return draw

    return declare


def figure_kind(name: str) -> FigureKind:
    """The figure with a name; only its own file, and matplotlib with it, is imported."""
    if name not in FIGURE_NAMES:
        raise invalid("kind", unknown(name, FIGURE_NAMES, "figure"))
    import_module(f"knitlab.figures.kinds.{name}")
    return _KINDS[name]


def figure_kinds() -> dict[str, FigureKind]:
    """Every figure, by its name."""
    return {name: figure_kind(name) for name in FIGURE_NAMES}
