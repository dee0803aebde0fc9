"""Windows of applied strain: interpolation and reduction of curves, also as columns of tables."""

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from jaxtyping import Float

from knitlab.cubes.cube_file import design_dims
from knitlab.io.errors import invalid, unknown
from knitlab.observables.schema import STRAIN

IN_PERCENT = 10  # times the last strain: a window beyond is one in percent
PARTS = 64  # equal intervals of a window at whose ends a curve is interpolated

Curves = Float[np.ndarray, "design strain"]
Numbers = Float[np.ndarray, " design"]


@dataclass(frozen=True)
class StrainWindow:
    """A range of applied strains [1], or a single one, at which it starts and stops."""

    start: float
    stop: float

    @property
    def single(self) -> bool:
        """Whether it is one strain."""
        return self.start == self.stop

    def __str__(self) -> str:
        return f"{self.start:g}" if self.single else f"{self.start:g}:{self.stop:g}"

    @classmethod
    def of(cls, text: str, source: str) -> "StrainWindow":
        """The window ``STRAIN`` or ``STRAIN:STRAIN`` of a text; InputError names its source."""
        try:
            start, *rest = (float(strain) for strain in text.split(":"))
            (stop,) = rest or (start,)
        except ValueError:
            message = "is not a window of strain; give one strain or two, such as 0.05:0.25"
            raise invalid(source, f"{text.strip()!r} {message}") from None
        if not 0 <= start <= stop < np.inf:
            raise invalid(source, f"the window {text.strip()} does not ascend from at least 0")
        return cls(start, stop)

    def check_within(self, cubes: Sequence[xr.Dataset], name: str, source: str) -> None:
        """InputError unless a cube has a variable from the start of the window on."""
        last = max((float(cube[STRAIN].max()) for cube in cubes if STRAIN in cube), default=np.inf)
        if self.start > last + 1e-9 or self.stop > IN_PERCENT * last:
            hint = "strains are fractions: 5 % is 0.05" if self.stop > 1 else "take a smaller one"
            message = f"strain {self} is beyond {last:g}, the last of all cubes; {hint}"
            raise invalid(source, message)
        firsts = [first_strain(cube[name]) for cube in cubes if name in cube]
        self.check_start(min(firsts, default=0.0), name, source)

    def check_start(self, first: float, name: str, source: str) -> None:
        """InputError if the window begins below the first strain with a value of a variable."""
        if self.start < first - 1e-9:
            message = f"strain {self} begins below {first:g}, the first with a {name}"
            raise invalid(source, f"{message}; begin there")

    def read(
        self, strains: Float[np.ndarray, " grid"], values: Curves
    ) -> tuple[Float[np.ndarray, " point"], Float[np.ndarray, "design point"]]:
        """Strains of the window, and curves at these."""
        if self.single:
            at = np.array([self.start])
        else:
            inside = strains[(strains > self.start) & (strains < self.stop)]
            at = np.union1d(np.linspace(self.start, self.stop, PARTS + 1), inside)
        return at, interpolated(strains, values, at)


def interpolated(
    strains: Float[np.ndarray, " grid"], values: np.ndarray, at: Float[np.ndarray, " point"]
) -> np.ndarray:
    """Curves, along the last axis, linear between ascending strains; NaN where unknown."""
    if len(strains) == 1:
        return np.where(np.isclose(at, strains[0]), values, np.nan)
    upper = np.clip(np.searchsorted(strains, at), 1, len(strains) - 1)
    lower = upper - 1
    along = (at - strains[lower]) / (strains[upper] - strains[lower])
    # A simulated strain is not interpolated, as its neighbour may be missing.
    near = np.rint(along)
    along = np.where(np.isclose(along, near, 0, 1e-9), near, along)
    below = np.where(along < 1, values[..., lower], 0)
    above = np.where(along > 0, values[..., upper], 0)
    read = below * (1 - along) + above * along
    return np.where((along < 0) | (along > 1), np.nan, read)


def first_strain(curve: xr.DataArray) -> float:
    """The first strain of a curve; the next one if no design has a value there, as ν at 0."""
    strains = curve[STRAIN].values.astype(float)
    absent = len(strains) > 1 and bool(curve.isel({STRAIN: 0}).isnull().all())
    return float(strains[1 if absent else 0])


def _mean(at: np.ndarray, curves: Curves) -> Numbers:
    if len(at) == 1:
        return curves[:, 0]
    return np.trapezoid(curves, at, axis=1) / (at[-1] - at[0])


def _slope(at: np.ndarray, curves: Curves) -> Numbers:
    """Slope of the least-squares line through a curve; NaN at a single strain."""
    from_middle = at - (at[0] + at[-1]) / 2
    moment = np.trapezoid(from_middle**2, at) if len(at) > 1 else np.nan
    return np.trapezoid(curves * from_middle, at, axis=1) / moment


