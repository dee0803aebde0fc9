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

from knitlab.io.errors import BadInput, ErrorCollector, Fault, faults_of
from knitlab.io.strict_model import StrictModel
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


class ParameterValue(StrictModel, Generic[Value, Unit]):
    """A value with the unit that it must have, and where it comes from."""

    value: Value
    unit: Unit
    source: str = Field(min_length=1)


class StripeUnits(StrictModel):
    """Units of a stripe table."""

    period: Literal["mm"]
    k_s: Literal["N/mm"]
    theta_0: Literal["rad"]
    k_t: Literal["N"]


class StripeRow(StrictModel):
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


class StripeTable(StrictModel):
    """All stripes of one knit, by stitches across a stripe."""

    source: str = Field(min_length=1)
    unit: StripeUnits
    n: dict[Annotated[str, AfterValidator(_stitches)], StripeRow] = Field(min_length=1)


class Stripes(StrictModel):
    """``stripes.toml``."""

    rib: StripeTable
    garter: StripeTable

    def table(self, knit: Knit) -> StripeTable:
        """The stripes of one knit."""
        return self.rib if knit == "rib" else self.garter

    def stripe(self, knit: Knit, stitches: int) -> Stripe:
        """One stripe that there is."""
        return Stripe(knit=knit, n=stitches, **self.table(knit).n[str(stitches)].model_dump())


class StripeFile(StrictModel):
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


class SheetParameters(StrictModel):
    """``sheet.toml``: walls, mass and damping."""

    z_max: ParameterValue[PositiveFloat, Literal["mm"]]
    k_wall: ParameterValue[PositiveFloat, Literal["N/mm"]]
    surface_density: ParameterValue[PositiveFloat, Literal["g/mm^2"]]
    damping: ParameterValue[PositiveFloat, Literal["g/ms"]]


class ModelOptionParameters(StrictModel):
    """``reading.toml``: what the paper leaves open."""

    cell_size: ParameterValue[CellSize, Literal["1"]]
    fold_phase: ParameterValue[FoldPhase, Literal["1"]]
    hinges: ParameterValue[Hinges, Literal["1"]]
    hinge_stiffness: ParameterValue[HingeStiffness, Literal["1"]]
    garter_start: ParameterValue[GarterStart, Literal["1"]]
    fold_angle: ParameterValue[FoldAngle, Literal["1"]]
    length_scale: ParameterValue[PositiveFloat, Literal["1"]]
    boundary: ParameterValue[Boundary, Literal["1"]]


class SolverParameters(StrictModel):
    """``solver.toml``: how equilibria are searched for."""

    tolerance: ParameterValue[PositiveFloat, Literal["N"]]
    max_iterations: ParameterValue[PositiveInt, Literal["1"]]
    step_limit: ParameterValue[Fraction, Literal["1"]]
    smallest_shift: ParameterValue[PositiveFloat, Literal["N/mm"]]
    start: ParameterValue[Start, Literal["1"]]
    ramp_steps: ParameterValue[PositiveInt, Literal["1"]]
    waypoint_force: ParameterValue[Fraction, Literal["1"]]
    path_step: ParameterValue[Fraction, Literal["1"]]
    smallest_step: ParameterValue[Fraction, Literal["1"]]
    soft_wall: ParameterValue[Fraction, Literal["1"]]
    branch_limit: ParameterValue[PositiveFloat, Literal["1"]]
    drag: ParameterValue[NonNegativeFloat, Literal["N/mm"]]


class DynamicsParameters(StrictModel):
    """``dynamics.toml``: how motion is integrated."""

    ending: ParameterValue[Ending, Literal["1"]]
    steady_force: ParameterValue[PositiveFloat, Literal["N"]]
    fixed_steps_force: ParameterValue[PositiveFloat, Literal["N"]]
    duration: ParameterValue[PositiveFloat, Literal["ms"]]
    max_steps: ParameterValue[PositiveInt, Literal["1"]]
    relative_tolerance: ParameterValue[Fraction, Literal["1"]]
    absolute_tolerance: ParameterValue[PositiveFloat, Literal["1"]]
    fixed_steps: ParameterValue[PositiveInt, Literal["1"]]
    time_step: ParameterValue[PositiveFloat, Literal["ms"]]
    ramp_rate: ParameterValue[PositiveFloat, Literal["1/ms"]]
    quasi_static_limit: ParameterValue[PositiveFloat, Literal["1"]]
    smallest_rate: ParameterValue[Fraction, Literal["1"]]
    snapshots: ParameterValue[Snapshots, Literal["1"]]


Mask = Annotated[tuple[str, ...], Field(strict=False), AfterValidator(_drawing)]
"""A drawing of the chart, one letter a grid cell."""


class LayoutRow(StrictModel):
    """A layout of electrodes, see :class:`~knitlab.model.electrode_layout.Layout`."""

    source: str = Field(min_length=1)
    along: Along = "wale"
    ridges: Annotated[tuple[PositiveInt, PositiveInt], Field(strict=False)] = (1, 2)
    face: Face = "front"
    within: Within = "patch"
    width: PositiveFloat | Literal["stripe"] = "stripe"
    span: Annotated[tuple[Share, Share], Field(strict=False)] = (0.0, 1.0)
    mask: Mask = ()


class ElectrodeParameters(StrictModel):
    """``electrodes.toml``: layouts of electrodes, and what their capacitance depends on."""

    permittivity: ParameterValue[Relative, Literal["1"]]
    electrode_length: ParameterValue[PositiveFloat, Literal["mm"]]
    clearance: ParameterValue[PositiveFloat, Literal["mm"]]
    accuracy: ParameterValue[Fraction, Literal["1"]]
    linearity: ParameterValue[Fraction, Literal["1"]]
    unfolded: ParameterValue[Fraction, Literal["1"]]
    layouts: dict[str, LayoutRow]


class GaugeParameters(StrictModel):
    """``gauge.toml``: how large a stitch is in cloth."""

    stitch_width: ParameterValue[PositiveFloat, Literal["mm"]]
    stitch_height: ParameterValue[PositiveFloat, Literal["mm"]]


class DesignGrid(StrictModel):
    """Every combination of the listed values."""

    n_stripe: tuple[PositiveInt, ...] = Field(min_length=1, strict=False)
    n_subunit: tuple[PositiveInt, ...] = Field(min_length=1, strict=False)


class DesignSet(StrictModel):
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
    reading: ModelOptionParameters
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
        "reading": ModelOptionParameters,
        "solver": SolverParameters,
        "dynamics": DynamicsParameters,
        "electrodes": ElectrodeParameters,
        "gauge": GaugeParameters,
        "designs": DesignSets,
    }
    faults = ErrorCollector()
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
