"""The knitting machine of ``params/machine.toml``: beds, carriers, stitch numbers and speeds."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    Field,
    NonNegativeInt,
    PositiveFloat,
    PositiveInt,
    TypeAdapter,
    ValidationError,
)

from knitlab.fabric.setting_types import Unit
from knitlab.io.errors import BadInput, Fault, faults_of, unknown
from knitlab.io.shipped import shipped
from knitlab.io.toml import StrictModel, read_checked
from knitlab.sweep.declared_fields import ParameterValue, declared, entries, with_fields

MILLIMETRES_PER_INCH = 25.4
FILE = "machine.toml"


def _word(text: str) -> str:
    if not text or any(letter.isspace() or letter in ",;" for letter in text):
        raise ValueError(f"is one word without ',' and ';', but is {text!r}")
    return text


def _even(count: int) -> int:
    if count % 2:
        raise ValueError(f"is an even number, so that its yarn ends on the right, but is {count}")
    return count


Word = Annotated[str, AfterValidator(_word)]
EvenCount = Annotated[NonNegativeInt, AfterValidator(_even)]
StitchNumber = Annotated[int, Field(ge=0, le=100)]


@dataclass(frozen=True)
class Bed:
    """The needle beds.

    Attributes:
        model: the machine's name.
        needles: on each bed.
        needles_per_inch: gauge [1/inch].
        largest_racking: needles by which the back bed moves at most.
    """

    model: Word
    needles: PositiveInt
    needles_per_inch: Annotated[PositiveInt, Unit("1/inch")]
    largest_racking: PositiveInt


@dataclass(frozen=True)
class Carriers:
    """Which yarn carrier does what.

    Attributes:
        carriers: carriers that there are.
        waste_carrier, draw_carrier, body_carrier: numbers of the carriers of waste, draw thread and
            body.
        electrode_carriers: those of the conductors of electrodes A and B.
        plating: whether a plated stitch names the carrier of the yarn on the face of its loop
            first, or that on its reverse.
        longest_float: needles that a float may pass without a remark.
    """

    carriers: PositiveInt
    waste_carrier: PositiveInt
    draw_carrier: PositiveInt
    body_carrier: PositiveInt
    electrode_carriers: tuple[PositiveInt, PositiveInt]
    plating: Literal["face_first", "reverse_first"]
    longest_float: PositiveInt


@dataclass(frozen=True)
class Yarns:
    """What the carriers are threaded with.

    Attributes:
        body_yarn, conductive_yarn, waste_yarn: names of the yarns.
    """

    body_yarn: Word
    conductive_yarn: Word
    waste_yarn: Word


@dataclass(frozen=True)
class MachineStitches:
    """Stitch sizes, and the rows of the machine's table that hold them.

    Attributes:
        body_stitch_size, plated_stitch_size, waste_stitch_size: sizes in the machine's unit.
        body_stitch_number, plated_stitch_number, waste_stitch_number: rows of its stitch table.
        speed_number: row of its speed table.
    """

    body_stitch_size: PositiveInt
    plated_stitch_size: PositiveInt
    waste_stitch_size: PositiveInt
    body_stitch_number: StitchNumber
    plated_stitch_number: StitchNumber
    waste_stitch_number: StitchNumber
    speed_number: Annotated[int, Field(ge=0, le=15)]


@dataclass(frozen=True)
class Sections:
    """What is knitted before and after the chart.

    Attributes:
        waste_courses: of the waste section at the beginning, and at the end of a dropped one.
        setup_courses: plain courses between the cast-on and the chart.
        end: how the last course ends.
        bind_off_tail: stitches on the last needle of a bind-off.
    """

    waste_courses: EvenCount
    setup_courses: EvenCount
    end: Literal["bind_off", "drop"]
    bind_off_tail: PositiveInt


@dataclass(frozen=True)
class MachineTime:
    """What the time of a sample is estimated from.

    Attributes:
        knitting_speed, transfer_speed: of the carriage [m/s].
        turn_time: to turn the carriage [s].
        racking_time: to move the back bed [s].
        carrier_time: to bring a carrier in or out [s].
    """

    knitting_speed: Annotated[PositiveFloat, Unit("m/s")]
    transfer_speed: Annotated[PositiveFloat, Unit("m/s")]
    turn_time: Annotated[PositiveFloat, Unit("s")]
    racking_time: Annotated[PositiveFloat, Unit("s")]
    carrier_time: Annotated[PositiveFloat, Unit("s")]


@dataclass(frozen=True)
class Machine:
    """A knitting machine and how it is used.

    Attributes:
        bed: its needle beds.
        carriers: its carriers.
        yarns: its yarns.
        stitches: its stitch sizes.
        sections: what is knitted around a chart.
        time: its speeds.
    """

    bed: Bed
    carriers: Carriers
    yarns: Yarns
    stitches: MachineStitches
    sections: Sections
    time: MachineTime

    def __repr__(self) -> str:
        counts = f"{self.bed.needles} needles, {self.carriers.carriers} carriers"
        return f"<Machine {self.bed.model}: {counts}>"

    @property
    def pitch(self) -> float:
        """Distance of two needles [mm]."""
        return MILLIMETRES_PER_INCH / self.bed.needles_per_inch

    def carrier_of(self, electrode: int) -> int:
        """Carrier of the conductor of an electrode, by its number from 1."""
        return self.carriers.electrode_carriers[electrode - 1]


TABLES: dict[str, type] = {
    "bed": Bed,
    "carriers": Carriers,
    "yarns": Yarns,
    "stitches": MachineStitches,
    "sections": Sections,
    "time": MachineTime,
}
"""The tables of ``machine.toml``."""


def _schema(name: str, table: type) -> tuple[type[StrictModel], Any]:
    schema = type(name, (StrictModel,), {"__doc__": table.__doc__, "__module__": __name__})
    return with_fields(entries(declared(table)))(schema), ...


@with_fields({name: _schema(name, table) for name, table in TABLES.items()})
class MachineFile(StrictModel):
    """``machine.toml``."""


def read_machine(changes: Mapping[str, Any] | None = None, folder: Path | None = None) -> Machine:
    """The machine of a parameter folder.

    Args:
        changes: values that replace those of the file, by their names.
        folder: where ``machine.toml`` lies; by default knitlab's own.

    Raises:
        BadInput: with everything that is wrong in the file and in the changes.

    Example:
        >>> read_machine({"end": "drop"}).sections.end
        'drop'
    """
    path = (folder or shipped("params")) / FILE
    read: Any = read_checked(MachineFile, path, "machine")
    values: dict[str, Any] = {}
    for name in TABLES:
        for key, entry in getattr(read, name):
            if isinstance(entry, ParameterValue):
                values[key] = entry.value
    changes = changes or {}
    faults = [
        Fault(f"machine {name}", unknown(name, values, "setting of the machine"))
        for name in changes
        if name not in values
    ]
    faults += _faults({**values, **{k: v for k, v in changes.items() if k in values}})
    if faults:
        raise BadInput(faults)
    values |= changes
    values["electrode_carriers"] = tuple(values["electrode_carriers"])
    made = {
        name: table(**{field.name: values[field.name] for field in fields(table)})
        for name, table in TABLES.items()
    }
    return Machine(**made)


def _faults(values: Mapping[str, Any]) -> list[Fault]:
    found: list[Fault] = []
    for table in TABLES.values():
        for name, kind in declared(table).items():
            try:
                TypeAdapter(kind).validate_python(values[name])
            except ValidationError as error:
                found += faults_of(error, f"machine {name}")
    if found:
        return found
    used = {
        name: values[name] for name in ("waste_carrier", "draw_carrier", "body_carrier")
    } | dict(zip(("electrode A", "electrode B"), values["electrode_carriers"], strict=True))
    for name, number in used.items():
        if number > values["carriers"]:
            problem = f"is carrier {number}, and there are {values['carriers']}; name one of these"
            found.append(Fault(f"machine {name}", problem))
    if len(set(used.values())) < len(used):
        problem = f"two of {used} are one carrier; give each its own"
        found.append(Fault("machine carriers", problem))
    return found
