"""Names and formats of the figures that a workflow can ask for. Needs no library."""

from typing import Literal

FigureName = Literal[
    "auxetic",
    "curves",
    "shape",
    "shapes",
    "network",
    "tension",
    "samples",
    "wavelength",
    "sensitivity",
    "sensor",
    "capacitors",
    "electrodes",
    "wedge",
    "readings",
    "relaxation",
    "folding",
    "stripes",
    "departure",
]
COMPARING = ("readings",)
"""Those that show all values of swept settings side by side."""
STILL = (".pdf", ".svg", ".png")
MOVING = (".gif",)


def suffixes(kind: str) -> tuple[str, ...]:
    """Formats that a kind of figure can be written in."""
    return MOVING if kind == "folding" else STILL
