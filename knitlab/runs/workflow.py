"""Workflows: the schema of the TOML file that describes one sweep, and its settings by name.

A setting is declared once, as a field of a table such as
``Solver`` or of a section below; ``--set``, sweeps, coordinates and the reference follow.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_origin

from pydantic import (
    AfterValidator,
    Field,
    FiniteFloat,
    PositiveFloat,
    field_validator,
    model_validator,
)

from knitlab.io.errors import naming, unknown
from knitlab.io.names import Line
from knitlab.io.toml import StrictModel
from knitlab.model.electrodes import Capacitor, ElectrodeLayout
from knitlab.model.pattern import map_letters
from knitlab.model.settings import (
    Boundary,
    Fraction,
    Friction,
    ModelOptions,
    PlainKnit,
    Sheet,
    Unit,
)
from knitlab.model.stitches import Gauge
from knitlab.model.stripe import STIFFENING, STRIPE_QUANTITIES, Knit
from knitlab.runs.declared_fields import (
    FACTOR,
    Count,
    declared,
    factors,
    optional,
    unit_of,
    with_fields,
    with_inner,
)
from knitlab.runs.figure_names import FIGURE_NAMES
from knitlab.runs.parameters import KNITS, QUANTITIES
from knitlab.runs.patterns import is_pattern_name
from knitlab.solvers.dynamics.settings import Dynamics
from knitlab.solvers.equilibrium.settings import Solver
from knitlab.solvers.loads import LOADS
from knitlab.solvers.loads.load import MAX_STRAIN, Load
from knitlab.solvers.methods import METHODS

Sizes = Annotated[tuple[Count, ...], Field(min_length=1, max_length=300, strict=False)]
"""Numbers of stitches."""

MAX_STRAIN_STEPS = 1000  # of a test
MAX_CYCLES = 1000  # of a test
MAX_COPIES = 100  # perturbed copies of a design


def _known_figure(name: str) -> str:
    if name not in FIGURE_NAMES:
        raise ValueError(unknown(name, FIGURE_NAMES, "figure"))
    return name


Figures = Annotated[tuple[Annotated[str, AfterValidator(_known_figure)], ...], Field(strict=False)]


def even_strains(strain_max: float, strain_step: float) -> tuple[float, ...]:
    """Multiples of a step from 0 to a largest strain, which is one of them."""
    steps = round(strain_max / strain_step)
    return tuple(round(step * strain_step, 12) for step in range(steps + 1))


def pattern_name(rows: tuple[str, ...]) -> str | None:
    """The name of a ``pattern``, or None if it is rows of patches."""
    return rows[0] if len(rows) == 1 and is_pattern_name(rows[0]) else None


class DesignSection(StrictModel):
    """``[design]``: the designs, as a named set or as a grid, and the size of their samples.

    ``pattern`` is rows of patches, top course first, or the name of a pattern of ``patterns.toml``
    or of the ``pattern_files``; several names are a dimension of the cube.

    With a set, ``n_stripe`` or ``n_subunit`` alone select members of the set; both together
    replace it by their grid. The size of the sample is given in ``unit_cells``, or by ``needles``:
    the sample then has as many unit cells as fit on that number of needles times ``scale``, and is
    ``aspect`` times as long as wide.
    """

    set: str | None = None
    n_stripe: Sizes | None = None
    n_subunit: Sizes | None = None
    pattern: Annotated[tuple[str, ...], Field(strict=False)] = ("GR", "RG")
    pattern_files: Annotated[tuple[str, ...], Field(strict=False)] = ()
    unit_cells: Annotated[tuple[Count, Count] | None, Field(strict=False)] = None
    needles: Count | None = None
    aspect: PositiveFloat = 2.0
    scale: Fraction = 1.0

    @field_validator("pattern")
    @classmethod
    def _is_a_patch_map(cls, rows: tuple[str, ...]) -> tuple[str, ...]:
        if pattern_name(rows) is None:
            map_letters(rows)
        return rows

    @model_validator(mode="after")
    def _gives_one_sample_size(self) -> "DesignSection":
        if self.needles is not None and self.unit_cells is not None:
            raise ValueError("has both unit_cells and needles; give one of them")
        if self.needles is None and {"aspect", "scale"} & self.model_fields_set:
            raise ValueError("has aspect or scale but no needles to knit on; give needles")
        return self


if TYPE_CHECKING:  # which needs the names of types in the text
    LoadName = str
    MethodName = str
else:
    LoadName = Literal[tuple(LOADS)]
    MethodName = Literal[tuple(METHODS)]


class StripesSection(StrictModel):
    """``[stripes]``: pure stripes, stretched across their ridges, instead of ``[design]``.

    Each is simulated with every boundary, as a sheet of ``stripe_periods`` periods.
    """

    knit: Annotated[tuple[Knit, ...], Field(min_length=1, strict=False)] = ("rib", "garter")
    n: Sizes | None = None
    boundaries: Annotated[tuple[Boundary, ...], Field(min_length=1, strict=False)] = ("periodic",)
    stripe_periods: Count = 1


class ProtocolSection(StrictModel):
    """``[protocol]``: the strains of the tensile test, and how its states are reached.

    The strains are the multiples of ``strain_step`` and the ``further_strains``, up to
    ``strain_max``. Lists of ``load``, ``load_ratio``, ``load_angle`` and ``cycle`` are dimensions.
    ``sensitivities`` adds derivatives with respect to the stripe parameters, ``unloading`` the
    states of unloading, ``robustness`` the spread over this number of perturbed copies.
    """

    method: MethodName = "equilibrium"
    strain_max: Annotated[float, Field(ge=0)] = 0.45
    strain_step: PositiveFloat = 0.03
    further_strains: Annotated[
        tuple[PositiveFloat, ...], Field(strict=False, max_length=MAX_STRAIN_STEPS)
    ] = ()
    load: LoadName = "warp"
    load_ratio: Annotated[FiniteFloat, Field(gt=-1)] | None = None
    load_angle: Annotated[float, Field(ge=0, lt=180), Unit("degree")] | None = None
    cycle: Annotated[int, Field(ge=1, le=MAX_CYCLES)] = 1
    sensitivities: bool = False
    unloading: bool = False
    robustness: Annotated[int, Field(ge=0, le=MAX_COPIES)] = 0

    @model_validator(mode="after")
    def _is_a_possible_test(self) -> "ProtocolSection":
        largest, step = self.strain_max, self.strain_step
        for name in METHODS[self.method].refused:
            if getattr(self, name):
                able = " or ".join(each for each in METHODS if name not in METHODS[each].refused)
                raise ValueError(f"method = {self.method} gives no {name}; take method = {able}")
        if largest > MAX_STRAIN:
            fraction = f"strains are fractions, so that {largest:g} % is {largest / 100:g}"
            raise ValueError(f"strain_max = {largest:g} is {largest:.0%}; {fraction}")
        steps = largest / step
        if abs(steps - round(steps)) > 1e-6:
            message = f"is not a whole multiple of strain_step = {step:g}; change one"
            raise ValueError(f"strain_max = {largest:g} {message}")
        if steps > MAX_STRAIN_STEPS:
            raise ValueError(f"gives {steps:.3g} strains; give at most {MAX_STRAIN_STEPS}")
        return self

    @property
    def as_load(self) -> Load:
        """The load, with the settings that it needs, as far as they are given."""
        kind = LOADS[self.load]
        given = {each.attribute: getattr(self, each.name) for each in kind.settings}
        return kind(**{name: value for name, value in given.items() if value is not None})

    @property
    def applied_strain(self) -> tuple[float, ...]:
        """All strains of the test, ascending from 0."""
        further = {strain for strain in self.further_strains if strain <= self.strain_max}
        return tuple(sorted(further.union(even_strains(self.strain_max, self.strain_step))))


class Protocol(ProtocolSection):
    """The strains of a tensile test, and how its states are reached: a workflow's ``[protocol]``.

    Raises:
        InputError: if a value is out of range, or two contradict.

    Example:
        >>> import knitlab as kl
        >>> kl.Protocol(strain_max=0.09).applied_strain
        (0.0, 0.03, 0.06, 0.09)
    """

    if not TYPE_CHECKING:  # which knows the arguments from the fields

        def __init__(self, **values: Any) -> None:
            with naming("Protocol"):
                super().__init__(**values)


PLAIN_NUMBERS = declared(PlainKnit) | factors(declared(PlainKnit))
SPRING_LAW_CHANGES = (STIFFENING, f"rib_{STIFFENING}", f"garter_{STIFFENING}")
CHANGES = factors(STRIPE_QUANTITIES)
for _quantities in (
    *({f"{knit}_{name}": QUANTITIES[name] for name in STRIPE_QUANTITIES} for knit in KNITS),
    declared(Sheet),
):
    CHANGES |= _quantities | factors(_quantities)
CHANGES |= dict.fromkeys(SPRING_LAW_CHANGES, PositiveFloat)
"""Parameters of stripes and sheet that may be replaced or multiplied, in the order of the
digest of stripes in a cube."""


@with_fields(optional(CHANGES | PLAIN_NUMBERS | declared(ModelOptions)))
class ModelSection(StrictModel):
    """``[model]``: settings that replace ``model.toml``, ``sheet.toml`` and ``stripes.toml``.

    ``material`` is a file with the stripes of another yarn, as ``knitlab calibrate`` writes it, in
    place of the paper's; ``interpolate_stripes`` gives stripes between two of a table. Any other
    setting may be a list, and is then a dimension of the cube. Factors multiply the values of the
    tables or of other settings.
    """

    material: str | None = None
    interpolate_stripes: bool | None = None


@with_fields(optional(declared(Solver)))
class SolverSection(StrictModel):
    """``[solver]``: settings that replace ``solver.toml``; a list is a dimension."""


@with_fields(optional(declared(Dynamics)))
class DynamicsSection(StrictModel):
    """``[dynamics]``: settings that replace ``dynamics.toml``; a list is a dimension."""


@with_fields(optional(declared(Friction)))
class FrictionSection(StrictModel):
    """``[friction]``: settings that replace ``friction.toml``; a list is a dimension."""


@with_fields(optional(declared(ElectrodeLayout) | declared(Capacitor, without=("layout",))))
class ElectrodesSection(StrictModel):
    """``[electrodes]``: the layout of a capacitor, and settings that replace ``electrodes.toml``.

    The values of along, ridges, face, within, width, span and mask change the named layout, or
    define a layout if none is named. A list of layouts, or of one other setting, is a dimension.
    """

    layout: str | None = None


@with_fields(optional(declared(Gauge)))
class GaugeSection(StrictModel):
    """``[gauge]``: settings that replace ``gauge.toml``; a cube has one gauge."""


class Workflow(StrictModel):
    """A workflow file, with the overrides of ``--set`` applied."""

    title: Line
    figures: Figures = ()
    design: DesignSection | None = None
    stripes: StripesSection | None = None
    protocol: ProtocolSection = ProtocolSection()
    model: ModelSection = ModelSection()
    solver: SolverSection = SolverSection()
    dynamics: DynamicsSection = DynamicsSection()
    friction: FrictionSection = FrictionSection()
    electrodes: ElectrodesSection | None = None
    gauge: GaugeSection = GaugeSection()

    @model_validator(mode="after")
    def _is_of_one_kind(self) -> "Workflow":
        if (self.design is None) == (self.stripes is None):
            raise ValueError("needs either [design] or [stripes], and not both")
        if self.stripes is not None and self.protocol.sensitivities:
            raise ValueError("pure stripes have no sensitivities; leave out protocol.sensitivities")
        if self.stripes is not None and self.protocol.load != "warp":
            raise ValueError("pure stripes are pulled across their ridges; leave out protocol.load")
        return self


SECTIONS: dict[str, type[StrictModel]] = {
    name: kind
    for name, field in Workflow.model_fields.items()
    for kind in with_inner(field.annotation)
    if isinstance(kind, type) and issubclass(kind, StrictModel)
}
"""The tables of a workflow file."""
SWEPT_SECTIONS = ("model", "solver", "dynamics", "friction", "electrodes")
"""Sections of which single settings may be lists."""
SAMPLE_SIZE = "unit_cells"  # the setting of `[design]` that may be a list too, of pairs
PATTERN = "pattern"  # the setting of `[design]` that may be a list of names
SWEPT_PROTOCOL = ("load", "load_ratio", "load_angle", "cycle")
"""Settings of ``[protocol]`` that may be lists."""
OF_ALL_CASES = ("material", "interpolate_stripes")  # but these may not


@dataclass(frozen=True)
class Setting:
    """One setting: declared type, with range and unit, and default, None if of a parameter file."""

    section: str
    name: str
    kind: Any
    default: Any

    @property
    def unit(self) -> str:
        """Unit [UDUNITS]."""
        return unit_of(self.kind)

    @property
    def factor_on(self) -> str | None:
        """The quantity that it multiplies, if it is a factor."""
        return self.name.removesuffix(FACTOR) if self.name.endswith(FACTOR) else None

    @property
    def takes_list(self) -> bool:
        """Whether its value is a list."""
        return any(get_origin(kind) is tuple for kind in with_inner(self.kind))

    @property
    def can_vary(self) -> bool:
        """Whether it may take several values in one run."""
        able = self.section in SWEPT_SECTIONS and self.name not in OF_ALL_CASES
        return (able or self.name in SWEPT_PROTOCOL) and not self.takes_list

    def is_swept_by(self, value: Any) -> bool:
        """Whether a value of a workflow file is a list of several values."""
        if not isinstance(value, list) or not value:
            return False
        if self.name == SAMPLE_SIZE:
            return all(isinstance(one, list) for one in value)
        if self.name == PATTERN:
            names = (isinstance(one, str) and is_pattern_name(one) for one in value)
            return len(value) > 1 and all(names)
        return self.can_vary


SETTINGS = {
    name: Setting(section, name, field.rebuild_annotation(), field.default)
    for section, schema in SECTIONS.items()
    for name, field in schema.model_fields.items()
}
"""Every setting, by name."""
