"""Cubes, their shapes and their run as one page for a browser."""

from pathlib import Path

from knitlab.api.comparison import Cube, opened
from knitlab.explorer.explorer import write_explorer


def explore(*cubes: Cube, output: str | Path = "explorer.html") -> Path:
    """Write a page on which cubes can be explored in a browser, without a network.

    The page shows a design map, from that the curves of a design with their bands, and its shape,
    which turns and is pulled. Designs can be filtered, pinned and compared; a link restores a
    view. Its other tab is the report of the run: settings, times, failures, versions and figures.

    Shapes come from the case files beside the file of a cube, and figures from its results folder;
    a design without a case file has its curves only. Positions are rounded to 12 bits a component:
    to less than a thousandth of the extent of a shape. Of samples with more than 4096 nodes the
    central unit cells are shown. Other numbers are rounded to 6 digits, and to 0
    below 1e-7 of the largest of their variable.

    Args:
        cubes: cubes, or the results folders that hold them.
        output: the page, with the suffix ``.html``.

    Returns:
        The page.

    Raises:
        BadInput: if there is no cube, one cannot be read, or the suffix is another one.
        CannotWrite: if the page cannot be written.

    Example:
        >>> import knitlab as kl
        >>> page = kl.explore("results/reference/periodic", output=folder / "explorer.html")
        >>> page.name
        'explorer.html'
    """
    return write_explorer([opened(cube) for cube in cubes], Path(output))
