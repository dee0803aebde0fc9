"""Materials: the stripes of one yarn and the lengths that go with them, as a file or an object."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from statistics import geometric_mean
from typing import Annotated, Any

from pydantic import PositiveFloat, TypeAdapter
from scipy.interpolate import interp1d

from knitlab.fabric.settings import PlainKnit, Unit
from knitlab.fabric.stripe import STRIPE_QUANTITIES, Knit, Stripe
from knitlab.io.errors import ErrorCollector, Fault, naming, raise_any
from knitlab.io.names import Line
from knitlab.io.toml import StrictModel, read_checked, read_toml, write_toml
from knitlab.measure.stripe_covariance import Covariance, StripeCovariance
from knitlab.sweep.declared_fields import declared, entries, unit_of, with_fields
from knitlab.sweep.parameters import KNITS, UNITS, Parameters, StripeRow, StripeTable, StripeTables
from knitlab.sweep.workflow import SETTINGS
from knitlab.sweep.workflow_text import WorkflowText

SCALED = {
    "z_max": "sheet",
    "thickness": "sheet",
    "stitch_width": "gauge",
    "stitch_height": "gauge",
    "clearance": "capacitor",
    "ground_distance": "capacitor",
}
"""Lengths that go with a yarn, by the attribute of the parameters that holds each."""
UNIT_OF = dict.fromkeys(SCALED, "mm") | {"surface_density": "g/mm^2"}
"""Numbers of a yarn beside its stripes, and their units."""
MATERIAL = "model.material"
DIGITS = 6
"""Digits of the numbers of a calibrated stripe in a file."""


@dataclass(frozen=True)
class Material:
    """One yarn on one machine: its stripes, and the lengths that go with them.

    Nothing of the paper's yarn is used beside it: a design that needs another stripe is refused.
    Lengths that it does not give are those of the paper's yarn times the ratio of the periods,
    which the plan of a run states.

    Attributes:
        stripes: calibrated stripes, one for each knit and number of stitches.
        name: name of the material.
        z_max: half the gap between the walls [mm].
        thickness: thickness of the fabric, for contact [mm].
        stitch_width: width of a stitch before the fabric folds, along the course [mm].
        stitch_height: height of a stitch along the wale [mm].
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
            :class:`knitlab.StripeCovariance` also has repeats and degrees of freedom; another
            mapping is a normal covariance of the mean stripe.

    Raises:
        BadInput: if a number is out of range, or a stripe is there twice.

    Example:
        >>> import knitlab as kl
        >>> rib = kl.Stripe("rib", 4, period=10.0, k_s=39.3, theta_0=0.74, k_t=13.6)
        >>> garter = kl.Stripe("garter", 8, period=10.0, k_s=121.0, theta_0=1.26, k_t=23.4)
        >>> acrylic = kl.Material((rib, garter), name="acrylic", z_max=40.0)
        >>> test = kl.simulate(kl.Design(4, 8, boundary="periodic"), [0, 0.03], material=acrylic)
    """

    stripes: tuple[Stripe, ...]
    name: str = "own material"
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
    covariances: Mapping[tuple[Knit, int], Covariance] = field(
        default_factory=dict, hash=False, repr=False
    )

    def __post_init__(self) -> None:
        faults = ErrorCollector()
        with faults, naming("name"):
            TypeAdapter(Line).validate_python(self.name)
        named = [(stripe.knit, stripe.n) for stripe in self.stripes]
        if not named:
            faults.all.append(Fault("stripes", "are missing; give at least one knitlab.Stripe"))
        for knit, n in sorted({each for each in named if named.count(each) > 1}):
            faults.all.append(Fault("stripes", f"have {knit} {n} twice; keep one"))
        for stripe in self.stripes:
            with faults, naming(f"{stripe.knit} {stripe.n}"):
                StripeRow.of(stripe)
        for name, number in self.numbers.items():
            if not 0 < number < math.inf:
                problem = f"is {number!r}; give a number above 0 in {UNIT_OF[name]}"
                faults.all.append(Fault(name, problem))
        raise_any(faults.all)

    @property
    def numbers(self) -> dict[str, float]:
        """The lengths that it gives [mm], and its surface density [g/mm²]."""
        return {name: number for name in UNIT_OF if (number := getattr(self, name)) is not None}

    @classmethod
    def read(cls, path: str | Path) -> "Material":
        """The material in a file, as :meth:`write` and ``knitlab calibrate`` write it.

        Raises:
            BadInput: with every fault of the file.
        """
        return read_checked(MaterialFile, Path(path)).material(Path(path).stem)

    def write(self, path: str | Path) -> None:
        """Write the material into a TOML file, for ``--material`` and the setting ``material``."""
        table: dict[str, Any] = {"name": self.name, "interpolate": self.interpolate}
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
class MaterialFile(StrictModel):
    """A material file: tables of stripes, and lengths with unit and source."""

    name: Line | None = None
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
        )


def add_stripe(
    path: Path, stripe: Stripe, source: str, covariance: Covariance | None = None
) -> None:
    """Add a stripe to a material file, or replace it there; BadInput has every fault of a file."""
    if path.exists():
        read_checked(MaterialFile, path)
    table = read_toml(path) if path.exists() else {}
    rounded = {name: float(f"{getattr(stripe, name):.{DIGITS}g}") for name in STRIPE_QUANTITIES}
    _add_row(table, replace(stripe, **dict[str, Any](rounded)), source, covariance)
    write_toml(path, table)


def _add_row(
    table: dict[str, Any], stripe: Stripe, source: str, covariance: Covariance | None = None
) -> None:
    """Add the row of a stripe to the table of a material file."""
    row = StripeRow.of(stripe).model_dump(exclude_none=True)
    own = table.setdefault(stripe.knit, {"source": source, "unit": dict(UNITS), "n": {}})
    if own["source"] != source:
        row["source"] = source
    if stripe.stiffening_strain is not None:
        own["unit"]["stiffening_strain"] = "1"
    if covariance:
        row |= StripeRow.entries_of(StripeCovariance.of(covariance))
    own["n"][str(stripe.n)] = row


def period_ratio(stripes: Sequence[Stripe], reference: StripeTables) -> float:
    """Periods of stripes over those of reference stripes of as many stitches: the geometric mean.

    Reference periods are interpolated linearly between numbers of stitches, and continued beyond.
    """
    ratios = []
    for stripe in stripes:
        sizes = list(reference.rows(stripe.knit))
        periods = [reference.stripe(stripe.knit, n).period for n in sizes]
        period_at = interp1d(sizes, periods, fill_value="extrapolate")
        ratios.append(stripe.period / float(period_at(stripe.n)))
    return geometric_mean(ratios)


def with_material(parameters: Parameters, material: Material) -> Parameters:
    """The parameters with a material in place of the paper's yarn."""
    ratio = period_ratio(material.stripes, parameters.stripes)
    scaled = {
        name: ratio * getattr(getattr(parameters, table), name)
        for name, table in SCALED.items()
        if name not in material.numbers
    }
    stripes = StripeTables(interpolate=material.interpolate).with_stripes(material.stripes)
    tables: dict[str, Any] = {"stripes": stripes, "plain": material.plain}
    for name, number in (scaled | material.numbers).items():
        table = SCALED.get(name, "dynamics")
        tables[table] = replace(tables.get(table, getattr(parameters, table)), **{name: number})
    # Walls and thickness are lengths of the material's cloth, as they are of the paper's.
    for axis in ("width", "height"):
        before, after = (
            getattr(gauge, f"stitch_{axis}") for gauge in (parameters.gauge, tables["gauge"])
        )
        of_cloth = f"cloth_stitch_{axis}"
        stitch = getattr(parameters.sheet, of_cloth) * after / before
        tables["sheet"] = replace(tables["sheet"], **{of_cloth: stitch})
    return replace(parameters, material=material.name, scaled=scaled, **tables)


