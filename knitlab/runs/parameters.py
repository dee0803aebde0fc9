"""Parameters: schemas of ``params/*.toml``, each value with its unit and source, and defaults."""

import math
import re
import textwrap
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, PositiveFloat, PositiveInt, RootModel, model_validator

from knitlab.io.errors import ErrorCollector, invalid, naming, raise_if_any, shown
from knitlab.io.names import Name
from knitlab.io.shipped import shipped
from knitlab.io.toml import StrictModel, read_checked
from knitlab.model.electrodes import Capacitor, ElectrodeLayout
from knitlab.model.settings import (
    CellSize,
    Contact,
    Friction,
    GarterStart,
    ModelOptions,
    PlainKnit,
    Sheet,
)
from knitlab.model.spring_curve import SpringCurve
from knitlab.model.stitches import Gauge
from knitlab.model.stripe import (
    GARTER_STITCHES_PER_RIB_STITCH,
    SPRING_LAWS,
    YARN_FIELDS,
    Knit,
    Stripe,
    periods_per_patch,
)
from knitlab.model.stripe_covariance import MIN_REPEATS, StripeCovariance
from knitlab.runs.declared_fields import (
    LARGEST,
    ParameterValue,
    check_bound,
    declared,
    entries,
    required,
    unit_of,
    units,
    with_defaults,
    with_fields,
)
from knitlab.runs.patterns import PatternFile, PatternTable
from knitlab.runs.yarn import YarnOnMachine
from knitlab.solvers.dynamics.settings import Dynamics
from knitlab.solvers.equilibrium.settings import Solver

KNITS: tuple[Knit, ...] = ("rib", "garter")
QUANTITIES = declared(Stripe, without=("knit", "n", *SPRING_LAWS, *YARN_FIELDS))
"""Fitted numbers of a stripe, by their types."""
OPTIONAL = {"stiffening_strain": "1", "row_width": "mm", "stretch_along": "N/mm"}
"""Numbers that a stripe need not have, and their units."""
CURVES = ("spring_curve", "curve_along")
UNITS = {name: unit_of(kind) for name, kind in QUANTITIES.items()}


@with_fields(units(QUANTITIES))
class StripeUnits(StrictModel):
    """Units of a stripe table."""

    stiffening_strain: Literal["1"] | None = None
    row_width: Literal["mm"] | None = None
    stretch_along: Literal["N/mm"] | None = None


@with_fields(with_defaults(SpringCurve))
class SpringCurveRow(StrictModel):
    """The table of a :class:`~knitlab.model.spring_law.SpringCurve`."""

    @model_validator(mode="after")
    def _is_a_curve(self) -> "SpringCurveRow":
        self.curve  # noqa: B018  (it raises)
        return self

    @property
    def curve(self) -> SpringCurve:
        """The curve of this table."""
        return SpringCurve(**dict(self))


