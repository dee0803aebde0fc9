"""Names and formats of the figures that a workflow can name. Imports no library."""

from pathlib import Path

from knitlab.io.errors import fault

FIGURE_NAMES = (
    *("auxetic", "capacitors", "contact", "curves", "cycles", "directions", "electrodes", "force"),
    *(
        "grid",
        "options",
        "polar",
        "relaxation",
        "samples",
        "sensitivity",
        "sensor",
        "shape",
        "stripes",
    ),
    *("swept", "tension", "uncertainty", "wavelength"),
)
"""Names of the figures in the modules of :mod:`knitlab.figures.kinds`, not imported here."""
COMPARING = ("contact", "cycles", "directions", "grid", "options", "swept")
"""Figures that accept a cube with several values of its swept settings."""
FIGURE_SUFFIXES = (".pdf", ".svg", ".png")


def check_figure_suffix(output: Path) -> None:
    """Check that the suffix of a file is a format of a figure; else BadInput."""
    if output.suffix.lower() not in FIGURE_SUFFIXES:
        problem = f"has no suffix of a figure; give {', '.join(FIGURE_SUFFIXES)}"
        raise fault(f"output {output}", problem)
