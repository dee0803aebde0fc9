"""Sample size: how many unit cells fit on a given number of needles (paper, "Kinematics")."""

from collections.abc import Sequence

from knitlab.study.workflow import DesignSection


def sample_size(section: DesignSection, n_subunit: int) -> tuple[int, int]:
    """Unit cells of a sample along (y, x).

    Given needles, it is as wide as a whole number of unit cells can be on them, at least one: a
    patch takes n_subunit needles. It is ``aspect`` times as long as wide, counted in unit cells,
    which are about square, as a stitch is about twice as wide as high and a patch has twice as
    many courses as wales.

    Args:
        section: the workflow's section.
        n_subunit: stitches along a garter stripe.

    Returns:
        Unit cells along (y, x).
    """
    if section.needles is None:
        return section.unit_cells or (1, 1)
    patches_y, patches_x = _extent(section.pattern)
    cells_x = max(1, int(section.needles * section.scale // (patches_x * n_subunit)))
    return max(1, round(section.aspect * cells_x * patches_x / patches_y)), cells_x


def _extent(pattern: Sequence[str]) -> tuple[int, int]:
    return len(pattern), len(pattern[0])
