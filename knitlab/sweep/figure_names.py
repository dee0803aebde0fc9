"""Names and formats of the figures that a workflow can name. Imports no library."""

from pathlib import Path

from knitlab.io.errors import fault

FIGURE_NAMES = (
    "auxetic",
    "capacitors",
    "contact",
    "curves",
    "departure",
    "electrodes",
    "folding",
    "grid",
    "options",
    "relaxation",
    "samples",
    "sensitivity",
    "sensor",
    "shape",
    "stripes",
    "swept",
    "tension",
    "wavelength",
)
"""Names of the figures in the modules of :mod:`knitlab.figures.kinds`, not imported here."""
COMPARING = ("contact", "grid", "options", "swept")
"""Figures that accept a cube with several values of its swept settings."""
FILMS = ("folding",)
STILL_SUFFIXES = (".pdf", ".svg", ".png")
FILM_SUFFIXES = (".gif",)


def suffixes(kind: str) -> tuple[str, ...]:
    """Formats that a kind of figure can be written in."""
    return FILM_SUFFIXES if kind in FILMS else STILL_SUFFIXES


def check_still(output: Path) -> None:
    """Check that the suffix of a file is a format of a still figure; else BadInput."""
    if output.suffix.lower() not in STILL_SUFFIXES:
        problem = f"has no suffix of a figure; give {', '.join(STILL_SUFFIXES)}"
        raise fault(f"output {output}", problem)
