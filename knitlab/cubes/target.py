"""Targets: wanted values of variables, as text such as ``poisson_ratio = -0.3 @ 0.05:0.25``."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field, PositiveFloat, model_validator

from knitlab.cubes.strain_window import REDUCTIONS, StrainWindow, check_length
from knitlab.io.errors import invalid, naming, unknown
from knitlab.io.table_file import read_columns
from knitlab.io.toml import StrictModel
from knitlab.observables.schema import STRAIN

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_SUBJECT = r"(?P<subject>[^<>=@]+?)"  # a variable, its reduction, or an expression over columns
_VARIABLE = re.compile(r"(?:(?P<reduction>[a-z]+)\s*\(\s*(\w+)\s*\)|([A-Za-z]\w*))")
_TOLERANCE = rf"(?:\s*(?:±|\+/-|\+-)\s*(?P<tolerance>{_NUMBER}))?"
_WINDOW = r"(?:\s*@\s*(?P<window>.+))?"
_ONE_SIDED = re.compile(
    rf"\s*{_SUBJECT}\s*(?P<relation><=|>=|=|<|>)\s*(?P<wanted>{_NUMBER}){_TOLERANCE}{_WINDOW}\s*"
)
_TWO_SIDED = re.compile(
    rf"\s*(?P<low>{_NUMBER})\s*<=?\s*{_SUBJECT}\s*<=?\s*(?P<high>{_NUMBER}){_WINDOW}\s*"
)
_CURVE = re.compile(rf"\s*(?P<subject>[A-Za-z]\w*)\s*=\s*(?P<path>.*\.csv){_TOLERANCE}\s*")
MAX_TARGETS = 30  # of a search
CURVE_EXAMPLE = "write it as in 'strain,poisson_ratio' with numbers below"
FORMS = (
    "NAME = VALUE @ STRAIN:STRAIN, NAME < VALUE @ STRAIN, VALUE < NAME < VALUE,"
    " mean(NAME) > VALUE @ STRAIN:STRAIN, NAME = CURVE.csv, EXPRESSION > VALUE"
)
Numbers = Annotated[tuple[float, ...], Field(strict=False, min_length=1)]


@dataclass(frozen=True)
class Target:
    """A wanted value or range of one variable, in its unit."""

    text: str
    name: str  # of a variable, or in `find` an expression over columns, one number for each design
    low: float  # equal to high for one value, or infinite; of a curve its range
    high: float
    tolerance: float | None = None  # unit of distance; None for the scatter among the designs
    window: StrainWindow | None = None  # of a variable along the strain
    reduction: str | None = None  # over the window; None for every strain of it
    curve: tuple[tuple[float, ...], tuple[float, ...]] | None = None  # strains and wanted values

    def __repr__(self) -> str:
        return f"<Target {self.text}>"

    @property
    def label(self) -> str:
        """The variable with reduction and window."""
        subject = f"{self.reduction}({self.name})" if self.reduction else self.name
        return f"{subject} @ {self.window}" if self.window else subject

    @property
    def allowance(self) -> float:
        """Distance that still counts as met: the tolerance of a value or curve, 0 of a range."""
        single = self.curve is not None or self.low == self.high
        return self.tolerance or 0.0 if single else 0.0

    def bounds(self, strains: np.ndarray) -> tuple[np.ndarray | float, np.ndarray | float]:
        """Lowest and highest values that meet the target, at strains of its window."""
        if self.curve is None:
            return self.low, self.high
        wanted = np.interp(strains, *self.curve)
        return wanted, wanted

    def allowed(self, strains: np.ndarray) -> tuple[np.ndarray | float, np.ndarray | float]:
        """The same bounds, widened by the allowance."""
        low, high = self.bounds(strains)
        return low - self.allowance, high + self.allowance

    def departure(self, values: np.ndarray, strains: np.ndarray) -> np.ndarray:
        """Distance of values above (+) or below (−) the wanted range: 0 inside, NaN if missing."""
        low, high = self.bounds(strains)
        return np.maximum(values - high, 0) - np.maximum(low - values, 0)


class CurveTable(StrictModel):
    """A wanted curve as a table: ``{name, applied_strain, value, tolerance}``."""

    name: str
    applied_strain: Numbers
    value: Numbers
    tolerance: PositiveFloat | None = None

    @model_validator(mode="after")
    def _is_a_curve(self) -> "CurveTable":
        if len(self.value) != len(self.applied_strain):
            counts = f"{len(self.value)} values at {len(self.applied_strain)} strains"
            raise ValueError(f"has {counts}; give one for each")
        if self.applied_strain[0] < 0 or not (np.diff(self.applied_strain) > 0).all():
            raise ValueError("has strains that do not ascend from at least 0; sort them")
        return self

    @property
    def target(self) -> Target:
        """The target."""
        window = StrainWindow(self.applied_strain[0], self.applied_strain[-1])
        return Target(
            f"{self.name} = curve @ {window}",
            self.name,
            min(self.value),
            max(self.value),
            self.tolerance,
            window,
            curve=(self.applied_strain, self.value),
        )


def check_window(target: Target, along_strain: bool, source: str) -> None:
    """InputError unless a target has a window of strain if and only if its variable needs one."""
    if along_strain and target.window is None:
        raise invalid(source, f"{target.name} varies with {STRAIN}; add @ STRAIN or @ FROM:TO")
    if not along_strain and (target.window is not None or target.reduction is not None):
        raise invalid(source, f"{target.name} is one number of a design; leave out the window")


def read_target(
    given: str | Mapping[str, Any] | Target, source: str = "target", folder: Path = Path()
) -> Target:
    """A target from its text, one of the :data:`FORMS`, or from a table of a wanted curve.

    ``source`` names the argument in messages; paths of curves are relative to ``folder``.
    """
    if isinstance(given, Target):
        return given
    if isinstance(given, str):
        check_length(given, source)
        return _target_of_text(given.strip(), f"{source} {given}", folder)
    with naming(source):
        return CurveTable.model_validate(dict(given)).target


def _target_of_text(text: str, where: str, folder: Path) -> Target:
    match = _CURVE.fullmatch(text) or _TWO_SIDED.fullmatch(text) or _ONE_SIDED.fullmatch(text)
    groups: dict[str, Any] = match.groupdict() if match else {}
    subject = groups.get("subject", "").strip()
    variable = _VARIABLE.fullmatch(subject)
    if match is None or (variable is None and groups["window"] is not None):
        raise invalid(where, f"cannot be read; write one of {FORMS}")
    tolerance = float(groups["tolerance"]) if groups.get("tolerance") else None
    if tolerance is not None and not tolerance > 0:
        raise invalid(where, "has a tolerance that is not above 0; raise it, or leave it out")
    if "path" in groups:
        path = folder / groups["path"]
        columns = read_columns(path, {"strain": None, subject: None}, CURVE_EXAMPLE).numbers
        strains, values = (columns[column].tolist() for column in ("strain", subject))
        table = {"name": subject, "applied_strain": strains, "value": values}
        return replace(read_target(table, str(path)), text=text.strip(), tolerance=tolerance)
    reduction = variable and variable["reduction"]
    if reduction is not None and reduction not in REDUCTIONS:
        raise invalid(where, unknown(reduction, REDUCTIONS, "reduction"))
    window = StrainWindow.of(groups["window"], where) if groups["window"] else None
    if reduction in ("slope", "linearity") and (window is None or window.single):
        raise invalid(where, f"a {reduction} needs a window of two strains, such as @ 0.05:0.25")
    if "relation" in groups:
        low = -np.inf if groups["relation"].startswith("<") else float(groups["wanted"])
        high = np.inf if groups["relation"].startswith(">") else float(groups["wanted"])
    else:
        low, high = float(groups["low"]), float(groups["high"])
        if low > high:
            raise invalid(where, f"no value is above {low:g} and below {high:g}; exchange them")
    name = subject if variable is None else variable[2] or variable[3]
    return Target(text, name, low, high, tolerance, window, reduction)
