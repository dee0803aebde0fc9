"""Targets: what a wanted knit has, as text such as ``poisson_ratio = -0.3 @ 0.05:0.25``."""

import re
from dataclasses import dataclass
from typing import Literal

import numpy as np

from knitlab.io.errors import fault
from knitlab.tables.strain_window import REDUCTIONS, StrainWindow

Relation = Literal["=", "<", ">"]
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_SUBJECT = r"(?:(?P<reduction>[a-z]+)\s*\(\s*(?P<reduced>\w+)\s*\)|(?P<name>[A-Za-z]\w*))"
_TOLERANCE = rf"(?:\s*(?:±|\+/-|\+-)\s*(?P<tolerance>{_NUMBER}))?"
_WINDOW = r"(?:\s*@\s*(?P<window>.+))?"
_ONE_SIDED = re.compile(
    rf"\s*{_SUBJECT}\s*(?P<relation><=|>=|=|<|>)\s*(?P<wanted>{_NUMBER}){_TOLERANCE}{_WINDOW}\s*"
)
_TWO_SIDED = re.compile(
    rf"\s*(?P<low>{_NUMBER})\s*<=?\s*{_SUBJECT}\s*<=?\s*(?P<high>{_NUMBER}){_WINDOW}\s*"
)
FORMS = (
    "NAME = VALUE @ STRAIN:STRAIN, NAME < VALUE @ STRAIN, VALUE < NAME < VALUE,"
    " mean(NAME) > VALUE @ STRAIN:STRAIN"
)


@dataclass(frozen=True)
class Target:
    """A wanted value or range of one variable.

    Attributes:
        text: as it was given.
        name: variable of the cube.
        low: lowest value that meets it, or minus infinity, in the variable's unit.
        high: highest value that meets it, or infinity; the same as ``low`` for one value.
        tolerance: distance that counts as one; ``None`` for the scatter among the designs.
        window: applied strains that it is wanted at, if the variable lies along these.
        reduction: what sums the curve up over the window; ``None`` for every strain of it.
    """

    text: str
    name: str
    low: float
    high: float
    tolerance: float | None = None
    window: StrainWindow | None = None
    reduction: str | None = None

    @property
    def label(self) -> str:
        """Its variable with reduction and window."""
        subject = f"{self.reduction}({self.name})" if self.reduction else self.name
        return f"{subject} @ {self.window}" if self.window else subject

    def excess(self, values: np.ndarray) -> np.ndarray:
        """How far values lie outside of what is wanted: 0 inside, NaN where missing."""
        return np.maximum(values - self.high, 0) + np.maximum(self.low - values, 0)


def parse_target(text: str, source: str = "target") -> Target:
    """Read a target.

    Args:
        text: a variable, a relation and a number, with ``± TOLERANCE`` and ``@ WINDOW`` if
            wanted; see :data:`FORMS`.
        source: the argument that it was given by, for a fault.

    Raises:
        BadInput: if it cannot be read.

    Example:
        >>> target = parse_target("poisson_ratio = -0.3 ± 0.03 @ 0.05:0.25")
        >>> target.low, target.high, str(target.window)
        (-0.3, -0.3, '0.05:0.25')
    """
    where = f"{source} {text}"
    match = _ONE_SIDED.fullmatch(text) or _TWO_SIDED.fullmatch(text)
    if match is None:
        raise fault(where, f"cannot be read; write one of {FORMS}")
    found = match.groupdict()
    reduction = found["reduction"]
    if reduction is not None and reduction not in REDUCTIONS:
        known = ", ".join(REDUCTIONS)
        raise fault(where, f"there is no reduction {reduction!r}; choose of {known}")
    window = None if found["window"] is None else StrainWindow.of(found["window"], where)
    if reduction == "slope" and (window is None or window.single):
        raise fault(where, "a slope needs a window of two strains, such as @ 0.05:0.25")
    if "relation" in found:
        wanted = float(found["wanted"])
        low = -np.inf if found["relation"].startswith("<") else wanted
        high = np.inf if found["relation"].startswith(">") else wanted
    else:
        low, high = float(found["low"]), float(found["high"])
        if low > high:
            raise fault(where, f"no value lies above {low:g} and below {high:g}; exchange them")
    tolerance = None if found.get("tolerance") is None else float(found["tolerance"])
    if tolerance is not None and not tolerance > 0:
        raise fault(where, "has a tolerance that is not above 0; raise it, or leave it out")
    name = found["reduced"] or found["name"]
    return Target(text, name, low, high, tolerance, window, reduction)
