"""Rows of patches: how each kind of them stretches and widens, and which follow each other.

Under a pull along the wales all rows of a piece bear one force, so that the stiff ones stretch and
widen less. A piece that is to widen more in one place than in another is made of several kinds of
rows: of garter stripes of other sizes, of other heights, or of plain knit.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from knitlab.model.stripe import Stripe

BISECTIONS = 60
MAX_ROWS = 10_000

Along = Float[np.ndarray, " place"]


@dataclass(frozen=True, eq=False)
class Row:
    """A kind of row of patches, as endless fabric of it behaves.

    Attributes:
        label: the design in words.
        stripe: its garter stripe.
        periods: its height, in periods of that.
        is_plain: whether all of its patches are plain knit.
        cell: width and height of a grid cell of the relaxed fabric [mm].
        strain: applied strains along the wales, ascending from 0 [1].
        force: force over relaxed width at these [N/mm].
        widening: strain along the courses at these [1].
    """

    label: str
    stripe: Stripe
    periods: int
    is_plain: bool
    cell: tuple[float, float]
    strain: Along
    force: Along
    widening: Along

    def __repr__(self) -> str:
        return f"<Row {self.label}>"

    def stretched(self, strain: float) -> "Row":
        """The same kind with the size of its cells at a strain along the wales."""
        width, height = self.cell
        wider = 1 + float(np.interp(strain, self.strain, self.widening))
        return replace(self, cell=(width * wider, height * (1 + strain)))

    def under(self, force: float) -> tuple[float, float]:
        """Strain along and across under a force over the width; that at the ends beyond [1]."""
        rising = np.maximum.accumulate(self.force)
        strain = float(np.interp(force, rising, self.strain))
        return strain, float(np.interp(strain, self.strain, self.widening))


@dataclass(frozen=True, eq=False)
class WantedWidening:
    """How a piece is to widen when it is stretched.

    Attributes:
        stretch: applied strain along the wales.
        place: places along the relaxed piece, from 0 at its lower end to 1.
        widening: wanted strain along the courses at these [1].
    """

    stretch: float
    place: Along
    widening: Along

    def at(self, place: Along) -> Along:
        """The wanted widening at other places."""
        return np.interp(place, self.place, self.widening)


def chosen_rows(
    kinds: Sequence[Row],
    cells_per_period: int,
    length: float,
    width: Callable[[float], float],
    wanted: WantedWidening,
) -> list[Row]:
    """The rows of a piece from below, each the kind that widens nearest to what is wanted there.

    The force is that under which the piece of a relaxed ``length`` has the wanted stretch; it acts
    on the relaxed ``width`` at each height [mm].
    """

    def under(force: float) -> tuple[list[Row], float]:
        rows, height, extension = list[Row](), 0.0, 0.0
        while height < length and len(rows) < MAX_ROWS:
            heights = [row.periods * cells_per_period * row.cell[1] for row in kinds]
            middles = [min(height + own / 2, length) for own in heights]
            strains = [row.under(force / width(at)) for row, at in zip(kinds, middles, strict=True)]
            errors = [
                abs(widening - wanted.at(np.array([at / length]))[0])
                for (_, widening), at in zip(strains, middles, strict=True)
            ]
            best = int(np.argmin(errors))
            # The last row is left out if more than half of it would be beyond the end.
            if rows and middles[best] >= length:
                break
            rows.append(kinds[best])
            height += heights[best]
            extension += heights[best] * strains[best][0]
        return rows, extension / height

    high = max(float(row.force.max()) for row in kinds) * width(length / 2)
    low = 0.0
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        _, strain = under(middle)
        low, high = (middle, high) if strain < wanted.stretch else (low, middle)
    rows, _ = under(high)
    return rows
