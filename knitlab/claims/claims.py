"""Claims: statements of the paper and their tests (``params/claims.toml``)."""

import inspect
from collections.abc import Sequence
from functools import cache
from typing import Any, Literal, get_args

import xarray as xr
from pydantic import Field, create_model

from knitlab.claims.checks import CHECKS
from knitlab.claims.margin import CheckResult, NotMeasured
from knitlab.io.shipped import shipped
from knitlab.io.toml import StrictModel, read_toml

Topic = Literal[
    "stripes", "relaxed shape", "wavelengths", "tension", "Poisson's ratio", "capacitors"
]
TOPICS: tuple[Topic, ...] = get_args(Topic)
RELAXED_TOPICS: tuple[Topic, ...] = ("relaxed shape", "wavelengths")


class Claim(StrictModel):
    """A statement of the paper, and its test in :data:`CHECKS`, with its arguments as fields."""

    name: str
    text: str = Field(min_length=1)
    place: str = Field(min_length=1)
    topic: Topic
    measured_along: Literal["weft", "warp"] | None = None
    figure: str | None = None
    why_not: str | None = Field(default=None, min_length=1)
    test: str
    knitlab: dict[str, float] = Field(default_factory=dict)

    @property
    def arguments(self) -> dict[str, Any]:
        """All arguments of the test besides cubes."""
        names = type(self).model_fields.keys() - Claim.model_fields.keys()
        return {name: getattr(self, name) for name in names}

    @property
    def quoted(self) -> str:
        """The statement, with the direction that is tested here."""
        along = self.measured_along
        return f"{self.text} (here along the {along})" if along else self.text

    @property
    def threshold_of(self) -> Literal["paper", "knitlab"]:
        """Whether the threshold is the paper's, or was chosen for knitlab."""
        return "knitlab" if self.knitlab else "paper"

    @property
    def compares_cubes(self) -> bool:
        """Whether its samples may be in several cubes."""
        return "cubes" in inspect.signature(CHECKS[self.test]).parameters

    def check(self, cubes: Sequence[xr.Dataset], factor: float = 1.0) -> CheckResult:
        """Check cubes, with a factor on the arguments that were chosen for knitlab."""
        scaled = {name: factor * number for name, number in self.knitlab.items()}
        where = cubes if self.compares_cubes else cubes[0]
        try:
            return CHECKS[self.test](where, **self.arguments | scaled)
        except NotMeasured as error:
            return error.result


def read_claims() -> list[Claim]:
    """The claims of ``params/claims.toml``."""
    return [
        _schema(table["test"]).model_validate({"name": name} | table | table.get("knitlab", {}))
        for name, table in read_toml(shipped("params") / "claims.toml").items()
    ]


@cache
def _schema(test: str) -> type[Claim]:
    _, *parameters = inspect.signature(CHECKS[test]).parameters.values()
    fields: dict[str, Any] = {
        each.name: (each.annotation, ... if each.default is each.empty else each.default)
        for each in parameters
    }
    return create_model(test, __base__=Claim, **fields)
