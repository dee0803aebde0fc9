"""Names and formats of the figures that a workflow can ask for. Needs no library."""

from pathlib import Path
from typing import Literal

from knitlab.io.errors import fault

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


def check_still(output: Path) -> None:
    """Refuse a file whose suffix is no format of a still figure.

    Raises:
        BadInput: if so.
    """
    if output.suffix.lower() not in STILL:
        raise fault(f"output {output}", f"has no suffix of a figure; give {', '.join(STILL)}")
