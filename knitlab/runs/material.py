"""Materials: the stripes of one yarn and the lengths that go with them, as a file or an object."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from statistics import geometric_mean
from typing import Annotated, Any

from pydantic import Field, PositiveFloat, SkipValidation

from knitlab.io.errors import ErrorCollector, Mistake, invalid, raise_if_any
from knitlab.io.names import Line
from knitlab.io.toml import StrictModel, read_checked, read_toml, write_toml
from knitlab.model.checked import Checked
from knitlab.model.settings import CellSize, ModelOptions, PlainKnit, Unit
from knitlab.model.spring_curve import SpringCurve
from knitlab.model.stitches import Gauge
from knitlab.model.stripe import STRIPE_QUANTITIES, Knit, Stripe, flat_stitch
from knitlab.model.stripe_covariance import Covariance, StripeCovariance
from knitlab.runs.declared_fields import declared, entries, optional, unit_of, with_fields
from knitlab.runs.parameters import (
    KNITS,
    OPTIONAL,
    UNITS,
    Parameters,
    StripeRow,
    StripeTable,
    StripeTables,
    defaults,
)
from knitlab.runs.workflow import SETTINGS
from knitlab.runs.workflow_text import WorkflowText
from knitlab.runs.yarn import YarnOnMachine

SCALED = {
    "z_max": "sheet",
    "thickness": "sheet",
    "clearance": "capacitor",
    "ground_distance": "capacitor",
}
"""Lengths that go with a yarn, by the attribute of the parameters that holds each."""
STITCH = "stitch_width", "stitch_height"
"""The size of a stitch before the fabric folds."""
UNIT_OF = dict.fromkeys((*SCALED, *STITCH), "mm") | {"surface_density": "g/mm^2"}
"""Numbers of a yarn beside its stripes, and their units."""
MATERIAL = "model.material"
DIGITS = 6
"""Digits of the numbers of a calibrated stripe in a file."""


@dataclass(frozen=True)
class Material(Checked):
    """One yarn on one machine: its stripes, and the lengths that go with them.

    No stripe of the paper's yarn is mixed in: a design that needs another stripe is refused. If it
    does not give the size of its stitch, that follows from the periods of its stripes. Other
    lengths that it does not give are those of the paper's yarn times the ratio of the stitch
    widths; the plan of a run states them.

    Attributes:
        stripes: calibrated stripes, one for each knit and number of stitches.
        name: name of the material.
        cell_size: whether the periods of its stripes are those of relaxed or of flat fabric. It
            sets the model option; another value of that option is refused.
        z_max: half the gap between the walls [mm].
        thickness: thickness of the fabric, for contact [mm].
        stitch_width: width of a stitch before the fabric folds, along the course; by default that
            of its rib stripes, half a flat period over the stitches of a stripe [mm].
        stitch_height: height of a stitch along the wale; by default that of its garter stripes
            [mm].
        clearance: distance below which electrodes touch [mm].
        ground_distance: distance of a grounded plane below the fabric [mm].
        surface_density: mass of the flat fabric per area, for dynamics [g/mm²]; by default the
            paper's.
        plain: stiffness of plain knit; a pattern with plain knit is refused without it.
        interpolate: whether stripes between two of these are interpolated.
        source: where the numbers come from.
        covariances: of the numbers of stripes, by knit and stitches, for
            :func:`knitlab.uncertainty`: ``{("rib", 4): fitted.covariance}``. They are those of
            ``ln k_s``, ``ln k_t``, ``theta_0`` and ``ln period``; what is left out is exact. A
            :class:`knitlab.StripeCovariance` also has repeats and degrees of freedom; any other
            mapping is the covariance of the mean stripe, with normal errors.
        yarn: the yarn in words, for :func:`knitlab.knit`; None if it is not given.
        conductive_yarn: the yarn of electrodes in words.
        stitch_size: size of a stitch, in units of the machine.
        plated_stitch_size: size of a plated stitch, likewise.
        machine: model of the machine that knitted the swatches, one of ``params/machine.toml``.

    Raises:
        InputError: if a number is out of range, or a stripe is there twice.

    Example:
        >>> import knitlab as kl
        >>> rib = kl.Stripe("rib", 4, period=10.0, k_s=39.3, theta_0=0.74, k_t=13.6)
        >>> garter = kl.Stripe("garter", 8, period=10.0, k_s=121.0, theta_0=1.26, k_t=23.4)
        >>> acrylic = kl.Material((rib, garter), name="acrylic", z_max=40.0)
        >>> test = kl.simulate(kl.Design(4, 8, boundary="periodic"), [0, 0.03], material=acrylic)
    """

    stripes: Annotated[tuple[Stripe, ...], Field(strict=False)]
    name: Line = "own material"
    cell_size: CellSize = "relaxed"
    z_max: Annotated[PositiveFloat, Unit("mm")] | None = None
    thickness: Annotated[PositiveFloat, Unit("mm")] | None = None
    stitch_width: Annotated[PositiveFloat, Unit("mm")] | None = None
    stitch_height: Annotated[PositiveFloat, Unit("mm")] | None = None
    clearance: Annotated[PositiveFloat, Unit("mm")] | None = None
    ground_distance: Annotated[PositiveFloat, Unit("mm")] | None = None
    surface_density: Annotated[PositiveFloat, Unit("g/mm^2")] | None = None
    plain: PlainKnit | None = None
    interpolate: bool = False
    source: str = "given in Python"
    covariances: Annotated[Mapping[tuple[Knit, int], Covariance], SkipValidation] = field(
        default_factory=dict, hash=False, repr=False
    )
    yarn: Line | None = None
    conductive_yarn: Line | None = None
    stitch_size: PositiveFloat | None = None
    plated_stitch_size: PositiveFloat | None = None
    machine: Line | None = None

    def __post_init__(self) -> None:
        mistakes = ErrorCollector()
        with mistakes:
            super().__post_init__()
        named = [(stripe.knit, stripe.n) for stripe in self.stripes]
        if not named:
            mistakes.all.append(Mistake("stripes", "are missing; give at least one knitlab.Stripe"))
        for knit, n in sorted({each for each in named if named.count(each) > 1}):
            mistakes.all.append(Mistake("stripes", f"have {knit} {n} twice; keep one"))
        lacking = [f"{each.knit} {each.n}" for each in self.stripes if each.row_width is None]
        if 0 < len(lacking) < len(self.stripes):
            message = f"have no row_width for {', '.join(lacking)}, but for others"
            mistakes.all.append(Mistake("stripes", f"{message}; calibrate all by force over width"))
        raise_if_any(mistakes.all)

    @property
    def numbers(self) -> dict[str, float]:
        """The lengths that it gives [mm], and its surface density [g/mm²]."""
        return {name: number for name in UNIT_OF if (number := getattr(self, name)) is not None}

    @property
    def on_machine(self) -> YarnOnMachine:
        """Its yarn, stitch sizes and machine, as far as they are given."""
        return YarnOnMachine(
            **{each.name: getattr(self, each.name) for each in fields(YarnOnMachine)}
        )

    def implied_stitch(self, knit: Knit) -> float | None:
        """Flat width of a rib stitch, or height of a garter stitch [mm], if it has any."""
        own = [stripe for stripe in self.stripes if stripe.knit == knit]
        return geometric_mean(flat_stitch(each, self.cell_size) for each in own) if own else None

    def check(self, model: ModelOptions, where: str = "model") -> None:
        """Raise InputError, with the place ``where``, if model options contradict the material."""
        if model.cell_size != self.cell_size:
            message = f"cell_size {model.cell_size} contradicts the material {self.name!r}"
            raise invalid(where, f"{message}; leave it out, or take {self.cell_size}")
        if model.hinge_stiffness == "per_length" and any(each.row_width for each in self.stripes):
            message = f"hinge_stiffness per_length contradicts the material {self.name!r}"
            raise invalid(where, f"{message}, which gives row widths; take per_edge")

    @classmethod
    def read(cls, path: str | Path) -> "Material":
        """The material in a file, as :meth:`write` and ``knitlab calibrate`` write it.

        Raises:
            InputError: with every mistake of the file.
        """
        return read_checked(MaterialFile, Path(path)).material(Path(path).stem)

    def write(self, path: str | Path) -> None:
        """Write the material into a TOML file, for ``--material`` and the setting ``material``."""
        table: dict[str, Any] = {
            "name": self.name,
            "cell_size": self.cell_size,
            "interpolate": self.interpolate,
        }
        table |= self.on_machine.given
        for name, number in self.numbers.items():
            table[name] = {"value": number, "unit": UNIT_OF[name], "source": self.source}
        if self.plain is not None:
            units = {name: unit_of(kind) for name, kind in declared(PlainKnit).items()}
            table["plain"] = {
                name: {"value": getattr(self.plain, name), "unit": unit, "source": self.source}
                for name, unit in units.items()
            }
        for stripe in sorted(self.stripes, key=lambda each: (each.knit, each.n)):
            covariance = self.covariances.get((stripe.knit, stripe.n))
            _add_row(table, stripe, self.source, covariance)
        write_toml(Path(path), table)


_ENTRIES = entries({name: Annotated[PositiveFloat, Unit(unit)] for name, unit in UNIT_OF.items()})


@with_fields(entries(declared(PlainKnit)))
class _PlainEntries(StrictModel):
    """``[plain]`` of a material file."""


@with_fields({name: (entry | None, None) for name, (entry, _) in _ENTRIES.items()})
@with_fields(optional(declared(YarnOnMachine)))
class MaterialFile(StrictModel):
    """A material file: tables of stripes, lengths with unit and source, and the yarn."""

    name: Line | None = None
    cell_size: CellSize = "relaxed"
    interpolate: bool = False
    rib: StripeTable | None = None
    garter: StripeTable | None = None
    plain: _PlainEntries | None = None

    def material(self, name: str) -> Material:
        """The material, with this name if the file has none."""
        stripes = StripeTables(rib=self.rib, garter=self.garter)
        tables, plain = [table for table in (self.rib, self.garter) if table], self.plain
        sources = [row.source or table.source for table in tables for row in table.n.values()]
        entries = {number: entry for number in UNIT_OF if (entry := getattr(self, number))}
        return Material(
            tuple(stripes.stripe(knit, n) for knit in KNITS for n in stripes.rows(knit)),
            name=self.name or name,
            cell_size=self.cell_size,
            plain=PlainKnit(**{name: entry.value for name, entry in plain}) if plain else None,
            interpolate=self.interpolate,
            source="; ".join(dict.fromkeys(sources)),
            covariances={
                (knit, n): covariance
                for knit in KNITS
                for n, row in stripes.rows(knit).items()
                if (covariance := row.stripe_covariance) is not None
            },
            **{number: entry.value for number, entry in entries.items()},
            **{each.name: getattr(self, each.name) for each in fields(YarnOnMachine)},
        )


def check_added(path: Path, knit: Knit, n: int, cell_size: CellSize, per_width: bool) -> None:
    """InputError if a stripe, perhaps with the width of a row, contradicts those of the file."""
    if not path.exists():
        return
    there = read_checked(MaterialFile, path)
    if there.cell_size != cell_size:
        message = f"has periods of {there.cell_size} stripes, and {knit} {n} is {cell_size}"
        raise invalid(str(path), f"{message}; calibrate all for cell_size {there.cell_size}")
    for other in there.material(path.stem).stripes:
        if (other.knit, other.n) != (knit, n) and (other.row_width is not None) != per_width:
            lacking = f"{knit} {n}" if other.row_width else f"{other.knit} {other.n}"
            message = f"{lacking} has no width of a row; give both swatches one, or write two files"
            raise invalid(f"{path}: {other.knit} {other.n} and {knit} {n}", message)


def add_stripe(
    path: Path,
    stripe: Stripe,
    source: str,
    covariance: Covariance | None = None,
    cell_size: CellSize = "relaxed",
) -> None:
    """Add a stripe to a material file, or replace it there; InputError has all its mistakes."""
    table: dict[str, Any] = {"cell_size": cell_size}
    check_added(path, stripe.knit, stripe.n, cell_size, stripe.row_width is not None)
    if path.exists():
        table |= read_toml(path)
    numbers = {name: getattr(stripe, name) for name in (*STRIPE_QUANTITIES, *OPTIONAL)}
    rounded: dict[str, Any] = {name: each and _rounded(each) for name, each in numbers.items()}
    if (curve := stripe.curve_along) is not None:
        points = (tuple(map(_rounded, each)) for each in (curve.strain, curve.force))
        rounded["curve_along"] = SpringCurve(*points)
    _add_row(table, replace(stripe, **dict[str, Any](rounded)), source, covariance)
    write_toml(path, table)


def _rounded(number: float) -> float:
    return float(f"{number:.{DIGITS}g}")


def _add_row(
    table: dict[str, Any], stripe: Stripe, source: str, covariance: Covariance | None = None
) -> None:
    row = StripeRow.of(stripe).model_dump(exclude_none=True)
    own = table.setdefault(stripe.knit, {"source": source, "unit": dict(UNITS), "n": {}})
    if own["source"] != source:
        row["source"] = source
    own["unit"] |= {name: unit for name, unit in OPTIONAL.items() if name in row}
    if covariance:
        row |= StripeRow.entries_of(StripeCovariance.of(covariance))
    own["n"][str(stripe.n)] = row


def with_material(parameters: Parameters, material: Material) -> Parameters:
    """The parameters with a material in place of the paper's yarn."""
    paper = parameters.gauge
    named = dict(zip(KNITS, STITCH, strict=True))
    wider = {
        knit: implied / getattr(paper, name)
        for knit, name in named.items()
        if (implied := material.implied_stitch(knit))
    }
    # A stitch of a material of one knit alone has the shape of the paper's.
    usual = geometric_mean(wider.values())
    gauge = Gauge(
        **{
            name: material.numbers.get(name, wider.get(knit, usual) * getattr(paper, name))
            for knit, name in named.items()
        }
    )
    ratio = gauge.stitch_width / paper.stitch_width
    scaled = {
        name: ratio * getattr(getattr(parameters, table), name)
        for name, table in SCALED.items()
        if name not in material.numbers
    }
    stripes = StripeTables(interpolate=material.interpolate).with_stripes(material.stripes)
    model = replace(parameters.model, cell_size=material.cell_size)
    # Walls and thickness are lengths of the material's cloth, as they are of the paper's.
    cloth = {f"cloth_{name}": getattr(gauge, name) for name in STITCH}
    tables: dict[str, Any] = {
        "stripes": stripes,
        "plain": material.plain,
        "gauge": gauge,
        "model": model,
        "sheet": replace(parameters.sheet, **cloth),
        "yarn": material.on_machine,
    }
    for name, number in (scaled | material.numbers).items():
        if name not in STITCH:
            table = SCALED.get(name, "dynamics")
            tables[table] = replace(tables.get(table, getattr(parameters, table)), **{name: number})
    return replace(parameters, material=material.name, scaled=scaled, **tables)


