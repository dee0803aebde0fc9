"""Claims: statements of the paper and their tests (``params/claims.toml``)."""

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal, get_args

import xarray as xr
from pydantic import Field, ValidationError, create_model

from knitlab.io.errors import BadInput, Fault, faults_of
from knitlab.io.shipped import shipped
from knitlab.io.strict_model import StrictModel
from knitlab.io.suggestions import unknown
from knitlab.io.toml import read_toml
from knitlab.validation import comparison_checks, sample_checks
from knitlab.validation.margin import CheckResult, NotMeasured

CLAIMS = "claims.toml"
Topic = Literal[
    "stripes", "relaxed shape", "wavelengths", "tension", "Poisson's ratio", "capacitors"
]
TOPICS: tuple[Topic, ...] = get_args(Topic)


def laboratory(cube: xr.Dataset, needs: str) -> CheckResult:
    """A comparison with measurements that are not in the paper's text."""
    raise NotMeasured(f"needs {needs}")


CHECKS: dict[str, Callable[..., CheckResult]] = {
    check.__name__: check
    for check in (
        comparison_checks.lowest_of_all,
        comparison_checks.monotonic,
        comparison_checks.sample_order,
        comparison_checks.spread,
        comparison_checks.stripe_order,
        comparison_checks.trades_off,
        laboratory,
        comparison_checks.common_slope,
        comparison_checks.departs_most,
        comparison_checks.linear,
        sample_checks.follows,
        sample_checks.largest_at_centre,
        sample_checks.less_than,
        sample_checks.rises_and_falls,
        sample_checks.same_curves,
        sample_checks.stripe_toe,
        sample_checks.value_within,
    )
}
"""The tests of claims by name."""


class Statement(StrictModel):
    """A statement of the paper.

    Attributes:
        text: the statement.
        place: its place in the paper.
        topic: its topic.
        measured_along: direction that is tested here, if the statement is about both.
        figure: kind of figure that shows it, if any.
        why_not: why knitlab does not reproduce it, as far as known.
        test: name of its test in :data:`CHECKS`.
        knitlab: arguments of the test that are not from the paper but chosen for knitlab.
    """

    text: str = Field(min_length=1)
    place: str = Field(min_length=1)
    topic: Topic
    measured_along: Literal["weft", "warp"] | None = None
    figure: str | None = None
    why_not: str | None = Field(default=None, min_length=1)
    test: str
    knitlab: dict[str, float] = Field(default_factory=dict)


@dataclass(frozen=True)
class Claim:
    """A statement of the paper, and the arguments of its test besides cubes."""

    name: str
    statement: Statement
    arguments: Mapping[str, Any]

    @property
    def quoted(self) -> str:
        """The statement, with the direction that is tested here."""
        along = self.statement.measured_along
        return f"{self.statement.text} (here along the {along})" if along else self.statement.text

    @property
    def threshold_of(self) -> Literal["paper", "knitlab"]:
        """Whether the threshold is the paper's, or was chosen for knitlab."""
        return "knitlab" if self.statement.knitlab else "paper"

    @property
    def compares_cubes(self) -> bool:
        """Whether its samples may be in several cubes."""
        return "cubes" in inspect.signature(CHECKS[self.statement.test]).parameters

    def check(self, cubes: Sequence[xr.Dataset], factor: float = 1.0) -> CheckResult:
        """Check the claim on cubes at one value of every swept setting.

        Args:
            cubes: the cubes; one, unless it compares cubes.
            factor: factor on the arguments that were chosen for knitlab.
        """
        own = {name: factor * number for name, number in self.statement.knitlab.items()}
        where = cubes if self.compares_cubes else cubes[0]
        try:
            return CHECKS[self.statement.test](where, **{**self.arguments, **own})
        except NotMeasured as error:
            return error.result


def read_claims(path: Path | None = None) -> list[Claim]:
    """The claims of a file, by default ``params/claims.toml``.

    Raises:
        BadInput: with every fault of the file.
    """
    path = path or shipped("params") / CLAIMS
    claims, faults = [], list[Fault]()
    for name, table in read_toml(path).items():
        source = f"{path}: {name}"
        if not isinstance(table, dict):
            faults.append(Fault(source, "is not a table; give each claim one"))
            continue
        stated = {key: value for key, value in table.items() if key in Statement.model_fields}
        rest = {key: value for key, value in table.items() if key not in stated}
        try:
            statement = Statement.model_validate(stated)
            if statement.test not in CHECKS:
                faults.append(Fault(f"{source}: test", unknown(statement.test, CHECKS, "test")))
                continue
            if twice := rest.keys() & statement.knitlab:
                problem = "is the paper's number and knitlab's; keep one"
                faults += [Fault(f"{source}: {name}", problem) for name in sorted(twice)]
                continue
            arguments = _arguments(statement.test).model_validate(rest | statement.knitlab)
        except ValidationError as error:
            faults += faults_of(error, source)
        else:
            claims.append(Claim(name, statement, dict(arguments)))
    if faults:
        raise BadInput(faults)
    return claims


@cache
def _arguments(test: str) -> type[StrictModel]:
    """The arguments of a test besides cubes, as the schema of its keys in a file."""
    _, *parameters = inspect.signature(CHECKS[test]).parameters.values()
    fields: dict[str, Any] = {
        each.name: (each.annotation, ... if each.default is each.empty else each.default)
        for each in parameters
    }
    return create_model(test, __base__=StrictModel, **fields)
