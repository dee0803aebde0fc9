"""Names and formats of the figures that a workflow can name. Imports no library."""

from pathlib import Path

from knitlab.io.names import check_suffix

FIGURE_NAMES = (
    *("auxetic", "capacitors", "contact", "curves", "cycles", "directions", "electrodes", "force"),
    *("grid", "options", "polar", "relaxation", "samples", "sensitivity", "sensor", "shape"),
    *("stripes", "swept", "tension", "uncertainty", "wavelength"),
)
"""Names of the figures in the modules of :mod:`knitlab.figures.kinds`, not imported here."""
COMPARING = ("contact", "cycles", "directions", "grid", "options", "swept")
"""Figures that accept a cube with several values of its swept settings."""
FIGURE_SUFFIXES = (".pdf", ".svg", ".png")


def check_figure_suffix(output: str | Path | None) -> None:
    """InputError unless the suffix of a file, if one is asked for, is a format of a figure."""
    if output is not None:
        check_suffix(Path(output), FIGURE_SUFFIXES, "a figure")