def with_material_file(
    path: Path, parameters: Parameters, text: WorkflowText
) -> tuple[Parameters, WorkflowText]:
    """The parameters with the material of a file that a workflow names, and the workflow.

    Lengths of a workflow's file that another material replaces are those of the paper's yarn, and
    scaled like the parameters; lengths of overrides, or beside the material in the file, are not.
    """
    material = read_checked(MaterialFile, path, text.source(MATERIAL)).material(path.stem)
    changed = with_material(parameters, material)
    scaled, axes = dict(changed.scaled), dict(text.axes)
    tables = {table: dict(given) for table, given in text.table.items() if isinstance(given, dict)}
    for name, attribute in SCALED.items():
        section = SETTINGS[name].section
        given = tables.get(section, {})
        if name not in given:
            continue
        scaled.pop(name, None)
        of_the_paper = MATERIAL in text.sources and f"{section}.{name}" not in text.sources
        # Others are faults, which the workflow's check reports.
        values = axes.get(name, (given[name],))
        if of_the_paper and all(isinstance(value, int | float) for value in values):
            new, old = (getattr(getattr(each, attribute), name) for each in (changed, parameters))
            given[name] = scaled[name] = new / old * given[name]
            if name in axes:
                axes[name] = tuple(new / old * each for each in values)
    text = replace(text, table=text.table | tables, axes=axes)
    return replace(changed, scaled=scaled), text