@with_fields(required(QUANTITIES))
class StripeRow(StrictModel):
    """Fitted values of one stripe (paper, Tables 1 and 2), and the law of its springs.

    The covariance is that of ``ln k_s``, ``ln k_t`` and ``theta_0`` of the mean stripe.
    """

    stiffening_strain: PositiveFloat | None = None
    spring_curve: SpringCurveRow | None = None
    row_width: PositiveFloat | None = None
    stretch_along: PositiveFloat | None = None
    curve_along: SpringCurveRow | None = None
    source: str | None = Field(default=None, exclude=True)
    covariance: dict[str, dict[str, float]] | None = Field(default=None, exclude=True)
    degrees_of_freedom: PositiveFloat | None = Field(default=None, exclude=True)
    repeats: int | None = Field(default=None, ge=MIN_REPEATS, exclude=True)

    @classmethod
    def of(cls, stripe: Stripe) -> "StripeRow":
        """The row of a stripe; ValueError if a number of it is out of range."""
        _stitches(str(stripe.n))
        numbers = asdict(stripe)
        return cls.model_validate(
            {name: numbers[name] for name in (*QUANTITIES, *OPTIONAL, *CURVES)}
        )

    @property
    def stripe_covariance(self) -> StripeCovariance | None:
        """The covariance with its repeats and degrees of freedom, if there is one."""
        if self.covariance is None:
            return None
        return StripeCovariance(self.covariance, self.degrees_of_freedom or math.inf, self.repeats)

    @staticmethod
    def entries_of(covariance: StripeCovariance) -> dict[str, Any]:
        """The entries of a covariance in the file, of which :attr:`stripe_covariance` is made."""
        row: dict[str, Any] = {}
        if covariance.repeats is not None:
            row["repeats"] = covariance.repeats
        if math.isfinite(covariance.degrees_of_freedom):
            row["degrees_of_freedom"] = covariance.degrees_of_freedom
        return row | {"covariance": {name: dict(each) for name, each in covariance.items()}}

    @model_validator(mode="after")
    def _has_a_covariance(self) -> "StripeRow":
        if self.covariance is None and (self.degrees_of_freedom or self.repeats):
            raise ValueError("has degrees_of_freedom or repeats but no covariance; give it too")
        return self

    @model_validator(mode="after")
    def _has_one_law(self) -> "StripeRow":
        if self.stiffening_strain is not None and self.spring_curve is not None:
            raise ValueError("has both stiffening_strain and spring_curve; give one")
        if self.curve_along is not None and self.stretch_along is None:
            raise ValueError("has curve_along without stretch_along; give both")
        return self


def _stitches(text: str) -> str:
    if not re.fullmatch("[1-9][0-9]{0,3}", text):
        raise ValueError(f"a stripe is named by its stitches, 1 to 9999, but is {shown(text)}")
    return text


class StripeTable(StrictModel):
    """All stripes of one knit, by stitches across a stripe."""

    source: str = Field(min_length=1)
    unit: StripeUnits
    n: dict[Annotated[str, AfterValidator(_stitches)], StripeRow] = Field(min_length=1)


class StripeTables(StrictModel):
    """The stripes of one yarn: ``stripes.toml``, or those of a material.

    With ``interpolate`` there are also stripes of every number of stitches between two of a table.
    """

    rib: StripeTable | None = None
    garter: StripeTable | None = None
    interpolate: bool = Field(default=False, exclude=True)

    def rows(self, knit: Knit) -> dict[int, StripeRow]:
        """The tabulated stripes of one knit by their number of stitches, ascending."""
        table = self.rib if knit == "rib" else self.garter
        return {} if table is None else {n: table.n[str(n)] for n in sorted(map(int, table.n))}

    def sizes(self, knit: Knit) -> list[int]:
        """Numbers of stitches of the stripes that there are of one knit, ascending."""
        sizes = list(self.rows(knit))
        return list(range(sizes[0], sizes[-1] + 1)) if self.interpolate and sizes else sizes

    def stripe(self, knit: Knit, stitches: int) -> Stripe:
        """One stripe; KeyError if there is none, InputError between two with springs not linear."""
        rows = self.rows(knit)
        if stitches not in self.sizes(knit):
            raise KeyError(stitches)
        if row := rows.get(stitches):
            names = *QUANTITIES, *OPTIONAL
            numbers: dict[str, Any] = {name: getattr(row, name) for name in names}
            curves = {name: curve.curve for name in CURVES if (curve := getattr(row, name))}
            return Stripe(knit, stitches, **numbers, **curves)
        smaller, larger = max(n for n in rows if n < stitches), min(n for n in rows if n > stitches)
        laws = *SPRING_LAWS, "curve_along"
        if any(getattr(rows[n], law) is not None for n in (smaller, larger) for law in laws):
            message = f"lies between {smaller} and {larger}, whose springs are not both linear"
            raise invalid(f"{knit} {stitches}", f"{message}; calibrate it")
        fraction = (stitches - smaller) / (larger - smaller)
        interpolated: dict[str, Any] = {}
        for name in QUANTITIES:
            first, last = getattr(rows[smaller], name), getattr(rows[larger], name)
            if name in ("k_s", "k_t"):
                interpolated[name] = first * (last / first) ** fraction
            else:
                interpolated[name] = first + (last - first) * fraction
        for name in ("row_width", "stretch_along"):
            ends = [getattr(rows[n], name) for n in (smaller, larger)]
            if None not in ends:
                interpolated[name] = ends[0] * (ends[1] / ends[0]) ** fraction
            elif any(ends):
                message = f"lies between {smaller} and {larger}, of which one has no {name}"
                raise invalid(f"{knit} {stitches}", f"{message}; calibrate it")
        return Stripe(knit, stitches, **interpolated)

    def with_stripes(self, stripes: Iterable[Stripe]) -> "StripeTables":
        """The tables, to which stripes are added, or whose stripes they replace."""
        tables = dict(self)
        for stripe in stripes:
            table = tables[stripe.knit] or StripeTable.model_construct(
                source="knitlab.Stripe", unit=StripeUnits.model_validate(UNITS), n={}
            )
            rows = table.n | {str(stripe.n): StripeRow.of(stripe)}
            tables[stripe.knit] = table.model_copy(update={"n": rows})
        return StripeTables(**tables)

    def impossible(self, n_stripe: int, n_subunit: int) -> str | None:
        """Why a design is impossible with these stripes, or None if it is possible."""
        ribs, garters = self.sizes("rib"), self.sizes("garter")
        pairing = [n for n in ribs if GARTER_STITCHES_PER_RIB_STITCH * n in garters]
        if n_stripe not in pairing:
            garter = f"garter stripe of {GARTER_STITCHES_PER_RIB_STITCH * n_stripe} to pair with"
            missing = garter if n_stripe in ribs else "rib stripe"
            return f"n_stripe = {n_stripe} has no {missing}; choose from {pairing}"
        try:
            periods_per_patch(n_stripe, n_subunit)
        except ValueError as error:
            return str(error)
        return None


