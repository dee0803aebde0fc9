"""Tests of claims: what each kind asks of a cube, and what it found there.

A claim about many designs holds if it holds for each, fails if it fails for one that was measured,
and is not measured while some designs are missing and none of the others fails.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise
from typing import Annotated, ClassVar, Literal

import numpy as np
import xarray as xr
from pydantic import Field, PositiveFloat, PositiveInt

from knitlab.measure.central import central
from knitlab.sweep.design_status import Status
from knitlab.sweep.registry import DESIGN_DIMS, VARIABLES
from knitlab.sweep.strict import Strict


class Verdict(StrEnum):
    """What a cube says to a claim."""

    holds = "holds"
    fails = "fails"
    not_measured = "not measured"


@dataclass(frozen=True)
class Finding:
    """What a test found.

    Attributes:
        verdict: whether the claim holds.
        measured: the figures that decide it, in words.
    """

    verdict: Verdict
    measured: str


Pair = Annotated[tuple[PositiveInt, PositiveInt], Field(strict=False)]
Pairs = Annotated[tuple[Pair, ...], Field(strict=False)]
Numbers = Annotated[tuple[PositiveInt, ...], Field(strict=False)]
Design = tuple[int, int]


def _unit(name: str) -> str:
    """A variable's unit as it follows a number; nothing for a plain number."""
    unit = VARIABLES[name].units
    return "" if unit == "1" else f" {unit}"


class DesignTest(Strict):
    """A test over designs (n_stripe, n_subunit) of a checkerboard.

    Attributes:
        designs: those that it is about, all of them needed; else
        n_stripe: it is about all designs of these n_stripe, or of any, of which
        at_least: so many must be measured, for it to hold; but
        except_for: not about these.
    """

    designs: Pairs | None = None
    n_stripe: Numbers | None = None
    at_least: PositiveInt = 1
    except_for: Pairs = Field(default=(), alias="except")

    def finding(self, cube: xr.Dataset) -> Finding:
        """What the cube says."""
        if cube["status"].dims != DESIGN_DIMS:
            return Finding(Verdict.not_measured, "no checkerboards in this cube")
        if missing := sorted(self.variables() - set(map(str, cube.data_vars))):
            return Finding(Verdict.not_measured, f"no {', '.join(missing)} in this cube")
        return self.judge(cube)

    def variables(self) -> set[str]:
        """What of the cube it asks for."""
        return {getattr(self, name) for name in ("of", "than") if hasattr(self, name)}

    def judge(self, cube: xr.Dataset) -> Finding:
        """What a cube says that has the variables."""
        raise NotImplementedError

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


MOST_LISTED = 6


def _listed(figures: Mapping[Design, str]) -> str:
    shown = [f"({n}, {m}) {figure}" for (n, m), figure in list(figures.items())[:MOST_LISTED]]
    more = len(figures) - len(shown)
    return ", ".join(shown) + (f" and {more} more" if more else "")


def _complete(cube: xr.Dataset, design: Design) -> xr.Dataset | None:
    n_stripe, n_subunit = design
    if n_stripe not in cube["n_stripe"] or n_subunit not in cube["n_subunit"]:
        return None
    cell = cube.sel(n_stripe=n_stripe, n_subunit=n_subunit)
    return cell if int(cell["status"]) == Status.ok else None


class EachDesignTest(DesignTest):
    """A test that every design bears out by itself."""

    def judge(self, cube: xr.Dataset) -> Finding:
        """What a cube says that has the variables."""
        found = {
            design: None if cell is None else self.measure(cell)
            for design, cell in self.cells(cube).items()
        }
        measured = {design: its for design, its in found.items() if its is not None}
        needed = max(self.at_least, len(found) if self.designs else 0)
        count = f"{len(measured)} of {max(needed, len(found))} designs"
        if failing := {design: figure for design, (holds, figure) in measured.items() if not holds}:
            return Finding(Verdict.fails, f"not for {_listed(failing)} (of {count})")
        if len(measured) < needed:
            return Finding(Verdict.not_measured, f"only {count} measured")
        figures = {design: figure for design, (_, figure) in measured.items()}
        return Finding(Verdict.holds, _listed(figures))

    def measure(self, cell: xr.Dataset) -> tuple[bool, str] | None:
        """Whether a design bears the claim out, and its figure; ``None`` if it has none."""
        raise NotImplementedError


