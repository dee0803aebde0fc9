"""Which known design comes closest to a wish."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from knitlab.io.errors import BadInput, ErrorCollector
from knitlab.io.plain_cube import PlainCube, open_plain_cube
from knitlab.tables.find import Found, find_designs
from knitlab.tables.target import Target, read_target

if TYPE_CHECKING:
    from knitlab.api.comparison import Cube


Wanted = str | Mapping[str, Any] | Target
"""A target as text, as a table of a curve, or as it is."""


def find(
    *cubes: "Cube",
    targets: Wanted | Sequence[Wanted],
    subject_to: Wanted | Sequence[Wanted] = (),
    most: int | None = None,
) -> Found:
    """Find the designs that come closest to wanted values; nothing is simulated.

    A target is a variable, a relation and a number: ``"knit_cell_x < 20"``. A variable along the
    applied strain needs the strain or the window that it is wanted at, and is read there by
    linear interpolation: ``"poisson_ratio = -0.3 @ 0.05:0.25"`` is wanted at every strain of the
    window, ``"mean(poisson_ratio) = -0.3 @ 0.05:0.25"`` on average. Reductions are ``mean``,
    ``min``, ``max``, ``slope`` and ``spread`` (largest less smallest). ``± 0.02`` gives the
    distance that counts as one; without it that is the scatter among the designs.

    Args:
        cubes: cubes of designs along the same dimensions, or their paths.
        targets: what is wanted. A curve is ``"poisson_ratio = wanted.csv"``, with the columns
            ``strain`` and ``poisson_ratio``, or ``{"name": "poisson_ratio", "applied_strain": […],
            "value": […], "tolerance": 0.02}``.
        subject_to: targets that must be met; designs that do not are left out.
        most: how many designs are kept, all by default.

    Returns:
        The designs by their distance, the nearest first. ``table`` holds for the first target
        ``value_1``, ``off_by_1`` in the variable's unit, and ``in_spread_1``: whether the spread
        over a design's siblings covers the target; likewise for the others.

    Raises:
        BadInput: with every target that cannot be read or is of no variable of the cubes.

    Example:
        >>> import knitlab as kl
        >>> found = kl.find(
        ...     "results/reference/preview",
        ...     targets=["poisson_ratio = -0.3 @ 0.05:0.25", "reaction_force < 2 @ 0.2"],
        ...     subject_to="knit_cell_x < 20",
        ... )
        >>> found.table[["n_stripe", "n_subunit"]].iloc[0].tolist()
        [4, 16]
    """
    wanted, required = read_targets(targets, "target"), read_targets(subject_to, "subject_to")
    # A file is read without xarray, whose import takes longer than the search.
    plain = [
        open_plain_cube(cube) if isinstance(cube, str | Path) else PlainCube.of(cube)
        for cube in cubes
    ]
    return find_designs(plain, wanted, required, most)


def listed(given: Wanted | Sequence[Wanted]) -> list[Wanted]:
    """One or several targets as a list."""
    return [given] if isinstance(given, str | Mapping | Target) else list(given)


def read_targets(given: Wanted | Sequence[Wanted], source: str) -> list[Target]:
    """Targets, each from its text or table.

    Args:
        given: one or several.
        source: the argument that they were given by, for a fault.

    Raises:
        BadInput: with every one that cannot be read.
    """
    faults = ErrorCollector()
    found: list[Target] = []
    for one in listed(given):
        with faults:
            found.append(read_target(one, source))
    if faults.all:
        raise BadInput(faults.all)
    return found
