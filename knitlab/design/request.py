"""The request of a design: targets with tolerances, variables with bounds, and settings."""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field, NonNegativeInt, PositiveInt, ValidationError

from knitlab.cubes.strain_window import PARTS, StrainWindow
from knitlab.cubes.target import MAX_TARGETS, Target, read_target
from knitlab.io.errors import (
    ErrorCollector,
    InputError,
    Mistake,
    invalid,
    pydantic_mistakes,
    raise_if_any,
    unknown,
)
from knitlab.io.names import Line
from knitlab.io.toml import StrictModel, read_toml
from knitlab.model.stitches import Gauge
from knitlab.model.stripe import STRIPE_QUANTITIES
from knitlab.observables.case_variables import STRIPE_PARAMETERS
from knitlab.runs.declared_fields import declared
from knitlab.runs.patterns import is_pattern_name
from knitlab.runs.workflow import PATTERN, SETTINGS, SWEPT_PROTOCOL

CHOICES = ("n_stripe", "n_subunit", PATTERN)  # vary as lists, in all combinations
PARAMETERS = (*STRIPE_PARAMETERS, *declared(Gauge))  # what variables change
FACTORS = tuple(f"{each}_factor" for each in (*STRIPE_PARAMETERS, *STRIPE_QUANTITIES))
RELATIVE_TOLERANCE = 0.05  # default tolerance of a target, over its value
TOLERANCE_OF_ZERO = 0.01  # default tolerance of a target whose value is zero
WITHIN_RANGE = ("mean", "min", "max")  # reductions that lie between the ends of a curve's range


@dataclass(frozen=True)
class Variable:
    """A number of the stripes or the gauge that may vary between two bounds, in its unit."""

    name: str  # a parameter, or the factor of one or of both knits' parameters
    low: float
    high: float

    def changes(self, parameter: str) -> bool:
        """Whether a parameter is proportional to it."""
        quantity = self.name.removesuffix("_factor")
        return parameter in (quantity, f"rib_{quantity}", f"garter_{quantity}")


Given = Annotated[
    tuple[str | dict[str, Any] | Target, ...],
    BeforeValidator(lambda given: (given,) if isinstance(given, str | Mapping | Target) else given),
    Field(strict=False, max_length=MAX_TARGETS),
]


class DesignFile(StrictModel):
    """The file of a design, by the arguments of :func:`knitlab.design`."""

    title: Line | None = None
    workflow: str = "periodic"
    targets: Annotated[Given, Field(min_length=1)]
    subject_to: Given = ()
    cubes: Annotated[tuple[str, ...], Field(strict=False)] = ()
    starts: PositiveInt = 3
    robustness: NonNegativeInt = 4
    vary: dict[str, Any] = Field(default_factory=dict)
    settings: dict[str, Any] = Field(default_factory=dict)


class DesignRequest(DesignFile):
    """The same with a name, with targets and variables that were checked."""

    name: str
    targets: tuple[Target, ...]
    subject_to: tuple[Target, ...] = ()
    choices: dict[str, tuple[int | str, ...]] = Field(default_factory=dict)
    variables: tuple[Variable, ...] = ()

    def __repr__(self) -> str:
        return f"<DesignRequest {self.name}: {len(self.targets)} targets, {len(self.vary)} varied>"

    @property
    def wanted(self) -> tuple[Target, ...]:
        """Targets, then constraints."""
        return (*self.targets, *self.subject_to)

    @property
    def text(self) -> str:
        """The request as text, which identifies it in its results folder."""
        named = {"name", "title", "vary"}  # choices and variables say what may vary
        return json.dumps(self.model_dump(exclude=named), indent=1, default=str)


def read_request(path: Path) -> DesignRequest:
    """Read the TOML file of a design, as :func:`checked_request`; paths are relative to it."""
    table = read_toml(path)
    if isinstance(table.get("cubes"), list):
        table["cubes"] = [str((path.parent / str(cube)).resolve()) for cube in table["cubes"]]
    if (beside := path.parent / str(table.get("workflow"))).is_file():
        table["workflow"] = str(beside.resolve())
    return checked_request(path.stem, table, f"{path}: ", path.parent)