def _linearity(at: np.ndarray, curves: Curves) -> Numbers:
    """R² of the least-squares line through a curve; NaN at a single strain or if it is constant."""
    explained = _slope(at, curves) ** 2 * np.trapezoid((at - (at[0] + at[-1]) / 2) ** 2, at)
    varied = np.trapezoid((curves - _mean(at, curves)[:, None]) ** 2, at, axis=1)
    return np.divide(explained, varied, out=np.full(len(curves), np.nan), where=varied > 0)


REDUCTIONS: dict[str, Callable[[np.ndarray, Curves], Numbers]] = {
    "mean": _mean,
    "slope": _slope,
    "linearity": _linearity,
    "spread": lambda at, curves: np.ptp(curves, axis=1),
    "min": lambda at, curves: curves.min(axis=1),
    "max": lambda at, curves: curves.max(axis=1),
}
"""Reductions of a curve over a window: its mean, the slope and R² of its least-squares line, its
range, and its extremes. NaN if any value is missing."""
MAX_CHARACTERS = 1000  # of an expression
MAX_EXPRESSIONS = 100  # of a table
# mean(poisson_ratio, 0.05:0.25)
_COLUMN = re.compile(rf"\b({'|'.join(REDUCTIONS)})\s*\(\s*(\w+)\s*,([^()]*)\)")


def check_length(text: str, source: str) -> None:
    """InputError if an expression is so long that it would take long to read."""
    if len(text) > MAX_CHARACTERS:
        message = f"is too long: {len(text)} characters; take at most {MAX_CHARACTERS}"
        raise invalid(source, message)


def gradient(reduction: str, at: np.ndarray, curve: Float[np.ndarray, " point"]) -> np.ndarray:
    """Derivative of a reduction by the value of the curve at each strain of the window."""
    unit = np.eye(len(at))
    lowest, highest = unit[np.argmin(curve)], unit[np.argmax(curve)]
    if reduction in ("min", "max", "spread"):
        return {"min": lowest, "max": highest, "spread": highest - lowest}[reduction]
    if reduction != "linearity":
        return REDUCTIONS[reduction](at, unit)  # it is linear
    from_mean = curve - _mean(at, curve[None])[0]
    varied = np.trapezoid(from_mean**2, at)
    slope = _slope(at, curve[None])[0]
    moment = np.trapezoid((at - (at[0] + at[-1]) / 2) ** 2, at)
    by_slope = 2 * slope * moment / varied * _slope(at, unit)
    return by_slope - 2 * slope**2 * moment / varied**2 * np.trapezoid(from_mean * unit, at, axis=1)


def root_mean_square(at: np.ndarray, curves: Curves) -> Numbers:
    """Root mean square of curves over a window."""
    return np.sqrt(_mean(at, curves**2))


def reduced_columns(text: str) -> list[str]:
    """The reduced columns that a condition, or another text, names."""
    return list(dict.fromkeys(match[0] for match in _COLUMN.finditer(text)))


def reduced_windows(text: str) -> list[StrainWindow]:
    """The windows over which the columns in a text are reduced."""
    return [StrainWindow.of(match[3], match[0]) for match in _COLUMN.finditer(text)]


def with_columns(cubes: Sequence[xr.Dataset], texts: Iterable[str]) -> list[xr.Dataset]:
    """Cubes with the reduced columns in some texts as variables; InputError if these cannot be."""
    known = {
        str(name)
        for cube in cubes
        for name in cube.data_vars
        if set(cube[name].dims) - set(design_dims(cube)) == {STRAIN}
    }
    expressions = {text for text in texts if text and not text.isidentifier()}
    matches = {match[0]: match for text in expressions for match in _COLUMN.finditer(text)}
    if (number := max(len(expressions), len(matches))) > MAX_EXPRESSIONS:
        raise invalid("expressions", f"are {number:,}; take at most {MAX_EXPRESSIONS} at once")
    extended = list(cubes)
    for column, match in matches.items():
        reduction, name, window = match.groups()
        strains = StrainWindow.of(window, column)
        if name not in known:
            raise invalid(column, f"reduces a curve along {STRAIN}, and {unknown(name, known)}")
        strains.check_within(cubes, name, column)
        for number, cube in enumerate(extended):
            if name in cube:
                curve = cube[name]
                curves = curve.values.reshape(-1, curve.sizes[STRAIN])
                at, curves = strains.read(cube[STRAIN].values, curves)
                values = REDUCTIONS[reduction](at, curves).reshape(curve.shape[:-1])
                unit = "1" if reduction == "linearity" else curve.attrs.get("units", "1")
                about = {"units": unit, "long_name": column}
                extended[number] = cube.assign({column: (curve.dims[:-1], values, about)})
    return extended
