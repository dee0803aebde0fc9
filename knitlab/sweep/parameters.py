"""Parameters: schemas of ``params/*.toml``, each value with its unit and source, and defaults."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, PositiveInt, RootModel

from knitlab.dynamics.settings import Dynamics
from knitlab.equilibrium.settings import Solver
from knitlab.fabric.electrodes import ElectrodeLayout
from knitlab.fabric.settings import CellSize, GarterStart, ModelOptions, PlainKnit, Sheet
from knitlab.io.errors import BadInput, ErrorCollector, Fault, fault
from knitlab.io.shipped import shipped
from knitlab.io.toml import StrictModel, read_checked
from knitlab.measure.capacitance.capacitor import Capacitor
from knitlab.measure.knit_size import Gauge
from knitlab.sweep.declared_fields import (
    ParameterValue,
    checked,
    declared,
    entries,
    with_defaults,
    with_fields,
)
from knitlab.sweep.patterns import Pattern, PatternFile
from knitlab.sweep.stripe_tables import StripeTables


@with_fields(with_defaults(ElectrodeLayout))
class LayoutRow(StrictModel):
    """A named :class:`~knitlab.fabric.electrodes.ElectrodeLayout`."""

    source: str = Field(min_length=1)


@with_fields(entries(declared(Capacitor, without=("layout",))))
class ElectrodesFile(StrictModel):
    """``electrodes.toml``: named layouts, and the entries of a capacitor."""

    layouts: dict[str, LayoutRow]


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


class DesignSets(RootModel[dict[str, DesignSet]]):
    """``designs.toml``."""


@dataclass(frozen=True)
class Parameters:
    """Everything under ``params/``, and the source of each value by the name of its setting.

    ``material`` names one in place of the paper's yarn, ``scaled`` are lengths that it scaled.
    """

    stripes: StripeTables
    sheet: Sheet
    plain: PlainKnit | None  # None if the material has none
    model: ModelOptions
    solver: Solver
    dynamics: Dynamics
    capacitor: Capacitor
    layouts: dict[str, ElectrodeLayout]
    gauge: Gauge
    designs: DesignSets
    patterns: dict[str, tuple[Pattern, Path]]  # with the folder that its paths are relative to
    sources: dict[str, str]
    material: str | None = None
    scaled: Mapping[str, float] = field(default_factory=dict)

    def with_tables(self, **given: object) -> "Parameters":
        """The parameters with other tables, None keeps one; BadInput has every one out of range."""
        faults = ErrorCollector()
        tables: dict[str, Any] = {name: each for name, each in given.items() if each is not None}
        for name, table in tables.items():
            with faults:
                if not isinstance(table, TABLES[name]):
                    problem = f"is {table!r}; give knitlab.defaults().{name} or a changed copy"
                    raise fault(name, problem)
                tables[name] = checked(name, table, TABLES[name])
        if faults.all:
            raise BadInput(faults.all)
        return replace(self, **tables)


TABLES: dict[str, type[Any]] = {
    "sheet": Sheet,
    "plain": PlainKnit,
    "model": ModelOptions,
    "solver": Solver,
    "dynamics": Dynamics,
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


def read_parameters(folder: Path) -> Parameters:
    """Read and check every file of a parameter folder."""
    faults = ErrorCollector()
    read: dict[str, Any] = {}
    for name, schema in FILES.items():
        with faults:
            read[name] = read_checked(schema, folder / f"{name}.toml")
    if "stripes" in read and "designs" in read:
        # Sets can be checked against the stripes even if another file has faults.
        faults.all += [
            Fault(f"{folder / 'designs.toml'}: {name}", problem)
            for name, members in read["designs"].root.items()
            for pair in members.pairs
            if (problem := read["stripes"].impossible(*pair))
        ]
    if faults.all:
        raise BadInput(faults.all)
    items = [item for file in read.values() for item in file]
    stated = {name: entry for name, entry in items if isinstance(entry, ParameterValue)}
    layouts = {
        name: ElectrodeLayout(**row.model_dump(exclude={"source"}))
        for name, row in read["electrodes"].layouts.items()
    }
    values = {name: entry.value for name, entry in stated.items()} | {"layout": ElectrodeLayout()}
    tables = {
        name: table(**{field: values[field] for field in declared(table)})
        for name, table in TABLES.items()
    }
    return Parameters(
        stripes=read["stripes"],
        layouts=layouts,
        designs=read["designs"],
        patterns={name: (entry, folder) for name, entry in read["patterns"].root.items()},
        sources={name: entry.source for name, entry in stated.items()},
        **tables,
    )


def defaults() -> Parameters:
    """The values of ``params/*.toml``, which are used unless others are given.

    Change some of them with :func:`dataclasses.replace`.

    Returns:
        Tables of settings, such as ``sheet``, ``solver`` and ``capacitor``; ``stripes``, of which
        ``stripes.stripe(knit, n)`` gives one; and the named ``layouts`` of electrodes.

    Raises:
        BadInput: with every fault of the files.

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
    return read_parameters(shipped("params"))


@dataclass(frozen=True)
class Model(ModelOptions):
    """Model options, by default those of ``params/model.toml``.

    The attributes are those of :class:`~knitlab.fabric.settings.ModelOptions`, where they are
    described.

    Example:
        >>> import knitlab as kl
        >>> kl.Model(cell_size="flat").garter_start
        'valley'
    """

    # Others than those in code, which identifiers of cases fix.
    cell_size: CellSize = "relaxed"
    garter_start: GarterStart = "valley"
