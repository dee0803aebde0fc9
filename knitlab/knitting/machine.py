"""The knitting machine of ``params/machine.toml``: beds, carriers, stitch numbers and speeds."""

from collections.abc import Mapping
from dataclasses import dataclass
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
from knitlab.io.errors import Fault, faults_of, raise_any, unknown
from knitlab.io.shipped import shipped
from knitlab.io.toml import read_toml

MOST_SPEEDS = 15  # rows of the table of speeds of a machine with hooks
OTHER_MODEL = "Kniterate"  # a table of what differs, taken when model is its name


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
class Machine:
    """A knitting machine and how it is used: the settings of ``machine.toml``."""

    model: Word
    needles: PositiveInt
    needles_per_inch: Annotated[PositiveInt, Unit("1/inch")]
    largest_racking: PositiveInt  # needles by which the back bed moves at most
    carriers: PositiveInt  # count; each is named by its number, from 1
    hooks: bool  # whether an inserting hook brings yarn in; without it carriers come from the left
    waste_carrier: PositiveInt
    draw_carrier: PositiveInt
    body_carrier: PositiveInt
    electrode_carriers: tuple[PositiveInt, PositiveInt]  # of the conductors of A and B
    plating: Literal["face_first", "reverse_first"]  # yarn that a plated stitch names first
    longest_float: PositiveInt  # needles that a float may pass without a remark
    body_yarn: Word
    conductive_yarn: Word
    waste_yarn: Word
    body_stitch_size: PositiveInt  # sizes in the machine's unit; numbers are rows of its tables
    plated_stitch_size: PositiveInt
    waste_stitch_size: PositiveInt
    body_stitch_number: StitchNumber
    plated_stitch_number: StitchNumber
    waste_stitch_number: StitchNumber
    speed_number: Annotated[int, Field(ge=0, le=600)]  # row of its table, or speed without hooks
    waste_courses: EvenCount  # at the beginning, and at the end of a dropped sample
    setup_courses: Annotated[EvenCount, Field(ge=2)]  # plain, between the cast-on and the chart
    end: Literal["bind_off", "drop"]
    bind_off_tail: PositiveInt  # stitches on the last needle of a bind-off
    knitting_speed: Annotated[PositiveFloat, Unit("m/s")]
    transfer_speed: Annotated[PositiveFloat, Unit("m/s")]
    turn_time: Annotated[PositiveFloat, Unit("s")]
    racking_time: Annotated[PositiveFloat, Unit("s")]
    carrier_time: Annotated[PositiveFloat, Unit("s")]  # to move a carrier in or out

    def __repr__(self) -> str:
        return f"<Machine {self.model}: {self.needles} needles>"

    @property
    def back_end(self) -> str:
        """The program that turns knitout into the machine's own files."""
        return "knitout-to-dat.js" if self.hooks else "knitout-to-kcode.js"

    @property
    def bring_in(self) -> str:
        """Operation that brings a carrier in."""
        return "inhook" if self.hooks else "in"

    @property
    def bring_out(self) -> str:
        """Operation that takes a carrier out."""
        return "outhook" if self.hooks else "out"

    @property
    def pitch(self) -> float:
        """Distance of two needles [mm]."""
        return 25.4 / self.needles_per_inch

    def carrier_of(self, electrode: int) -> int:
        """Carrier of the conductor of an electrode, by its number from 1."""
        return self.electrode_carriers[electrode - 1]


def read_machine(changes: Mapping[str, Any] | None = None) -> Machine:
    """The machine of ``params/machine.toml``; BadInput with everything wrong in the changes.

    A ``model`` of ``OTHER_MODEL`` stands for all values of its table.
    """
    tables, changes = read_toml(shipped("params") / "machine.toml"), dict(changes or {})
    if str(changes.get("model")).casefold() == OTHER_MODEL.casefold():
        del changes["model"]
    else:
        del tables[OTHER_MODEL]
    values = {key: entry["value"] for table in tables.values() for key, entry in table.items()}
    faults = [
        Fault(f"machine {name}", unknown(name, values, "setting of the machine"))
        for name in changes
        if name not in values
    ]
    try:
        machine = TypeAdapter(Machine).validate_python(values | changes)
        faults += _combination_faults(machine)
    except ValidationError as error:
        faults += [Fault(f"machine {each.path}", each.problem) for each in faults_of(error, "")]
    raise_any(faults)
    return machine


def _combination_faults(machine: Machine) -> list[Fault]:
    names, count = ("waste_carrier", "draw_carrier", "body_carrier"), machine.carriers
    used = {name: getattr(machine, name) for name in names}
    used["electrode A"], used["electrode B"] = machine.electrode_carriers
    faults = [
        Fault(f"machine {name}", f"is carrier {number}, and there are {count}; name one of these")
        for name, number in used.items()
        if number > count
    ]
    if len(set(used.values())) < len(used):
        problem = f"two of {used} are one carrier; give each its own"
        faults.append(Fault("machine carriers", problem))
    if machine.hooks and machine.speed_number > MOST_SPEEDS:
        problem = f"is {machine.speed_number}, and the table has rows 0 to {MOST_SPEEDS}"
        faults.append(Fault("machine speed_number", f"{problem}; name one of these"))
    for name in ("body", "plated", "waste"):
        if not machine.hooks and (number := getattr(machine, f"{name}_stitch_number")) > 9:
            problem = f"is {number}, and {machine.back_end} takes one digit; give 0 to 9"
            faults.append(Fault(f"machine {name}_stitch_number", problem))
    return faults
