"""Tests of claims that every design bears out by itself, and what tests over designs share.

A claim about many designs is judged on those that were measured, by the one that bears it out
least; the finding says how many of how many they are.
"""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
import xarray as xr
from pydantic import Field, PositiveFloat, PositiveInt

from knitlab.io.design_status import Status
from knitlab.io.schema import DESIGN_DIMS, VARIABLES
from knitlab.measure.central import central
from knitlab.paper.finding import Finding, not_measured
from knitlab.paper.margin import above, below, within, worst
from knitlab.paper.threshold import ClaimCheck

Pair = Annotated[tuple[PositiveInt, PositiveInt], Field(strict=False)]
Pairs = Annotated[tuple[Pair, ...], Field(strict=False)]
Numbers = Annotated[tuple[PositiveInt, ...], Field(strict=False)]
Design = tuple[int, int]
MOST_LISTED = 6


def unit_of(name: str) -> str:
    """A variable's unit as it follows a number; nothing for a plain number."""
    unit = VARIABLES[name].units
    return "" if unit == "1" else f" {unit}"


class DesignCheck(ClaimCheck):
    """A test over designs (n_stripe, n_subunit) of a checkerboard.

    Attributes:
        designs: those that it is about; else
        n_stripe: it is about all designs of these n_stripe, or of any, of which the paper has
        at_least: so many; but
        except_for: not about these.
    """

    designs: Pairs | None = None
    n_stripe: Numbers | None = None
    at_least: PositiveInt = 1
    except_for: Pairs = Field(default=(), alias="except")

    def finding(self, cube: xr.Dataset) -> Finding:
        """What the cube says."""
        if cube["status"].dims != DESIGN_DIMS:
            return not_measured("no checkerboards in this cube")
        if missing := sorted(self.variables() - set(map(str, cube.data_vars))):
            return not_measured(f"no {', '.join(missing)} in this cube")
        return self.judge(cube)

    def variables(self) -> set[str]:
        """What of the cube it asks for."""
        return {getattr(self, name) for name in ("of", "than") if hasattr(self, name)}

    @abstractmethod
    def judge(self, cube: xr.Dataset) -> Finding:
        """What a cube says that has the variables."""

    def cells(self, cube: xr.Dataset) -> dict[Design, xr.Dataset | None]:
        """The designs that it is about; ``None`` where one has no complete test."""
        wanted = self.designs or [
            (int(n), int(m))
            for n, m in cube["case_id"]
            .where(cube["case_id"] != "", drop=True)
            .stack(design=DESIGN_DIMS)["design"]
            .values
            if cube["status"].sel(n_stripe=n, n_subunit=m) != Status.excluded
            and (self.n_stripe is None or n in self.n_stripe)
            and (n, m) not in self.except_for
        ]
        return {design: _complete(cube, design) for design in wanted}

    def wanted(self, cells: Mapping[Design, Any]) -> int:
        """How many designs it is about."""
        return len(self.designs) if self.designs else max(self.at_least, len(cells))

    def too_few(self, measured: int, wanted: int) -> Finding:
        """That there are too few designs to say anything."""
        count = f"{measured} of {wanted} designs" if measured else "none of the designs"
        return not_measured(f"{count} measured", wanted)


def _complete(cube: xr.Dataset, design: Design) -> xr.Dataset | None:
    n_stripe, n_subunit = design
    if n_stripe not in cube["n_stripe"] or n_subunit not in cube["n_subunit"]:
        return None
    cell = cube.sel(n_stripe=n_stripe, n_subunit=n_subunit)
    return cell if int(cell["status"]) == Status.ok else None


@dataclass(frozen=True)
class Measured:
    """How far a design bears a claim out, and its figure."""

    margin: float
    figure: str


class EachDesignCheck(DesignCheck):
    """A test that every design bears out by itself."""

    def judge(self, cube: xr.Dataset) -> Finding:
        """What a cube says that has the variables."""
        cells = self.cells(cube)
        measured = {
            design: found
            for design, cell in cells.items()
            if cell is not None and (found := self.measure(cell)) is not None
        }
        if not measured:
            return self.too_few(0, self.wanted(cells))
        failing = {design: its for design, its in measured.items() if its.margin < 0}
        said = f"{len(failing)} of {len(measured)} do not: " if failing else ""
        return Finding(
            worst(its.margin for its in measured.values()),
            said + _listed(failing or measured),
            len(measured),
            self.wanted(cells),
            at=tuple(measured),
        )

    @abstractmethod
    def measure(self, cell: xr.Dataset) -> Measured | None:
        """How far a design bears the claim out, and its figure; ``None`` if it has none."""


def _listed(measured: Mapping[Design, Measured]) -> str:
    """Figures design by design, of which those with the smallest margins are shown."""
    first = sorted(measured, key=lambda design: measured[design].margin)[:MOST_LISTED]
    shown = [f"({n}, {m}) {measured[n, m].figure}" for n, m in measured if (n, m) in first]
    more = len(measured) - len(shown)
    return ", ".join(shown) + (f" and {more} more" if more else "")


def _measured(margin: float | None, figure: str) -> Measured | None:
    return None if margin is None else Measured(margin, figure)


class CurveCheck(EachDesignCheck):
    """A test of a curve over the applied strain.

    Attributes:
        of: the curve.
        fewest: points that it must have.
    """

    of: str
    fewest: ClassVar[int] = 3

    def measure(self, cell: xr.Dataset) -> Measured | None:
        """How far a design bears the claim out, and its figure; ``None`` if it has none."""
        curve = cell[self.of].dropna("applied_strain")
        return None if curve.size < self.fewest else self.measure_curve(curve)

    @abstractmethod
    def measure_curve(self, curve: xr.DataArray) -> Measured | None:
        """How far a curve bears the claim out, and its figure; ``None`` if it has none."""


