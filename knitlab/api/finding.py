"""Finding the known designs that come closest to targets."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from knitlab.cube.cube_file import open_cube
from knitlab.cube.find import Found, find_designs
from knitlab.cube.target import Target, read_target
from knitlab.io.errors import BadInput, ErrorCollector

if TYPE_CHECKING:
    from knitlab.api.comparison import Cube


Wanted = str | Mapping[str, Any] | Target
"""A target as text, as the table of a curve, or as an object."""


def find(
    *cubes: "Cube",
    targets: Wanted | Sequence[Wanted],
    subject_to: Wanted | Sequence[Wanted] = (),
    most: int | None = None,
) -> Found:
    """Find the designs that come closest to targets; nothing is simulated.

    A target is a variable, a relation and a number: ``"knit_cell_x < 20"``. A variable along the
    applied strain needs a strain or a window, and is interpolated linearly:
    ``"poisson_ratio = -0.3 @ 0.05:0.25"`` applies to every strain of the window,
    ``"mean(poisson_ratio) = -0.3 @ 0.05:0.25"`` to the mean over it. Reductions are ``mean``,
    ``min``, ``max``, ``slope`` and ``spread`` (largest minus smallest). ``± 0.02`` is the
    tolerance, which is the unit of distance; by default it is the scatter among the designs.

    Args:
        cubes: cubes of designs along the same dimensions, or their paths.
        targets: targets. A curve is ``"poisson_ratio = wanted.csv"``, with the columns
            ``strain`` and ``poisson_ratio``, or ``{"name": "poisson_ratio", "applied_strain": […],
            "value": […], "tolerance": 0.02}``.
        subject_to: targets that must be met; designs that do not are left out.
        most: largest number of designs to return, all by default.

    Returns:
        The designs by their distance, the nearest first. For the first target ``table`` has
        ``value_1``, ``off_by_1`` in the unit of the variable, and ``in_spread_1``: whether the
        spread over a design's siblings covers the target; and so on for the others.

    Raises:
        BadInput: with every target that cannot be read or is not of a variable of the cubes.

    Example:
        >>> import knitlab as kl
        >>> found = kl.find(
        ...     "results/reference/periodic",
        ...     targets=["poisson_ratio = -0.3 @ 0.05:0.25", "reaction_force < 2 @ 0.2"],
        ...     subject_to="knit_cell_x < 20",
        ... )
        >>> found.table[["n_stripe", "n_subunit"]].iloc[0].tolist()
        [4, 16]
    """
    wanted, required = read_targets(targets, "target"), read_targets(subject_to, "subject_to")
    opened = [
        open_cube(cube, lazily=True) if isinstance(cube, str | Path) else cube for cube in cubes
    ]
    return find_designs(opened, wanted, required, most)


def listed(given: Wanted | Sequence[Wanted]) -> list[Wanted]:
    """One or several targets as a list."""
    return [given] if isinstance(given, str | Mapping | Target) else list(given)


def read_targets(given: Wanted | Sequence[Wanted], source: str) -> list[Target]:
    """Targets, each from its text or table.

    Args:
        given: one target or several.
        source: name of the argument that gives them, for the message.

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
