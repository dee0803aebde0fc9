"""Sample size: how many unit cells fit on a given number of needles (paper, "Kinematics")."""

from knitlab.fabric.stripe import GARTER_STITCHES_PER_RIB_STITCH
from knitlab.sweep.workflow import DesignSection


def sample_size(section: DesignSection, stitches: tuple[int, int]) -> tuple[int, int]:
    """Repeats of a pattern in a sample along (y, x), which are unit cells for the paper's pattern.

    With ``needles``, a sample has as many whole repeats as fit on them, at least one. Its length is
    ``aspect`` times its width; two courses count as long as a wale is wide.

    Args:
        section: the workflow's section.
        stitches: courses and wales of the pattern.

    Returns:
        Repeats along (y, x).
    """
    if section.needles is None:
        return section.unit_cells or (1, 1)
    courses, wales = stitches
    along_x = max(1, int(section.needles * section.scale // wales))
    length = section.aspect * along_x * wales
    return max(1, round(length * GARTER_STITCHES_PER_RIB_STITCH / courses)), along_x
