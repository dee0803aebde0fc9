"""The knitting machine of ``params/machine.toml``: beds, carriers, stitch numbers and speeds."""

from collections.abc import Mapping
from dataclasses import dataclass
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

from knitlab.fabric.settings import Unit
from knitlab.io.errors import BadInput, Fault, faults_of, unknown
from knitlab.io.shipped import shipped
from knitlab.io.toml import StrictModel, read_checked
from knitlab.sweep.declared_fields import declared, entries, with_fields

MILLIMETRES_PER_INCH = 25.4


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
    """The two needle beds; the back bed moves by at most ``largest_racking`` needles."""

    model: Word
    needles: PositiveInt
    needles_per_inch: Annotated[PositiveInt, Unit("1/inch")]
    largest_racking: PositiveInt


@dataclass(frozen=True)
class Carriers:
    """The count of yarn carriers, and the number of each that is used, from 1.

    ``electrode_carriers`` are those of the conductors of electrodes A and B. ``plating`` is whether
    a plated stitch names the carrier of the yarn on the face of its loop first, or that on its
    reverse. A float past more than ``longest_float`` needles has a remark.
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
    """Names of the yarns that the carriers are threaded with."""

    body_yarn: Word
    conductive_yarn: Word
    waste_yarn: Word


@dataclass(frozen=True)
class MachineStitches:
    """Stitch sizes in the machine's unit, and the rows of its stitch and speed tables."""

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

    ``waste_courses`` are knitted at the beginning, and at the end of a dropped sample;
    ``setup_courses``, plain, between the cast-on and the chart; ``bind_off_tail`` is the number of
    stitches on the last needle of a bind-off.
    """

    waste_courses: EvenCount
    setup_courses: EvenCount
    end: Literal["bind_off", "drop"]
    bind_off_tail: PositiveInt


@dataclass(frozen=True)
class MachineTime:
    """Speeds of the carriage, and times to turn it, to rack, and to move a carrier in or out."""

    knitting_speed: Annotated[PositiveFloat, Unit("m/s")]
    transfer_speed: Annotated[PositiveFloat, Unit("m/s")]
    turn_time: Annotated[PositiveFloat, Unit("s")]
    racking_time: Annotated[PositiveFloat, Unit("s")]
    carrier_time: Annotated[PositiveFloat, Unit("s")]


@dataclass(frozen=True)
class Machine:
    """A knitting machine and how it is used; its fields are the tables of ``machine.toml``."""

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


TABLES = declared(Machine)
MACHINE_FILE = with_fields(
    {name: (with_fields(entries(declared(TABLES[name])))(StrictModel), ...) for name in TABLES}
)(StrictModel)
"""Schema of ``machine.toml``."""


def read_machine(changes: Mapping[str, Any] | None = None, folder: Path | None = None) -> Machine:
    """The machine of a parameter folder, by default knitlab's own, with some values changed.

    Raises:
        BadInput: with everything that is wrong in the file and in the changes.

    Example:
        >>> read_machine({"end": "drop"}).sections.end
        'drop'
    """
    file = read_checked(MACHINE_FILE, (folder or shipped("params")) / "machine.toml", "machine")
    values = {key: entry.value for name in TABLES for key, entry in getattr(file, name)}
    faults = []
    for name, value in (changes or {}).items():
        if name in values:
            values[name] = value
        else:
            faults.append(Fault(f"machine {name}", unknown(name, values, "setting of the machine")))
    tables = {name: {key: values[key] for key in declared(table)} for name, table in TABLES.items()}
    try:
        machine = TypeAdapter(Machine).validate_python(tables)
        faults += _carrier_faults(machine.carriers)
    except ValidationError as error:
        for each in faults_of(error, ""):
            faults.append(Fault(f"machine {each.path.partition('.')[2]}", each.problem))
    if faults:
        raise BadInput(faults)
    return machine


def _carrier_faults(carriers: Carriers) -> list[Fault]:
    electrodes = zip(("electrode A", "electrode B"), carriers.electrode_carriers, strict=True)
    names = ("waste_carrier", "draw_carrier", "body_carrier")
    used = {name: getattr(carriers, name) for name in names} | dict(electrodes)
    count = carriers.carriers
    faults = [
        Fault(f"machine {name}", f"is carrier {number}, and there are {count}; name one of these")
        for name, number in used.items()
        if number > count
    ]
    if len(set(used.values())) < len(used):
        faults.append(
            Fault("machine carriers", f"two of {used} are one carrier; give each its own")
        )
    return faults