class Limits(EachDesignCheck):
    """A test of two limits; one of 0 is itself excluded.

    Attributes:
        lowest, highest: the limits.
        slack: by how much knitlab has put them outside those of the paper, for an "about".
    """

    lowest: float = -np.inf
    highest: float = np.inf
    slack: PositiveFloat | None = None

    def scaled_numbers(self, factor: float) -> dict[str, Any]:
        """The fields that change with knitlab's own numbers: both limits with the slack."""
        numbers = super().scaled_numbers(factor)
        if "slack" in self.ours and self.slack is not None:
            more = numbers["slack"] - self.slack
            numbers |= {"lowest": self.lowest - more, "highest": self.highest + more}
        return numbers


class ValueWithin(Limits):
    """One value a design lies between two limits; at a limit of 0 it must differ from it."""

    test: Literal["value_within"]
    of: str

    def measure(self, cell: xr.Dataset) -> Measured | None:
        """How far a design bears the claim out, and its figure; ``None`` if it has none."""
        value = float(cell[self.of])
        return _measured(within(value, self.lowest, self.highest), f"{value:.3g}")


class CurveWithin(Limits, CurveCheck):
    """All values of a curve over the applied strain lie between two limits."""

    fewest: ClassVar[int] = 1
    test: Literal["curve_within"]

    def measure_curve(self, curve: xr.DataArray) -> Measured | None:
        """How far a curve bears the claim out, and its figure; ``None`` if it has none."""
        ends = float(curve.min()), float(curve.max())
        margin = worst(within(end, self.lowest, self.highest) for end in ends)
        return _measured(margin, f"{ends[0]:.2f} to {ends[1]:.2f}")


class LessThan(EachDesignCheck):
    """One value of a design is less than another."""

    test: Literal["less_than"]
    of: str
    than: str

    def measure(self, cell: xr.Dataset) -> Measured | None:
        """How far a design bears the claim out, and its figure; ``None`` if it has none."""
        one, other = float(cell[self.of]), float(cell[self.than])
        margin = below(one, other, strict=True)
        return _measured(margin, f"{one:.3g} to {other:.3g}{unit_of(self.of)}")


class RisesAndFalls(CurveCheck):
    """A curve rises to a peak within the test and falls behind it.

    The fall of a curve that has no peak within the test is 0.
    """

    test: Literal["rises_and_falls"]
    fall: PositiveFloat

    def measure_curve(self, curve: xr.DataArray) -> Measured | None:
        """How far a curve bears the claim out, and its figure; ``None`` if it has none."""
        top = int(curve.values.argmax())
        first, peak, last = (float(curve[place]) for place in (0, top, -1))
        strain = float(curve["applied_strain"][top])
        falls = (peak - last) / peak if peak > max(first, 0.0) else 0.0
        return _measured(
            above(falls, self.fall), f"peak {peak:.3f} at {strain:.0%}, then {-falls:+.0%}"
        )


class Follows(CurveCheck):
    """A strain rises with the applied strain and stays close to it.

    Its margin is the smaller of two: that of its largest departure, over the largest applied
    strain, and its smallest slope against the applied strain.
    """

    test: Literal["follows"]
    tolerance: PositiveFloat

    def measure_curve(self, curve: xr.DataArray) -> Measured | None:
        """How far a curve bears the claim out, and its figure; ``None`` if it has none."""
        applied = curve["applied_strain"]
        off = float(abs(curve - applied).max() / applied.max())
        slope = float((np.diff(curve) / np.diff(applied)).min())
        falls = "" if slope > 0 else ", not monotonic"
        margin = worst([below(off, self.tolerance), above(slope, 0, strict=True)])
        return _measured(margin, f"off by {off:.1%}{falls}")


class LargestAtCentre(EachDesignCheck):
    """A local strain is positive at the centre, and larger there than anywhere along the sample."""

    test: Literal["largest_at_centre"]
    of: str
    applied_strain: PositiveFloat

    def judge(self, cube: xr.Dataset) -> Finding:
        """What a cube says that has the variables."""
        strains = cube["applied_strain"].values
        if not np.isclose(strains, self.applied_strain, 0, 1e-9).any():
            return not_measured(f"no applied strain of {self.applied_strain:g} in this cube")
        return super().judge(cube)

    def measure(self, cell: xr.Dataset) -> Measured | None:
        """How far a design bears the claim out, and its figure; ``None`` if it has none."""
        field = cell[self.of].sel(applied_strain=self.applied_strain, method="nearest")
        along = field.dropna("cell_y", how="all").mean("cell_x").values
        if along.size < 3:
            return None
        middle = central(along.size)
        centre, beside = along[middle].max(), np.delete(along, middle).max()
        scale = float(abs(along).max())
        margin = worst(
            [
                above(along[middle].min(), 0, strict=True, scale=scale),
                above(centre, beside, scale=scale),
            ]
        )
        return _measured(margin, f"{centre:.3f} in the central cells, {beside:.3f} beside them")


class Laboratory(ClaimCheck):
    """A claim that compares with what the laboratory has and the paper's text does not give."""

    test: Literal["laboratory"]
    needs: str

    def finding(self, cube: xr.Dataset) -> Finding:
        """That it cannot be measured here."""
        return not_measured(f"needs {self.needs}")
