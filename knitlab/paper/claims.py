"""Claims: what the paper says, and its tests (``params/claims.toml``)."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, get_args

from pydantic import Field, TypeAdapter, ValidationError

from knitlab.io.errors import BadInput, Fault, faults_of
from knitlab.io.shipped import shipped
from knitlab.io.strict_model import StrictModel
from knitlab.io.toml import read_toml
from knitlab.paper.checks import (
    CurveWithin,
    Follows,
    Laboratory,
    LargestAtCentre,
    LessThan,
    RisesAndFalls,
    ValueWithin,
)
from knitlab.paper.line_checks import CommonSlope, DepartsMost, Linear
from knitlab.paper.order_checks import LowestOfAll, Monotonic, Spread
from knitlab.paper.sample_checks import SampleOrder, TradesOff
from knitlab.paper.stripe_checks import SameCurves, StripeOrder, StripeToe

CLAIMS = "claims.toml"
Test = Annotated[
    CommonSlope
    | CurveWithin
    | DepartsMost
    | Follows
    | Laboratory
    | LargestAtCentre
    | LessThan
    | Linear
    | LowestOfAll
    | Monotonic
    | RisesAndFalls
    | SameCurves
    | SampleOrder
    | Spread
    | StripeOrder
    | StripeToe
    | TradesOff
    | ValueWithin,
    Field(discriminator="test"),
]
_TESTS: TypeAdapter[Test] = TypeAdapter(Test)
Topic = Literal[
    "stripes", "relaxed shape", "wavelengths", "tension", "Poisson's ratio", "capacitors"
]
TOPICS: tuple[Topic, ...] = get_args(Topic)


class ClaimText(StrictModel):
    """What stands beside the test of a claim.

    Attributes:
        text: what the paper says.
        place: where it says so.
        topic: what it is about.
        measured_along: direction that is measured here, if the paper's words are about both.
        figure: kind of figure that shows it, if any.
        why_not: why knitlab does not show what the paper says, as far as it is known.
    """

    text: str = Field(min_length=1)
    place: str = Field(min_length=1)
    topic: Topic
    measured_along: Literal["weft", "warp"] | None = None
    figure: str | None = None
    why_not: str | None = Field(default=None, min_length=1)

    @property
    def statement(self) -> str:
        """The paper's words, and the direction that is measured here."""
        along = self.measured_along
        return f"{self.text} (here along the {along})" if along else self.text


@dataclass(frozen=True)
class Claim:
    """A statement of the paper and its test."""

    name: str
    words: ClaimText
    test: Test


def read_claims(path: Path | None = None) -> list[Claim]:
    """The claims of a file, by default of knitlab's own.

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
        words = {key: value for key, value in table.items() if key in ClaimText.model_fields}
        rest = {key: value for key, value in table.items() if key not in words}
        try:
            claims.append(
                Claim(name, ClaimText.model_validate(words), _TESTS.validate_python(rest))
            )
        except ValidationError as error:
            faults += faults_of(error, source)
    if faults:
        raise BadInput(faults)
    return claims