@with_fields(with_defaults(ElectrodeLayout))
class LayoutRow(StrictModel):
    """A named :class:`~knitlab.model.electrodes.ElectrodeLayout`."""

    source: str = Field(min_length=1)


@with_fields(entries(declared(Capacitor, without=("layout",))))
class ElectrodesFile(StrictModel):
    """``electrodes.toml``: named layouts, and the entries of a capacitor."""

    layouts: dict[Name, LayoutRow]


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
        """The designs (n_stripe, n_subunit), in order."""
        return tuple((n, m) for grid in self.designs for n in grid.n_stripe for m in grid.n_subunit)


class DesignSets(RootModel[dict[Name, DesignSet]]):
    """``designs.toml``."""


@dataclass(frozen=True)
class Parameters:
    """Everything under ``params/``, and the source of each value by the name of its setting."""

    stripes: StripeTables
    sheet: Sheet
    plain: PlainKnit | None  # None if the material has none
    model: ModelOptions
    solver: Solver
    dynamics: Dynamics
    friction: Friction
    capacitor: Capacitor
    layouts: dict[str, ElectrodeLayout]
    gauge: Gauge
    designs: DesignSets
    patterns: dict[str, tuple[PatternTable, Path]]  # with the folder that its paths are relative to
    sources: dict[str, str]
    material: str | None = None  # name of one in place of the paper's yarn
    scaled: Mapping[str, float] = field(default_factory=dict)  # lengths that it scaled
    yarn: YarnOnMachine | None = None  # of the material

    def __repr__(self) -> str:
        """The tables of settings, and the names of all else."""
        shown: dict[str, str] = {
            "material": self.material or "of the paper",
            **{str(knit): ", ".join(map(str, self.stripes.rows(knit))) for knit in KNITS},
            "layouts": ", ".join(self.layouts),
            "designs": ", ".join(self.designs.root),
            "patterns": ", ".join(self.patterns),
        }
        for name in TABLES:
            table = getattr(self, name)
            given = {} if table is None else asdict(table)
            given.pop("layout", None)
            shown[name] = ", ".join(f"{key} {value}" for key, value in given.items())
        lines = (
            textwrap.fill(f"{name:10} {text}", 100, subsequent_indent=" " * 11)
            for name, text in shown.items()
        )
        return "\n".join(["<Parameters>", *lines])

    def with_tables(self, **given: object) -> "Parameters":
        """The parameters with other tables, of which None keeps one; InputError lists mistakes."""
        mistakes = ErrorCollector()
        tables: dict[str, Any] = {name: each for name, each in given.items() if each is not None}
        for name, table in tables.items():
            with mistakes:
                if not isinstance(table, kind := TABLES[name]):
                    message = f"is {table!r}; give knitlab.defaults().{name} or a changed copy"
                    raise invalid(name, message)
                values = {key: getattr(table, key) for key in declared(kind)}
                for key in LARGEST.keys() & values.keys():
                    with naming(f"{name}.{key}"):
                        check_bound(key, values[key])
                tables[name] = kind(**values)  # cases with a subclass of it are not equal
        raise_if_any(mistakes.all)
        return replace(self, **tables)


