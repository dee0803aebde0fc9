"""Plain knit (stockinette): flat at rest, with its own stiffness."""

from dataclasses import dataclass
from typing import Annotated

from pydantic import PositiveFloat

from knitlab.fabric.setting_types import Unit


@dataclass(frozen=True)
class PlainKnit:
    """Stiffness of plain knit as a continuous sheet, which does not depend on the grid.

    A spring along the weft of a cell a × b has k_s = ``plain_stretch_weft`` · b / a, and a hinge
    between two cells along the weft has k_t = ``plain_bend_weft`` · b / a; the same
    holds along the warp. Diagonals have the smaller k_s, as in all patches.

    Attributes:
        plain_stretch_weft: force along the weft per unit of width and strain, without diagonals
            [N/mm].
        plain_stretch_warp: the same along the warp [N/mm].
        plain_bend_weft: moment per unit of width and curvature along the weft [N mm].
        plain_bend_warp: the same along the warp [N mm].
    """

    plain_stretch_weft: Annotated[PositiveFloat, Unit("N/mm")]
    plain_stretch_warp: Annotated[PositiveFloat, Unit("N/mm")]
    plain_bend_weft: Annotated[PositiveFloat, Unit("N mm")]
    plain_bend_warp: Annotated[PositiveFloat, Unit("N mm")]
