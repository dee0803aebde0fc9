"""Parameters: what ``params/*.toml`` may hold, each value with its unit and source."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Generic, Literal, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    Field,
    NonNegativeFloat,
    PositiveFloat,
    PositiveInt,
    RootModel,
    ValidationError,
)

from knitlab.io.errors import BadInput, Fault, Gathered, faults_of
from knitlab.io.strict_model import Strict
from knitlab.io.toml import read_toml
from knitlab.mechanics.dynamics import Ending
from knitlab.mechanics.solver import Start
from knitlab.model.electrode_layout import Face, Within
from knitlab.model.electrodes import Along
from knitlab.model.options import (
    Boundary,
    CellSize,
    FoldAngle,
    FoldPhase,
    GarterStart,
    Hinges,
    HingeStiffness,
)
from knitlab.model.stripe import (
    GARTER_STITCHES_PER_RIB_STITCH,
    Knit,
    Stripe,
    periods_per_patch,
)

Value = TypeVar("Value")
Unit = TypeVar("Unit")
Fraction = Annotated[float, Field(gt=0, le=1)]
Snapshots = Annotated[int, Field(ge=2, le=1000)]
Share = Annotated[float, Field(ge=0, le=1)]
Relative = Annotated[float, Field(ge=1)]
Angle = Annotated[float, Field(gt=0, lt=3.141592653589793)]


class Quantity(Strict, Generic[Value, Unit]):
    """A value with the unit that it must have, and where it comes from."""

    value: Value
    unit: Unit
    source: str = Field(min_length=1)


class StripeUnits(Strict):
    """Units of a stripe table."""

    period: Literal["mm"]
    k_s: Literal["N/mm"]
    theta_0: Literal["rad"]
    k_t: Literal["N"]


class StripeRow(Strict):
    """Fitted values of one stripe (paper, Tables 1 and 2)."""

    period: PositiveFloat
    k_s: PositiveFloat
    theta_0: Angle
    k_t: PositiveFloat


def _stitches(text: str) -> str:
    if not (text.isascii() and text.isdigit() and int(text) > 0):
        raise ValueError(f"a stripe is named by its number of stitches, but is {text!r}")
    return text


def _drawing(rows: tuple[str, ...]) -> tuple[str, ...]:
    if len({len(row) for row in rows}) > 1 or "" in rows:
        raise ValueError("a mask is a rectangle of letters; give rows of equal length")
    if strangers := sorted(set("".join(rows).upper()) - set("AB.")):
        raise ValueError(f"a mask holds A, B and '.', not {', '.join(strangers)}")
    return rows


class StripeTable(Strict):
    """All stripes of one knit, by stitches across a stripe."""

    source: str = Field(min_length=1)
    unit: StripeUnits
    n: dict[Annotated[str, AfterValidator(_stitches)], StripeRow] = Field(min_length=1)


class Stripes(Strict):
    """``stripes.toml``."""

    rib: StripeTable
    garter: StripeTable

    def table(self, knit: Knit) -> StripeTable:
        """The stripes of one knit."""
        return self.rib if knit == "rib" else self.garter

    def stripe(self, knit: Knit, stitches: int) -> Stripe:
        """One stripe that there is."""
        return Stripe(knit=knit, n=stitches, **self.table(knit).n[str(stitches)].model_dump())


class StripeFile(Strict):
    """Stripes that a user adds or replaces, as ``knitlab calibrate`` writes them."""

    rib: StripeTable | None = None
    garter: StripeTable | None = None

    def over(self, stripes: Stripes) -> Stripes:
        """The stripes, with those of this file added or replaced."""
        tables = {}
        for knit, table in (("rib", stripes.rib), ("garter", stripes.garter)):
            own: StripeTable | None = getattr(self, knit)
            tables[knit] = table if own is None else own.model_copy(update={"n": table.n | own.n})
        return Stripes(**tables)


class SheetParameters(Strict):
    """``sheet.toml``: walls, mass and damping."""

    z_max: Quantity[PositiveFloat, Literal["mm"]]
    k_wall: Quantity[PositiveFloat, Literal["N/mm"]]
    surface_density: Quantity[PositiveFloat, Literal["g/mm^2"]]
    damping: Quantity[PositiveFloat, Literal["g/ms"]]


class ReadingParameters(Strict):
    """``reading.toml``: what the paper leaves open."""

    cell_size: Quantity[CellSize, Literal["1"]]
    fold_phase: Quantity[FoldPhase, Literal["1"]]
    hinges: Quantity[Hinges, Literal["1"]]
    hinge_stiffness: Quantity[HingeStiffness, Literal["1"]]
    garter_start: Quantity[GarterStart, Literal["1"]]
    fold_angle: Quantity[FoldAngle, Literal["1"]]
    length_scale: Quantity[PositiveFloat, Literal["1"]]
    boundary: Quantity[Boundary, Literal["1"]]


class SolverParameters(Strict):
    """``solver.toml``: how equilibria are searched for."""

    tolerance: Quantity[PositiveFloat, Literal["N"]]
    max_iterations: Quantity[PositiveInt, Literal["1"]]
    step_limit: Quantity[Fraction, Literal["1"]]
    smallest_shift: Quantity[PositiveFloat, Literal["N/mm"]]
    start: Quantity[Start, Literal["1"]]
    ramp_steps: Quantity[PositiveInt, Literal["1"]]
    waypoint_force: Quantity[Fraction, Literal["1"]]
    path_step: Quantity[Fraction, Literal["1"]]
    smallest_step: Quantity[Fraction, Literal["1"]]
    soft_wall: Quantity[Fraction, Literal["1"]]
    branch_limit: Quantity[PositiveFloat, Literal["1"]]
    drag: Quantity[NonNegativeFloat, Literal["N/mm"]]


class DynamicsParameters(Strict):
    """``dynamics.toml``: how motion is integrated."""

    ending: Quantity[Ending, Literal["1"]]
    steady_force: Quantity[PositiveFloat, Literal["N"]]
    fixed_steps_force: Quantity[PositiveFloat, Literal["N"]]
    duration: Quantity[PositiveFloat, Literal["ms"]]
    max_steps: Quantity[PositiveInt, Literal["1"]]
    relative_tolerance: Quantity[Fraction, Literal["1"]]
    absolute_tolerance: Quantity[PositiveFloat, Literal["1"]]
    fixed_steps: Quantity[PositiveInt, Literal["1"]]
    time_step: Quantity[PositiveFloat, Literal["ms"]]
    ramp_rate: Quantity[PositiveFloat, Literal["1/ms"]]
    haste_limit: Quantity[PositiveFloat, Literal["1"]]
    smallest_rate: Quantity[Fraction, Literal["1"]]
    snapshots: Quantity[Snapshots, Literal["1"]]


Mask = Annotated[tuple[str, ...], Field(strict=False), AfterValidator(_drawing)]
"""A drawing of the chart, one letter a grid cell."""


class LayoutRow(Strict):
    """A layout of electrodes, see :class:`~knitlab.model.electrode_layout.Layout`."""

    source: str = Field(min_length=1)
    along: Along = "wale"
    ridges: Annotated[tuple[PositiveInt, PositiveInt], Field(strict=False)] = (1, 2)
    face: Face = "front"
    within: Within = "patch"
    width: PositiveFloat | Literal["stripe"] = "stripe"
    span: Annotated[tuple[Share, Share], Field(strict=False)] = (0.0, 1.0)
    mask: Mask = ()


class ElectrodeParameters(Strict):
    """``electrodes.toml``: layouts of electrodes, and what their capacitance hangs on."""

    permittivity: Quantity[Relative, Literal["1"]]
    electrode_length: Quantity[PositiveFloat, Literal["mm"]]
    clearance: Quantity[PositiveFloat, Literal["mm"]]
    accuracy: Quantity[Fraction, Literal["1"]]
    linearity: Quantity[Fraction, Literal["1"]]
    unfolded: Quantity[Fraction, Literal["1"]]
    layouts: dict[str, LayoutRow]


class GaugeParameters(Strict):
    """``gauge.toml``: how large a stitch is in cloth."""

    stitch_width: Quantity[PositiveFloat, Literal["mm"]]
    stitch_height: Quantity[PositiveFloat, Literal["mm"]]


class DesignGrid(Strict):
    """Every combination of the listed values."""

    n_stripe: tuple[PositiveInt, ...] = Field(min_length=1, strict=False)
    n_subunit: tuple[PositiveInt, ...] = Field(min_length=1, strict=False)


class DesignSet(Strict):
    """A named set of designs: several grids, each of which must be possible as a whole."""

    unit: Literal["stitches"]
    source: str = Field(min_length=1)
    designs: tuple[DesignGrid, ...] = Field(min_length=1, strict=False)

    @property
    def pairs(self) -> tuple[tuple[int, int], ...]:
        """Its (n_stripe, n_subunit), in order."""
        return tuple((n, m) for grid in self.designs for n in grid.n_stripe for m in grid.n_subunit)


class DesignSets(RootModel[dict[str, DesignSet]]):
    """``designs.toml``."""


@dataclass(frozen=True)
class Parameters:
    """Everything under ``params/``, one field a file."""

    stripes: Stripes
    sheet: SheetParameters
    reading: ReadingParameters
    solver: SolverParameters
    dynamics: DynamicsParameters
    electrodes: ElectrodeParameters
    gauge: GaugeParameters
    designs: DesignSets

    def having(self, stripes: Stripes) -> "Parameters":
        """These parameters with other stripes."""
        return replace(self, stripes=stripes)

    def impossible(self, n_stripe: int, n_subunit: int) -> str | None:
        """Why a design cannot be made of these stripes, or None if it can."""
        tables = self.stripes.rib, self.stripes.garter
        ribs, garters = (sorted(map(int, table.n)) for table in tables)
        pairing = [n for n in ribs if GARTER_STITCHES_PER_RIB_STITCH * n in garters]
        if n_stripe not in pairing:
            garter = f"garter stripe of {GARTER_STITCHES_PER_RIB_STITCH * n_stripe} to pair with"
            missing = garter if n_stripe in ribs else "rib stripe"
            return f"n_stripe = {n_stripe} has no {missing}; choose of {pairing}"
        try:
            periods_per_patch(n_stripe, n_subunit)
        except ValueError as error:
            return str(error)
        return None


def read_stripe_file(path: Path, source: str) -> StripeFile:
    """Read a file of stripes.

    Args:
        path: the file.
        source: what named it, for a fault.

    Raises:
        BadInput: with every fault of the file.
    """
    try:
        return StripeFile.model_validate(read_toml(path))
    except ValidationError as error:
        raise BadInput(faults_of(error, f"{source}: {path}")) from error


def read_parameters(folder: Path) -> Parameters:
    """Read and check every file of a parameter folder.

    Raises:
        BadInput: with every fault of every file, each with its path.
    """
    files: dict[str, type[BaseModel]] = {
        "stripes": Stripes,
        "sheet": SheetParameters,
        "reading": ReadingParameters,
        "solver": SolverParameters,
        "dynamics": DynamicsParameters,
        "electrodes": ElectrodeParameters,
        "gauge": GaugeParameters,
        "designs": DesignSets,
    }
    faults = Gathered()
    read: dict[str, Any] = {}
    for name, schema in files.items():
        path = folder / f"{name}.toml"
        with faults:
            try:
                read[name] = schema.model_validate(read_toml(path))
            except ValidationError as error:
                raise BadInput(faults_of(error, str(path))) from error
    if "stripes" in read and "designs" in read:
        # Sets can be checked against the stripes even if another file is at fault.
        parameters = Parameters(**{**dict.fromkeys(files), **read})
        faults.all += [
            Fault(f"{folder / 'designs.toml'}: {name}", problem)
            for name, members in parameters.designs.root.items()
            for pair in members.pairs
            if (problem := parameters.impossible(*pair))
        ]
    if faults.all:
        raise BadInput(faults.all)
    return parameters
