"""The request of a design: targets, variables with their bounds, and settings."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field, NonNegativeInt, PositiveInt, ValidationError

from knitlab.cube.target import Target, read_target
from knitlab.inverse.contradiction import contradictions
from knitlab.io.errors import BadInput, ErrorCollector, Fault, faults_of, unknown
from knitlab.io.toml import StrictModel, read_toml
from knitlab.measure.knit_size import Gauge
from knitlab.measure.sensitivity import STRIPE_PARAMETERS
from knitlab.simulation.stripe_changes import STRIPE_QUANTITIES
from knitlab.sweep.declared_fields import declared
from knitlab.sweep.patterns import is_pattern_name
from knitlab.sweep.settings import PATTERN, SETTINGS

COUNTS = ("n_stripe", "n_subunit")
"""What may vary in whole numbers, as a list."""
CHOICES = (*COUNTS, PATTERN)
"""What may vary as a list: designs are made of all combinations."""
PARAMETERS = (*STRIPE_PARAMETERS, *declared(Gauge))
"""Parameters of stripes and gauge that variables change."""
VARIABLES = (
    *STRIPE_PARAMETERS,
    *(f"{name}_factor" for name in STRIPE_PARAMETERS),
    *(f"{name}_factor" for name in STRIPE_QUANTITIES),
    *declared(Gauge),
)
"""Continuous variables, given with bounds."""
RELATIVE_TOLERANCE = 0.05
"""Default tolerance of a target, over its value."""
TOLERANCE_OF_ZERO = 0.01
"""Default tolerance of a target whose value is zero."""
Given = Annotated[tuple[str | dict[str, Any], ...], Field(strict=False)]


class DesignFile(StrictModel):
    """The file of a design: targets, variables, settings."""

    title: str = ""
    workflow: str = "periodic"
    targets: Annotated[Given, Field(min_length=1)]
    subject_to: Given = ()
    cubes: Annotated[tuple[str, ...], Field(strict=False)] = ()
    starts: PositiveInt = 3
    robustness: NonNegativeInt = 4
    vary: dict[str, Any] = Field(default_factory=dict)
    settings: dict[str, Any] = Field(default_factory=dict)


@dataclass(frozen=True)
class DesignRequest:
    """Targets for a knit, and what may be varied to meet them.

    Attributes:
        name: of the request, and of its folder of results.
        targets: what is wanted.
        subject_to: what must be met.
        choices: numbers of stitches that n_stripe and n_subunit may take, and names of patterns,
            where they may vary.
        bounds: lowest and highest values of numbers of stripes and gauge, by name.
        workflow: name or path of the workflow that everything else is taken from.
        settings: that replace the workflow's.
        cubes: of designs to start from; without any, a coarse sweep is run.
        starts: designs that are refined, the nearest first.
        robustness: siblings that each candidate is tested with.
    """

    name: str
    targets: tuple[Target, ...]
    subject_to: tuple[Target, ...]
    choices: Mapping[str, tuple[int, ...] | tuple[str, ...]]
    bounds: Mapping[str, tuple[float, float]]
    workflow: str
    settings: Mapping[str, Any]
    cubes: tuple[str, ...]
    starts: int
    robustness: int

    def __repr__(self) -> str:
        varied = len(self.choices) + len(self.bounds)
        return f"<DesignRequest {self.name}: {len(self.targets)} targets, {varied} varied>"

    @property
    def fingerprint(self) -> str:
        """The request as text, which identifies it in its results folder."""
        wanted = {
            kind: [[target.text, target.tolerance, target.curve] for target in getattr(self, kind)]
            for kind in ("targets", "subject_to")
        }
        return json.dumps(
            {
                **wanted,
                "vary": dict(self.choices) | dict(self.bounds),
                "workflow": self.workflow,
                "settings": dict(self.settings),
                "cubes": self.cubes,
                "starts": self.starts,
                "robustness": self.robustness,
            },
            indent=1,
            default=str,
        )


def read_request(path: Path) -> DesignRequest:
    """Read the TOML file of a design; paths in it are relative to its folder.

    Raises:
        BadInput: with every fault of it.
    """
    table = read_toml(path)
    for key in ("targets", "subject_to"):
        if isinstance(table.get(key), str):
            table[key] = [table[key]]
    if isinstance(table.get("cubes"), list):
        table["cubes"] = [str((path.parent / str(cube)).resolve()) for cube in table["cubes"]]
    if (beside := path.parent / str(table.get("workflow"))).is_file():
        table["workflow"] = str(beside.resolve())
    return checked_request(path.stem, table, f"{path}: ", path.parent)


def checked_request(
    name: str, table: Mapping[str, Any], source: str = "", folder: Path = Path()
) -> DesignRequest:
    """The request that a table describes.

    Args:
        name: name of the request.
        table: keys of :class:`DesignFile`.
        source: prefix of the messages of faults.
        folder: folder that paths of curves are relative to.

    Raises:
        BadInput: with every fault of it.
    """
    listed = {
        key: table.get(key, ())
        for key in ("targets", "subject_to")
        if isinstance(table.get(key, ()), list | tuple)
    }
    plain = {
        key: [each.text if isinstance(each, Target) else each for each in given]
        for key, given in listed.items()
    }
    try:
        read = DesignFile.model_validate({**table, **plain})
    except ValidationError as error:
        known = dict.fromkeys(DesignFile.model_fields, "")
        raise BadInput(faults_of(error, source.rstrip(": "), known)) from error
    faults = ErrorCollector()
    found: dict[str, list[Target]] = {"targets": [], "subject_to": []}
    for key, given in listed.items():
        for one in given:
            with faults:
                found[key].append(with_tolerance(read_target(one, f"{source}{key}", folder)))
    choices, bounds, wrong = _varied(read.vary, source)
    faults.all += wrong
    for one, other in contradictions([*found["targets"], *found["subject_to"]]):
        problem = f"no value meets both {one.text!r} and {other.text!r}; remove one"
        faults.all.append(Fault(f"{source}targets", problem))
    faults.all += _settled_twice(read, source)
    if faults.all:
        raise BadInput(faults.all)
    return DesignRequest(
        name=name,
        targets=tuple(found["targets"]),
        subject_to=tuple(found["subject_to"]),
        choices=choices,
        bounds=bounds,
        workflow=read.workflow,
        settings=read.settings,
        cubes=read.cubes,
        starts=read.starts,
        robustness=read.robustness,
    )


def with_tolerance(target: Target) -> Target:
    """A target with its tolerance, by default 5 % of its value, or 0.01 if that is zero."""
    if target.tolerance is not None:
        return target
    wanted = max(abs(bound) for bound in (target.low, target.high) if np.isfinite(bound))
    return replace(target, tolerance=RELATIVE_TOLERANCE * wanted or TOLERANCE_OF_ZERO)


def _varied(
    vary: Mapping[str, Any], source: str
) -> tuple[
    dict[str, tuple[int, ...] | tuple[str, ...]], dict[str, tuple[float, float]], list[Fault]
]:
    """What may vary: lists of choices, and bounds; and what is wrong with them."""
    choices: dict[str, tuple[int, ...] | tuple[str, ...]] = {}
    bounds: dict[str, tuple[float, float]] = {}
    faults = []
    for name, value in vary.items():
        place = f"{source}vary.{name}"
        listed = list(value) if isinstance(value, list | tuple) else [value]
        if name == PATTERN:
            if listed and all(isinstance(one, str) and is_pattern_name(one) for one in listed):
                choices[name] = tuple(dict.fromkeys(listed))
            else:
                faults.append(Fault(place, f"is {value!r}; list names of patterns"))
        elif name in COUNTS:
            if listed and all(type(one) is int and one > 0 for one in listed):
                choices[name] = tuple(sorted(set(listed)))
            else:
                faults.append(Fault(place, f"is {value!r}; list whole numbers of stitches"))
        elif name not in VARIABLES:
            faults.append(Fault(place, unknown(name, (*CHOICES, *VARIABLES), "variable")))
        elif not _are_bounds(value):
            example = "give its lowest and highest value above 0, such as [0.8, 1.25]"
            faults.append(Fault(place, f"is {value!r}; {example}"))
        else:
            bounds[name] = (float(value[0]), float(value[1]))
    return choices, bounds, faults


def _are_bounds(value: Any) -> bool:
    numbers = isinstance(value, list | tuple) and len(value) == 2
    if not numbers or not all(isinstance(one, int | float) for one in value):
        return False
    return bool(0 < value[0] < value[1] < math.inf)


def _settled_twice(read: DesignFile, source: str) -> list[Fault]:
    """Faults of settings that are unknown, that also vary, or that the design itself sets."""
    faults = []
    for name in read.settings:
        place = f"{source}settings.{name}"
        if name not in SETTINGS:
            faults.append(Fault(place, unknown(name, SETTINGS, "setting")))
        elif name in read.vary:
            faults.append(Fault(place, "may also vary; remove one of the two"))
        elif name == "robustness":
            faults.append(Fault(place, "is not a setting of a search; give it next to targets"))
        elif isinstance(read.settings[name], list) and not SETTINGS[name].takes_list:
            faults.append(Fault(place, "is a list; give one value, or let it vary"))
    return faults