def checked_request(
    name: str, table: Mapping[str, Any], source: str = "", folder: Path = Path()
) -> DesignRequest:
    """The request of a table, with curves of a folder; InputError with every mistake."""
    try:
        file = DesignFile.model_validate(table)
    except ValidationError as error:
        known = dict.fromkeys(DesignFile.model_fields, "")
        raise InputError(pydantic_mistakes(error, source.rstrip(": "), known)) from error
    mistakes = ErrorCollector()
    read: dict[str, list[Target]] = {"targets": [], "subject_to": []}
    for key, targets in read.items():
        for given in getattr(file, key):
            with mistakes:
                targets.append(with_tolerance(read_target(given, f"{source}{key}", folder)))
    choices = dict[str, Any]()
    variables = list[Variable]()
    for name_of_variable, value in file.vary.items():
        where = f"{source}vary.{name_of_variable}"
        with mistakes:
            if name_of_variable in CHOICES:
                choices[name_of_variable] = _choices(name_of_variable, value, where)
            else:
                variables.append(_variable(name_of_variable, value, where))
    for one, other in contradictions([*read["targets"], *read["subject_to"]]):
        message = f"no value meets both {one.text!r} and {other.text!r}; remove one"
        mistakes.all.append(Mistake(f"{source}targets", message))
    for setting, value in file.settings.items():
        with mistakes:
            where = f"{source}settings.{setting}"
            if setting not in SETTINGS:
                raise invalid(where, unknown(setting, SETTINGS, "setting"))
            if setting in file.vary:
                raise invalid(where, "may also vary; remove one of the two")
            if setting in SWEPT_PROTOCOL and value not in ("warp", None, 1):
                raise invalid(where, "a design is pulled once, along the warp; leave it out")
            if setting == "robustness":
                raise invalid(where, "is not a setting of a search; give it next to targets")
            if isinstance(value, list) and not SETTINGS[setting].takes_list:
                raise invalid(where, "is a list; give one value, or let it vary")
    raise_if_any(mistakes.all)
    given = {**dict(file), **{key: tuple(targets) for key, targets in read.items()}, "name": name}
    return DesignRequest(**given, choices=choices, variables=tuple(variables))


def with_tolerance(target: Target) -> Target:
    """A target with its tolerance, by default 5 % of its value, or 0.01 if that is zero."""
    if target.tolerance is not None:
        return target
    wanted = max(abs(bound) for bound in (target.low, target.high) if np.isfinite(bound))
    return replace(target, tolerance=RELATIVE_TOLERANCE * wanted or TOLERANCE_OF_ZERO)


def contradictions(targets: Sequence[Target]) -> Iterator[tuple[Target, Target]]:
    """Pairs of targets of one variable whose allowed values have nothing in common."""
    for one, other in combinations(targets, 2):
        same = one.name == other.name and (one.window is None) == (other.window is None)
        if same and _contradict(one, other):
            yield one, other


def _contradict(one: Target, other: Target) -> bool:
    first, second = (target.window or StrainWindow(0, 0) for target in (one, other))
    start = max(first.start, second.start)
    stop = min(first.stop, second.stop)
    strains = np.linspace(start, stop, PARTS + 1)
    (low, high) = one.allowed(strains)
    (other_low, other_high) = other.allowed(strains)
    if one.reduction == other.reduction and (one.window == other.window or not one.reduction):
        apart = (np.maximum(low, other_low) > np.minimum(high, other_high)).any()
        return start <= stop and bool(apart)
    if one.reduction is not None:
        # A reduction of a curve may contradict the range of the curve itself.
        return other.reduction is None and _contradict(other, one)
    if other.reduction not in WITHIN_RANGE or (start, stop) != (second.start, second.stop):
        return False
    return bool(np.max(other_low) > np.max(high) or np.min(other_high) < np.min(low))


def _choices(name: str, value: Any, where: str) -> tuple[Any, ...]:
    """The labels that a design may have, each once."""
    listed = list(value) if isinstance(value, list | tuple) else [value]
    if name == PATTERN:
        if not (listed and all(isinstance(one, str) and is_pattern_name(one) for one in listed)):
            raise invalid(where, f"is {value!r}; list names of patterns")
        return tuple(dict.fromkeys(listed))
    if not (listed and all(type(one) is int and one > 0 for one in listed)):
        raise invalid(where, f"is {value!r}; list whole numbers of stitches")
    return tuple(sorted(set(listed)))


def _variable(name: str, value: Any, where: str) -> Variable:
    known = (*PARAMETERS, *FACTORS)
    if name not in known:
        raise invalid(where, unknown(name, (*CHOICES, *known), "variable"))
    listed = list(value) if isinstance(value, list | tuple) else [value]
    numbers = len(listed) == 2 and all(isinstance(one, int | float) for one in listed)
    if not (numbers and 0 < listed[0] < listed[1] < math.inf):
        example = "give its lowest and highest value above 0, such as [0.8, 1.25]"
        raise invalid(where, f"is {value!r}; {example}")
    return Variable(name, float(listed[0]), float(listed[1]))
