"""The start of a tensile record: a force at zero strain is an offset of the cell, or a preload."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float

from knitlab.io.errors import invalid, shown
from knitlab.lab.fit_statistics import quantile

Zero = Literal["none", "start"] | float
"""What is subtracted from the force: nothing, the force at zero strain, or a number [N]."""
Points = Float[np.ndarray, " point"]

FIRST = 0.1  # of the range of strain, that the start is read from
MIN_READINGS = 8  # that it is read from, if there are as many
MIN_POINTS = 4  # different strains among them
AT_REST = 1e-3  # of the range of strain, up to which readings are at zero strain
MIN_AT_REST = 3  # of these, so that their own scatter gives their noise
CONFIDENCE = 0.99
RESOLUTION = 1e-3  # of the largest force, below which a force counts as 0
NEAR_PRELOAD = 0.1  # of a preload, by which the force at zero strain may differ from it


class Start(NamedTuple):
    """The force at zero strain, its noise, and its slope there."""

    force: float
    noise: float  # half-width of its confidence interval
    slope: float  # force over strain


@dataclass(frozen=True)
class Correction:
    """Corrections of the repeats of a record, by name, and the sentences that report them."""

    offsets: dict[str, float]  # subtracted from the force
    stretched: float = 0.0  # strain at which they began, of the relaxed length
    summary: tuple[str, ...] = ()


def loading_start(strain: Points, force: Points) -> Start | None:
    """The start of a first loading; None if it is not recorded.

    The force is the mean of three or more readings at zero strain; with fewer, that of a parabola
    through the first readings, unless those at zero strain disagree with it beyond the noise.
    """
    if len(strain) < MIN_POINTS or strain.min() > FIRST * strain.max():
        return None
    reach = max(FIRST * strain.max(), np.sort(strain)[min(MIN_READINGS, len(strain)) - 1])
    near = strain <= reach
    if len(np.unique(strain[near])) < MIN_POINTS:
        return None
    at, pulled = strain[near] / reach, force[near]
    parabola, line = _polynomial(at, pulled, 2), _polynomial(at, pulled, 1)
    slope = (parabola if parabola.curved else line).slope  # a line's has less noise
    resting = force[strain <= AT_REST * strain.max()]
    floor = RESOLUTION * float(np.abs(force).max())
    if len(resting) >= MIN_AT_REST:
        error = float(resting.std(ddof=1)) / math.sqrt(len(resting))
        noise = max(quantile(len(resting) - 1, CONFIDENCE) * error, floor)
        return Start(float(resting.mean()), noise, slope / float(reach))
    value, error, least = parabola.value, parabola.error, abs(parabola.value - line.value)
    if len(resting):
        error, least = parabola.noise / math.sqrt(len(resting)), 0.0
    noise = max(quantile(len(at) - 3, CONFIDENCE) * error, least, floor)
    if len(resting) and abs(resting.mean() - value) > noise:
        value = float(resting.mean())
    return Start(value, noise, slope / float(reach))


class _Polynomial(NamedTuple):
    value: float  # at 0
    slope: float
    error: float  # standard error of the value
    noise: float  # standard deviation of a reading
    curved: bool  # whether its last term is beyond the noise


def _polynomial(at: Points, values: Points, degree: int) -> _Polynomial:
    powers = at[:, None] ** np.arange(degree + 1)
    coefficients = np.linalg.lstsq(powers, values)[0]
    freedom = len(at) - degree - 1
    noise = math.sqrt(np.sum((values - powers @ coefficients) ** 2) / freedom)
    errors = noise * np.sqrt(np.diag(np.linalg.pinv(powers.T @ powers)))
    curved = bool(abs(coefficients[-1]) > quantile(freedom, CONFIDENCE) * errors[-1])
    value, slope = coefficients[:2].tolist()
    return _Polynomial(value, slope, float(errors[0]), noise, curved)


def start_correction(
    where: str,
    starts: Mapping[str, Start | None],
    zero: Zero | None,
    preload: float | None,
    unit: str,
) -> Correction:
    """Corrections of repeats, in one unit of force, by their starts and what the user says."""
    is_number = isinstance(zero, int | float) and math.isfinite(zero)
    if not (zero in (None, "none", "start") or is_number):
        raise invalid("zero", f"is {shown(zero)}; give none, start, or a number of newtons")
    if preload is not None and not 0 < preload < math.inf:
        raise invalid("preload", f"is {preload:g} N; give a tension above 0")
    for name, newtons in (("preload", preload), ("zero", zero)):
        if isinstance(newtons, int | float) and unit != "N":
            message = "is in N, but the record holds stress; give a record of the force, or zero"
            raise invalid(f"{name} {newtons:g}", f"{message} start")
    known = {name: start for name, start in starts.items() if start is not None}
    if len(known) < len(starts) and (zero == "start" or preload is not None):
        message = "has too few readings near zero strain for zero start or a preload"
        raise invalid(where, f"{message}; give the whole record, or zero as a number")
    if zero is None and preload is None:
        _refuse_ambiguous(where, known, unit)
        return Correction(dict.fromkeys(starts, 0.0))
    if zero == "start":
        offsets = {name: start.force - (preload or 0.0) for name, start in known.items()}
    else:
        offsets = dict.fromkeys(starts, float(zero) if isinstance(zero, float | int) else 0.0)
    slope = float(np.mean([start.slope for start in known.values()])) if known else math.nan
    summary = []
    if zero == "none" and known:
        kept = _amount([start.force for start in known.values()], slope, unit)
        summary.append(f"{kept} is kept at zero strain")
    elif zero not in (None, "none"):
        summary.append(_amount([*offsets.values()], slope, unit) + " is subtracted from the force")
    if preload is None:
        return Correction(offsets, summary=tuple(summary))
    for name, start in known.items():
        left = start.force - offsets[name]
        if abs(left - preload) > max(start.noise, NEAR_PRELOAD * preload):
            message = f"is {left:.3g} {unit} at zero strain, not a preload of {preload:.3g} {unit}"
            hint = (
                "if the load cell was zeroed under it, also give zero = start; else correct preload"
            )
            raise invalid(_named(where, name, starts), f"{message}; {hint}")
    if not slope > preload:
        message = f"rises by {slope:.3g} {unit} per strain of 1 at its start, so that no relaxed"
        message += f" length follows from a preload of {preload:.3g} {unit}; give a smaller one"
        raise invalid(where, message)
    stretched = _stretched(preload, slope)
    summary.append(
        f"begins under a preload of {preload:.3g} {unit}, which stretches it by"
        f" {_percent(stretched)}; strains are counted from the relaxed length"
    )
    return Correction(offsets, stretched, tuple(summary))


def _refuse_ambiguous(where: str, starts: Mapping[str, Start], unit: str) -> None:
    checked = dict(starts)
    if len(starts) > 1:  # an offset is common to all repeats
        forces, noises, slopes = np.array([*starts.values()]).T
        noise = float(np.sqrt(np.sum(noises**2))) / len(starts)
        checked["mean"] = Start(float(forces.mean()), noise, float(slopes.mean()))
    for name, start in checked.items():
        if abs(start.force) <= start.noise:
            continue
        begins = f"is {start.force:.3g} {unit} at zero strain, above its noise of {start.noise:.2g}"
        hint = "if that is an offset of the load cell, give zero = start"
        if start.force > 0:
            stretch = "more than doubles its length"
            if start.slope > 2 * start.force:
                stretch = f"stretches it by {_percent(_stretched(start.force, start.slope))}"
            hint += f"; if it is a preload, which {stretch}, give preload = {start.force:.3g}"
        hint += "; to keep it, give zero = none"
        raise invalid(_named(where, name, starts), f"{begins} {unit}; {hint}")


def _named(where: str, name: str, starts: Mapping[str, object]) -> str:
    if name not in starts:
        return f"{where}, mean of {len(starts)} repeats"
    return f"{where}, repeat {name}" if len(starts) > 1 else where


def _amount(forces: list[float], slope: float, unit: str) -> str:
    least, most = min(forces), max(forces)
    amount = f"{least:.3g} to {most:.3g}" if most - least > 0.01 * abs(most) else f"{most:.3g}"
    as_strain = f" ({_percent(float(np.mean(forces)) / slope)} strain by the first slope)"
    return f"{amount} {unit}{as_strain if slope > 0 else ''}"


def _stretched(preload: float, slope: float) -> float:
    """Strain of the relaxed length at which a record began; the slope is by the preloaded one."""
    return preload / (slope - preload)


def _percent(value: float) -> str:
    return f"{100 * value:.3g} %"