class CurveTest(EachDesignTest):
    """A test of a curve over the applied strain.

    Attributes:
        of: the curve.
        fewest: points that it must have.
    """

    of: str
    fewest: ClassVar[int] = 3

    def measure(self, cell: xr.Dataset) -> tuple[bool, str] | None:
        """Whether a design bears the claim out, and its figure; ``None`` if it has none."""
        curve = cell[self.of].dropna("applied_strain")
        return None if curve.size < self.fewest else self.measure_curve(curve)

    def measure_curve(self, curve: xr.DataArray) -> tuple[bool, str]:
        """Whether a curve bears the claim out, and its figure."""
        raise NotImplementedError


class ValueWithin(EachDesignTest):
    """One value a design lies between two limits; at a limit of 0 it must differ from it."""

    test: Literal["value_within"]
    of: str
    lowest: float = -np.inf
    highest: float = np.inf

    def measure(self, cell: xr.Dataset) -> tuple[bool, str] | None:
        """Whether a design bears the claim out, and its figure; ``None`` if it has none."""
        value = float(cell[self.of])
        if not np.isfinite(value):
            return None
        return _within(value, self.lowest, self.highest), f"{value:.3g}"


class CurveWithin(CurveTest):
    """All values of a curve over the applied strain lie between two limits."""

    fewest: ClassVar[int] = 1
    test: Literal["curve_within"]
    lowest: float = -np.inf
    highest: float = np.inf

    def measure_curve(self, curve: xr.DataArray) -> tuple[bool, str]:
        """Whether a curve bears the claim out, and its figure."""
        ends = float(curve.min()), float(curve.max())
        holds = all(_within(end, self.lowest, self.highest) for end in ends)
        return holds, f"{ends[0]:.2f} to {ends[1]:.2f}"


def _within(value: float, lowest: float, highest: float) -> bool:
    above = value > lowest if lowest == 0 else value >= lowest
    return above and (value < highest if highest == 0 else value <= highest)


class LessThan(EachDesignTest):
    """One value of a design is less than another."""

    test: Literal["less_than"]
    of: str
    than: str

    def measure(self, cell: xr.Dataset) -> tuple[bool, str] | None:
        """Whether a design bears the claim out, and its figure; ``None`` if it has none."""
        one, other = float(cell[self.of]), float(cell[self.than])
        if not (np.isfinite(one) and np.isfinite(other)):
            return None
        return one < other, f"{one:.3g} to {other:.3g}{_unit(self.of)}"


class RisesAndFalls(CurveTest):
    """A curve rises to a peak within the test and falls behind it."""

    test: Literal["rises_and_falls"]
    fall: PositiveFloat

    def measure_curve(self, curve: xr.DataArray) -> tuple[bool, str]:
        """Whether a curve bears the claim out, and its figure."""
        top = int(curve.values.argmax())
        peak, last = float(curve[top]), float(curve[-1])
        strain = float(curve["applied_strain"][top])
        falls = (peak - last) / peak if peak > 0 else 0.0
        holds = 0 < top < curve.size - 1 and peak > float(curve[0]) and falls >= self.fall
        return holds, f"peak {peak:.3f} at {strain:.0%}, then {-falls:+.0%}"


class Follows(CurveTest):
    """A strain rises with the applied strain and stays close to it."""

    test: Literal["follows"]
    tolerance: PositiveFloat

    def measure_curve(self, curve: xr.DataArray) -> tuple[bool, str]:
        """Whether a curve bears the claim out, and its figure."""
        applied = curve["applied_strain"]
        off = float(abs(curve - applied).max() / applied.max())
        monotonic = bool((np.diff(curve) > 0).all())
        falls = "" if monotonic else ", not monotonic"
        return monotonic and off <= self.tolerance, f"off by {off:.1%}{falls}"


class LargestAtCentre(EachDesignTest):
    """A local strain is positive at the centre, and larger there than anywhere along the sample."""

    test: Literal["largest_at_centre"]
    of: str
    applied_strain: PositiveFloat

    def judge(self, cube: xr.Dataset) -> Finding:
        """What a cube says that has the variables."""
        strains = cube["applied_strain"].values
        if not np.isclose(strains, self.applied_strain, 0, 1e-9).any():
            said = f"no applied strain of {self.applied_strain:g} in this cube"
            return Finding(Verdict.not_measured, said)
        return super().judge(cube)

    def measure(self, cell: xr.Dataset) -> tuple[bool, str] | None:
        """Whether a design bears the claim out, and its figure; ``None`` if it has none."""
        field = cell[self.of].sel(applied_strain=self.applied_strain, method="nearest")
        along = field.dropna("cell_y", how="all").mean("cell_x").values
        if along.size < 3:
            return None
        middle = central(along.size)
        ends = np.delete(along, middle)
        centre, beside = along[middle].max(), ends.max()
        holds = bool(along[middle].min() > 0 and centre >= beside)
        return holds, f"{centre:.3f} in the central cells, {beside:.3f} beside them"