TABLES: dict[str, type[Any]] = {
    "sheet": Sheet,
    "plain": PlainKnit,
    "model": ModelOptions,
    "solver": Solver,
    "dynamics": Dynamics,
    "friction": Friction,
    "capacitor": Capacitor,
    "gauge": Gauge,
}
"""Tables of settings, by the attribute of the parameters that holds each."""
FILES: dict[str, type[Any]] = {
    "stripes": StripeTables,
    **{
        name: with_fields(entries(declared(table)))(StrictModel)
        for name, table in TABLES.items()
        if table is not Capacitor
    },
    "electrodes": ElectrodesFile,
    "designs": DesignSets,
    "patterns": PatternFile,
}
"""Schemas of the parameter files, by name."""


def defaults() -> Parameters:
    """The values of ``params/*.toml``, which are used unless others are given.

    Change some of them with :func:`dataclasses.replace`.

    Returns:
        Tables of settings, such as ``sheet``, ``solver`` and ``capacitor``; ``stripes``, of which
        ``stripes.stripe(knit, n)`` gives one; and the named ``layouts`` of electrodes.

    Example:
        >>> from dataclasses import replace
        >>> import knitlab as kl
        >>> known = kl.defaults()
        >>> rib = replace(known.stripes.stripe("rib", 4), k_t=0.02)
        >>> design = kl.Design(4, 16, rib=rib)
        >>> sheet = replace(known.sheet, z_max=2.0)
        >>> known.sheet.z_max, sheet.z_max
        (6.0, 2.0)
    """
    folder = shipped("params")
    read: dict[str, Any] = {
        name: read_checked(schema, folder / f"{name}.toml") for name, schema in FILES.items()
    }
    items = [item for file in read.values() for item in file]
    stated = {name: entry for name, entry in items if isinstance(entry, ParameterValue)}
    values = {name: entry.value for name, entry in stated.items()} | {"layout": ElectrodeLayout()}
    return Parameters(
        stripes=read["stripes"],
        layouts={
            name: ElectrodeLayout(**row.model_dump(exclude={"source"}))
            for name, row in read["electrodes"].layouts.items()
        },
        designs=read["designs"],
        patterns={name: (entry, folder) for name, entry in read["patterns"].root.items()},
        sources={name: entry.source for name, entry in stated.items()},
        **{
            name: table(**{field: values[field] for field in declared(table)})
            for name, table in TABLES.items()
        },
    )


@dataclass(frozen=True)
class Model(ModelOptions):
    """Model options, by default those of ``params/model.toml``.

    The attributes are those of :class:`~knitlab.model.settings.ModelOptions`, where they are
    described.

    Example:
        >>> import knitlab as kl
        >>> kl.Model(cell_size="flat").garter_start
        'valley'
    """

    # Others than those in code, which identifiers of cases fix.
    cell_size: CellSize = "relaxed"
    garter_start: GarterStart = "valley"
    contact: Contact = "barrier"