def known_parameters(material: Material | None, model: ModelOptions | None) -> Parameters:
    """The parameters of a material, or the defaults; InputError if model options contradict it."""
    if material is None:
        return defaults()
    if model is not None:
        material.check(model)
    return with_material(defaults(), material)


def with_material_file(
    path: Path, parameters: Parameters, text: WorkflowText
) -> tuple[Parameters, WorkflowText]:
    """The parameters with the material of a file that a workflow names, and the workflow.

    If an override names it, lengths in the workflow's file are the paper's, and scaled.
    """
    material = read_checked(MaterialFile, path, text.source(MATERIAL)).material(path.stem)
    changed = with_material(parameters, material)
    given = text.table.get("model", {})
    for name in ("cell_size", "hinge_stiffness"):
        for value in text.axes.get(name, (given[name],) if name in given else ()):
            # The check of the workflow reports other values.
            if isinstance(value, str):
                model = replace(changed.model, **dict[str, Any]({name: value}))
                material.check(model, text.source(f"model.{name}"))
    scaled, axes = dict(changed.scaled), dict(text.axes)
    tables = {table: dict(given) for table, given in text.table.items() if isinstance(given, dict)}
    for name, attribute in SCALED.items():
        section = SETTINGS[name].section
        given = tables.get(section, {})
        if name not in given:
            continue
        scaled.pop(name, None)
        of_the_paper = MATERIAL in text.sources and f"{section}.{name}" not in text.sources
        # The check of the workflow reports other values.
        values = axes.get(name, (given[name],))
        if of_the_paper and all(isinstance(value, int | float) for value in values):
            new, old = (getattr(getattr(each, attribute), name) for each in (changed, parameters))
            given[name] = scaled[name] = new / old * given[name]
            if name in axes:
                axes[name] = tuple(new / old * each for each in values)
    text = replace(text, table=text.table | tables, axes=axes)
    return replace(changed, scaled=scaled), text