class LowestOfAll(DesignTest):
    """A design has the lowest value of all."""

    test: Literal["lowest_of_all"]
    of: str

    def judge(self, cube: xr.Dataset) -> Finding:
        """What a cube says that has the variables."""
        everyone = DesignTest.model_construct(at_least=self.at_least).cells(cube)
        values = {
            design: float(cell[self.of])
            for design, cell in everyone.items()
            if cell is not None and np.isfinite(cell[self.of])
        }
        (design,) = self.designs or (None,)
        if design is None or design not in values:
            return Finding(Verdict.not_measured, "the design itself is not measured")
        lowest = min(values, key=lambda other: values[other])
        figures = f"{design} {values[design]:.3f}, lowest {lowest} {values[lowest]:.3f}"
        if lowest != design:
            return Finding(Verdict.fails, figures)
        if len(values) < self.at_least:
            said = f"lowest of {len(values)} designs, of {self.at_least}"
            return Finding(Verdict.not_measured, said)
        return Finding(Verdict.holds, figures)


class Monotonic(DesignTest):
    """A value rises, or falls, from design to design along n_stripe or n_subunit."""

    test: Literal["monotonic"]
    of: str
    along: Literal["n_stripe", "n_subunit"]
    direction: Literal["rises", "falls"]
    reduced: Literal["min", "max"] | None = None

    def judge(self, cube: xr.Dataset) -> Finding:
        """What a cube says that has the variables."""
        place = DESIGN_DIMS.index(self.along)
        families: dict[int, dict[int, float]] = {}
        cells = self.cells(cube)
        for design, cell in cells.items():
            value = np.nan if cell is None else self._value(cell[self.of])
            if np.isfinite(value):
                families.setdefault(design[1 - place], {})[design[place]] = value
        sign = 1 if self.direction == "rises" else -1
        wrong, steps = [], 0
        for fixed, values in families.items():
            for before, after in pairwise(sorted(values)):
                steps += 1
                if sign * (values[after] - values[before]) <= 0:
                    pairs = [
                        f"({x}, {fixed})" if place == 0 else f"({fixed}, {x})"
                        for x in (before, after)
                    ]
                    figures = f"{values[before]:.3f} to {values[after]:.3f}"
                    wrong.append(f"{pairs[0]} to {pairs[1]}: {figures}")
        measured = sum(map(len, families.values()))
        if wrong:
            listed = ", ".join(wrong[:MOST_LISTED])
            return Finding(Verdict.fails, f"{len(wrong)} of {steps} steps do not: {listed}")
        if measured < self.at_least or not steps:
            said = f"only {measured} of {self.at_least} designs measured"
            return Finding(Verdict.not_measured, said)
        return Finding(Verdict.holds, f"all {steps} steps between {measured} designs")

    def _value(self, of: xr.DataArray) -> float:
        if self.reduced is None:
            return float(of)
        return float(of.max() if self.reduced == "max" else of.min())


class Spread(DesignTest):
    """A value differs between designs."""

    test: Literal["spread"]
    of: str
    least: PositiveFloat

    def judge(self, cube: xr.Dataset) -> Finding:
        """What a cube says that has the variables."""
        values = [float(cell[self.of]) for cell in self.cells(cube).values() if cell is not None]
        values = [value for value in values if np.isfinite(value)]
        if len(values) < max(2, self.at_least):
            said = f"only {len(values)} of {self.at_least} designs measured"
            return Finding(Verdict.not_measured, said)
        holds = max(values) >= (1 + self.least) * min(values)
        figures = f"{min(values):.3g} to {max(values):.3g}{_unit(self.of)}"
        verdict = Verdict.holds if holds else Verdict.fails
        return Finding(verdict, f"{figures} over {len(values)} designs")


class Laboratory(Strict):
    """A claim that compares with what the laboratory has and the paper's text does not give."""

    test: Literal["laboratory"]
    needs: str

    def finding(self, cube: xr.Dataset) -> Finding:
        """That it cannot be measured here."""
        return Finding(Verdict.not_measured, f"needs {self.needs}")
