"""Knitting machines of ``params/machine.toml``: beds, carriers, back end, yarns and speeds."""

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

from knitlab.export.knitting.chart import Face
from knitlab.io.errors import Mistake, invalid, pydantic_mistakes, raise_if_any, shown, unknown
from knitlab.io.names import Line
from knitlab.io.shipped import shipped
from knitlab.io.toml import read_toml
from knitlab.model.settings import Unit
from knitlab.runs.yarn import YarnOnMachine

SHARED = ("carriers", "yarns", "stitches", "sections", "time")
"""Tables of the file whose values are the same for all machines."""
NOT_GIVEN = "not given"


def _word(text: str) -> str:
    if not text or any(letter.isspace() or letter in ",;" for letter in text):
        raise ValueError(f"must be one word without ',' and ';', but is {text!r}")
    return text


def _even(count: int) -> int:
    if count % 2:
        raise ValueError(f"must be even, so that the yarn ends on the right, but is {count}")
    return count


Word = Annotated[str, AfterValidator(_word)]
EvenCount = Annotated[NonNegativeInt, AfterValidator(_even)]


@dataclass(frozen=True)
class Machine:
    """A knitting machine and how it is used: the settings of ``machine.toml``."""

    model: Word
    needles: PositiveInt
    needles_per_inch: Annotated[PositiveInt, Unit("1/inch")]
    largest_racking: PositiveInt  # needles by which the back bed moves at most
    carriers: PositiveInt  # count; each is named by its number, from 1
    back_end: Word  # program that turns knitout into the machine's own files
    hooks: bool  # whether an inserting hook brings yarn in; without it carriers come from the left
    listed_carriers: PositiveInt  # length of the list of carriers that the back end takes
    carriers_of_a_stitch: PositiveInt  # that the back end takes at most
    largest_speed_number: PositiveInt
    largest_stitch_number: PositiveInt
    waste_carrier: PositiveInt
    draw_carrier: PositiveInt
    body_carrier: PositiveInt
    electrode_carriers: tuple[PositiveInt, PositiveInt]  # of the conductors of A and B
    plating: Literal["face_first", "reverse_first"]  # yarn that a plated stitch names first
    longest_float: PositiveInt  # needles that a float may pass without a remark
    body_yarn: Line | None  # None in yarns and sizes: not given
    conductive_yarn: Line | None
    waste_yarn: Line
    body_stitch_size: PositiveFloat | None  # in the machine's unit; numbers are rows of its tables
    plated_stitch_size: PositiveFloat | None
    waste_stitch_size: PositiveFloat | None
    body_stitch_number: NonNegativeInt
    plated_stitch_number: NonNegativeInt
    waste_stitch_number: NonNegativeInt
    speed_number: NonNegativeInt  # row of its table, or speed without hooks
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
    def inwards(self) -> int:
        """Direction in which carriers come in: leftwards -1, rightwards 1."""
        return -1 if self.hooks else 1

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

    def names_conductor_first(self, front: bool, face: Face) -> bool:
        """Whether a plated stitch of a bed names its conductor first, to have it on a face."""
        # The face of a front loop is on the front of the fabric.
        return ((face == "front") == front) == (self.plating == "face_first")

    def carrier_of(self, electrode: int) -> int:
        """Carrier of the conductor of an electrode, by its number from 1."""
        return self.electrode_carriers[electrode - 1]


def paper_yarn() -> YarnOnMachine:
    """The yarn of the paper, its stitch sizes, and the machine that they belong to."""
    return YarnOnMachine(**_values(read_toml(shipped("params") / "machine.toml")["paper"]))


def read_machine(
    changes: Mapping[str, Any] | None = None, yarn: YarnOnMachine | None = None
) -> Machine:
    """A machine of ``params/machine.toml`` with changes, set up for a yarn or that of the paper."""
    tables = read_toml(shipped("params") / "machine.toml")
    changes = dict(changes or {})
    paper = paper_yarn()
    yarn = paper if yarn is None else yarn
    asked = str(changes.pop("model", None) or yarn.machine or paper.machine)
    machines = tables["machines"]
    back_ends = tables["back_ends"]
    model = _known("model", asked, machines)
    of_machine = _values(machines[model])
    back_end = _known("back_end", str(changes.get("back_end", of_machine["back_end"])), back_ends)
    of_back_end = _values(back_ends[back_end])
    sizes = yarn if yarn.machine is None or same_model(yarn.machine, model) else YarnOnMachine()
    values: dict[str, Any] = {
        "model": model,
        "body_yarn": yarn.yarn,
        "conductive_yarn": yarn.conductive_yarn,
        "body_stitch_size": sizes.stitch_size,
        "plated_stitch_size": sizes.plated_stitch_size,
        "waste_stitch_size": sizes.stitch_size,
    }
    for table in (*(_values(tables[name]) for name in SHARED), of_machine, of_back_end):
        values |= table
    mistakes = [
        Mistake(f"machine {name}", unknown(name, values, "setting of the machine"))
        for name in changes
        if name not in values
    ]
    mistakes += [
        Mistake(f"machine {name}", f"belongs to {back_end}; choose another by back_end or model")
        for name in changes
        if name in of_back_end
    ]
    try:
        machine = TypeAdapter(Machine).validate_python(values | changes)
        mistakes += _combination_mistakes(machine)
    except ValidationError as error:
        mistakes += [
            Mistake(f"machine {each.path}", each.message) for each in pydantic_mistakes(error, "")
        ]
    raise_if_any(mistakes)
    return machine


def stitch_size_in_words(size: float | None) -> str:
    """A stitch size in machine units, or that none is given."""
    return NOT_GIVEN if size is None else f"{size:g}"


def same_model(one: str, other: str) -> bool:
    """Whether two names of a model are the same."""
    return one.casefold() == other.casefold()


def _values(table: Mapping[str, Any]) -> dict[str, Any]:
    return {key: entry["value"] for key, entry in table.items()}


def _known(kind: str, name: str, table: Mapping[str, Any]) -> str:
    """The name as the table spells it, in any case; InputError with all names if it is missing."""
    for each in table:
        if same_model(each, name):
            return each
    hint = "take one of these, and replace the values in which yours differs"
    raise invalid(f"machine {kind}", f"is {shown(name)}; knitlab knows {', '.join(table)}; {hint}")


def _combination_mistakes(machine: Machine) -> list[Mistake]:
    names = ("waste_carrier", "draw_carrier", "body_carrier")
    count = machine.carriers
    used = {name: getattr(machine, name) for name in names}
    used["electrode A"], used["electrode B"] = machine.electrode_carriers
    mistakes = [
        Mistake(f"machine {name}", f"is carrier {number}, but there are {count}; choose one")
        for name, number in used.items()
        if number > count
    ]
    if len(set(used.values())) < len(used):
        message = f"two of {used} share one carrier; give each its own"
        mistakes.append(Mistake("machine carriers", message))
    limits = {"speed_number": machine.largest_speed_number}
    uses = ("body", "plated", "waste")
    limits |= {f"{use}_stitch_number": machine.largest_stitch_number for use in uses}
    for name, largest in limits.items():
        if (number := getattr(machine, name)) > largest:
            message = f"is {number}, but {machine.back_end} takes 0 to {largest}"
            mistakes.append(Mistake(f"machine {name}", message))
    return mistakes
