"""Descriptions: the TOML file that describes an experiment: its sample and its records."""

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    Field,
    NonNegativeInt,
    PositiveFloat,
    PositiveInt,
    SerializerFunctionWrapHandler,
    model_serializer,
    model_validator,
)

from knitlab.io.errors import InputError, invalid
from knitlab.io.names import Line
from knitlab.io.table_file import unit_factor
from knitlab.io.table_readings import Choice, Decimal
from knitlab.io.toml import StrictModel, read_checked
from knitlab.lab.tracks.track_file import YAxis
from knitlab.model.stripe import periods_per_patch
from knitlab.observables.schema import SIMULATION
from knitlab.runs.workflow import MAX_STRAIN_STEPS, even_strains

Towards = Literal["right", "left", "up", "down"]
RecordKind = Literal["markers", "tensile", "capacitance"]
UNITS = {"mm": "length", "s": "time", "Hz": "frequency", "N": "force", "pF": "capacitance"}
"""Units that knitlab uses, and what each measures."""
LATER = ("decimal", "table", "first_frame")  # keys that descriptions did not have at first
Text = Annotated[str, Field(min_length=1)]


class _InUnit(StrictModel):
    unit: Text

    def factor(self, target: str) -> float:
        """Factor that converts its unit to one of :data:`UNITS`; ValueError if there is none."""
        try:
            return unit_factor("", self.unit, target, f"of {UNITS[target]}, such as {target}")
        except InputError as error:
            raise ValueError(error.mistakes[0].message) from None


class MeasuredQuantity(_InUnit):
    """A number and its unit."""

    value: float

    def to(self, target: str) -> float:
        """The number in one of :data:`UNITS`."""
        return self.value * self.factor(target)


class PlainColumn(StrictModel):
    """A column of a table, by its header, that needs no unit."""

    column: Text


class Column(PlainColumn, _InUnit):
    """A column of a table, by its header, and its unit."""


def _in(target: str, *, positive: bool = False) -> AfterValidator:
    def checked(stated: Any) -> Any:
        stated.factor(target)
        if positive and not stated.value > 0:
            raise ValueError(f"is {stated.value:g}; give one above 0")
        return stated

    return AfterValidator(checked)


Length = Annotated[MeasuredQuantity, _in("mm", positive=True)]
Time = Annotated[MeasuredQuantity, _in("s")]
TwoCounts = Annotated[tuple[PositiveInt, PositiveInt], Field(strict=False)]  # counts along (y, x)


class SampleTable(StrictModel):
    """``[sample]``: the relaxed fabric between the clamps."""

    n_stripe: PositiveInt
    n_subunit: PositiveInt
    unit_cells: TwoCounts
    length: Length  # between the clamps, relative to which the extension is the strain
    width: Length

    @model_validator(mode="after")
    def _is_a_design(self) -> "SampleTable":
        periods_per_patch(self.n_stripe, self.n_subunit)
        return self


class ProtocolTable(StrictModel):
    """``[protocol]``: the applied strains at which to evaluate the records, from 0 upwards."""

    strain_max: PositiveFloat
    strain_step: PositiveFloat
    # A reversal of the machine by less than this fraction of the full extension is no cycle.
    least_turn: Annotated[float, Field(gt=0, lt=1)] = 0.1
    skip_cycles: NonNegativeInt = 0  # the first ones, in which a sample is conditioned

    @model_validator(mode="after")
    def _is_a_number_of_steps(self) -> "ProtocolTable":
        steps = self.strain_max / self.strain_step
        if abs(steps - round(steps)) > 1e-6 or steps > MAX_STRAIN_STEPS:
            given = f"strain_max = {self.strain_max:g} over strain_step = {self.strain_step:g}"
            raise ValueError(f"{given} is not a whole number up to {MAX_STRAIN_STEPS}; change one")
        return self

    @property
    def applied_strain(self) -> tuple[float, ...]:
        """The strains."""
        return even_strains(self.strain_max, self.strain_step)


