"""Names and formats of the figures that a workflow can name. Imports no library."""

from pathlib import Path
from pkgutil import iter_modules

from knitlab.io.names import check_suffix
from knitlab.io.shipped import PACKAGE

FIGURE_NAMES = tuple(module.name for module in iter_modules([str(PACKAGE / "figures" / "kinds")]))
"""The files of :mod:`knitlab.figures.kinds`, in alphabetical order, which are not imported here."""
FIGURE_SUFFIXES = (".pdf", ".svg", ".png")


def check_figure_suffix(output: str | Path | None) -> None:
    """InputError unless the suffix of a file, if one is asked for, is a format of a figure."""
    if output is not None:
        check_suffix(Path(output), FIGURE_SUFFIXES, "a figure")