class RecordFile(StrictModel):
    """A file of records, and which of its readings is meant if there are several."""

    file: Text
    decimal: Decimal | None = None
    table: PositiveInt | None = None  # of those with the columns

    @property
    def choice(self) -> Choice:
        """What is stated of its reading."""
        return Choice(self.decimal, self.table)

    @model_serializer(mode="wrap")
    def _without_later_keys(self, serialised: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Omit later keys that are not stated, as case identifiers depend on the text."""
        values = serialised(self).items()
        return {key: value for key, value in values if key not in LATER or value is not None}


class TensileTable(RecordFile):
    """``[tensile]``: the log of the machine, whose clock is the reference for all records."""

    time: Annotated[Column, _in("s")]
    extension: Annotated[Column, _in("mm")]
    force: Annotated[Column, _in("N")]
    trigger: PlainColumn | None = None


class CapacitanceTable(RecordFile):
    """``[capacitance]``: the log of an LCR meter, and how its clock is that of the machine."""

    starts: Time | None = None  # the machine's time at which the clock was at 0
    time: Annotated[Column, _in("s")]
    capacitance: Annotated[Column, _in("pF")]
    trigger: PlainColumn | None = None  # or, in both logs, a column that rises at the same moment
    status: PlainColumn | None = None  # 0 for a good reading; by default a column named status

    @model_validator(mode="after")
    def _is_synchronised(self) -> "CapacitanceTable":
        if (self.starts is None) == (self.trigger is None):
            raise ValueError("needs either starts, the machine's time at its own 0, or trigger")
        return self


class MarkersTable(RecordFile):
    """``[markers]``: tracked points, in pixels, x to the right.

    The file has one of the formats in knitlab.lab.tracks.
    """

    starts: Time | None = None  # the machine's time at frame 0
    pixel: Length
    y_axis: YAxis | None = None  # which way y counts in the picture; by default as the format does
    least_confidence: Annotated[float, Field(ge=0, le=1)] = 0.6  # of positions that are believed
    weft: Towards = "right"  # direction of the fabric's x in the picture, to within 30°
    warp: Towards = "up"
    turned: Annotated[float, Field(ge=-180, le=180)] = 0.0  # anticlockwise rotation before it [°]
    align: Literal["pull", "picture"] = "pull"  # whether the pull is then turned along y
    places: str | None = None  # CSV: marker, row, column; by default the grid is detected
    markers_per_cell: TwoCounts = (1, 1)  # along (y, x), if not every marker is a corner
    relaxed_frames: PositiveInt = 1  # first frames, whose mean is the relaxed shape
    frame_rate: Annotated[MeasuredQuantity, _in("Hz", positive=True)] | None = None
    first_frame: NonNegativeInt | None = None  # its number; by default as the format counts
    strain_per_frame: PositiveFloat | None = None  # in place of the machine's strain at its time

    @model_validator(mode="after")
    def _has_axes_and_strains(self) -> "MarkersTable":
        upright, timed = ("up", "down"), self.frame_rate is not None
        if (self.weft in upright) == (self.warp in upright):
            parallel = f"weft = {self.weft} and warp = {self.warp} are parallel"
            raise ValueError(f"{parallel}; give perpendicular directions")
        if timed == (self.strain_per_frame is not None):
            either = "needs either frame_rate with starts, or strain_per_frame"
            raise ValueError(f"{either}, to determine its strains")
        if timed != (self.starts is not None):
            needed = "needs starts, the machine's time at frame 0, with frame_rate"
            unused = "has starts, which strain_per_frame does not use; leave it out"
            raise ValueError(needed if timed else unused)
        return self


class Description(StrictModel):
    """A description: the sample, the applied strains to evaluate, and the records."""

    title: Line
    source: Line = "experiment"  # its name in tables and figures
    synthetic: bool = False  # whether its records were generated
    sample: SampleTable
    protocol: ProtocolTable
    tensile: TensileTable | None = None
    markers: MarkersTable | None = None
    capacitance: CapacitanceTable | None = None

    @model_validator(mode="after")
    def _has_dependencies(self) -> "Description":
        markers, tensile, capacitance = self.markers, self.tensile, self.capacitance
        if self.source == SIMULATION:
            raise ValueError(f"source = {SIMULATION} is reserved; give another name")
        if not tensile and capacitance:
            raise ValueError("[capacitance] needs [tensile], for its strains; add it")
        if not tensile and markers and markers.frame_rate:
            raise ValueError("[markers] with frame_rate needs [tensile], for its strains; add it")
        if tensile and not tensile.trigger and capacitance and capacitance.trigger:
            raise ValueError("[capacitance] has a trigger, so [tensile] needs one; add it")
        return self


def read_description(path: Path, kind: RecordKind) -> Description:
    """Read a description that lists records of a kind."""
    description = read_checked(Description, path)
    if getattr(description, kind) is None:
        raise invalid(f"{path}: {kind}", "is missing; add a table that names its file")
    return description
