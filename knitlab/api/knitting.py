"""Knitting a design: its stitch chart, the program of a machine, and its specification."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import xarray as xr

from knitlab.api.simulation import Design, case_of_design
from knitlab.api.single_design import SingleDesign, is_cube, single_design
from knitlab.api.sweeps import one_of
from knitlab.export.knitting.chart import Face, StitchChart
from knitlab.export.knitting.chart_files import Edge, read_stitches
from knitlab.export.knitting.instructions import instructions
from knitlab.export.knitting.knitout import knitout
from knitlab.export.knitting.machine import NOT_GIVEN, Machine, paper_yarn, read_machine, same_model
from knitlab.export.knitting.patches import ReadChart, read_patches
from knitlab.export.knitting.patches import pattern_name as pattern_name
from knitlab.export.knitting.round_trip import RoundTrip, round_trip
from knitlab.export.knitting.specification import Specification
from knitlab.export.knitting.stitch_chart import stitch_chart
from knitlab.export.knitting.symbols import Key
from knitlab.figures.figure_files import draw_into, save_figure
from knitlab.io.atomic_write import atomic_write
from knitlab.io.errors import invalid, raise_if_any
from knitlab.io.names import as_texts, check_suffix
from knitlab.io.provenance import provenance
from knitlab.model.computing import computing
from knitlab.model.electrodes import Capacitor
from knitlab.model.settings import ModelOptions
from knitlab.model.stitches import Gauge
from knitlab.model.stripe import STRIPE_QUANTITIES
from knitlab.runs.declared_fields import declared
from knitlab.runs.figure_names import FIGURE_SUFFIXES
from knitlab.runs.material import Material, known_parameters
from knitlab.runs.parameters import UNITS, defaults
from knitlab.runs.workflow import Protocol
from knitlab.runs.workflow_file import Overrides, read_overrides

if TYPE_CHECKING:
    from matplotlib.figure import Figure

KNITOUT = ".k"
TABLE = ".csv"
WORDS = ".txt"


@dataclass(frozen=True, eq=False)
class KnitSample(Specification):
    """A design as it is knitted.

    Attributes:
        chart: its stitches.
        machine: the machine.
        gauge: the size of a stitch.
        program: the text of its knitout file.
        prediction: what a cube says of it, if one is given.
    """

    def __repr__(self) -> str:
        return f"<KnitSample {self.chart.size}, {len(self.program.splitlines())} lines of knitout>"

    def check(self, interpret: bool | None = None) -> RoundTrip:
        """Check the program, and compare what it knits with the chart.

        Args:
            interpret: whether ``knitout-interpreter`` runs it too; by default if it is installed
                and the program is short.

        Returns:
            Its ``mistakes``, and ``notes`` of what was checked.
        """
        return round_trip(self.program, self.chart, self.machine, interpret)

    def chart_figure(self) -> "Figure":
        """The chart as a matplotlib figure."""
        from knitlab.figures.stitch_chart import stitch_chart_figure

        return stitch_chart_figure(self.chart, self.leads)

    def sheet_figure(self) -> "Figure":
        """The specification sheet as a matplotlib figure, one page A4."""
        from knitlab.figures.stitch_chart import specification_sheet

        return specification_sheet(self)

    def instructions(self, *, in_the_round: bool = False) -> str:
        """The chart in words, to knit it by hand.

        Args:
            in_the_round: whether all rows are rounds, knitted on the right side.

        Returns:
            A line for each group of like rows, such as "Row 1 (RS): *k4, p4; rep from * to end.".

        Example:
            >>> sample = kl.knit("results/reference/periodic", n_stripe=4, n_subunit=16)
            >>> sample.instructions(in_the_round=True).splitlines()[5]
            'Rounds 1 to 8: k16, [p4, k4] 2 times.'
        """
        return instructions(self.chart, in_the_round)

    def save(self, path: str | Path, *, in_the_round: bool = False) -> Path:
        """Write the knitout, the chart or its words.

        Args:
            path: the file; its suffix says what: ``.k`` knitout, ``.csv`` the chart as a table,
                ``.svg``, ``.png`` or ``.pdf`` the chart as a figure, ``.txt`` the instructions.
            in_the_round: of instructions, as in :meth:`instructions`.

        Raises:
            InputError: if it has another suffix, or cannot be written.
        """
        path = Path(path)
        check_suffix(path, (KNITOUT, TABLE, WORDS, *FIGURE_SUFFIXES), "knitout or a chart")
        suffix = path.suffix.lower()
        if suffix in FIGURE_SUFFIXES:
            draw_into(self.chart_figure, path)
            return path
        with atomic_write(path) as temporary:
            words = self.instructions(in_the_round=in_the_round) if suffix == WORDS else None
            text = words or (self.program if suffix == KNITOUT else self._table())
            temporary.write_text(text, encoding="utf-8", newline="\n")
        return path

    def _table(self) -> str:
        """The chart as a table, with the ends of the yarn of electrodes."""
        ends = {True: ":in", False: ":out"}
        return self.chart.table((each.course, each.wale, ends[each.enters]) for each in self.leads)

    def save_sheet(self, path: str | Path) -> Path:
        """Write the specification sheet.

        Args:
            path: the file: ``.pdf``, ``.svg`` or ``.png``.

        Raises:
            InputError: if it has another suffix, or cannot be written.
        """
        return save_figure(self.sheet_figure, path)


@computing()
def knit(
    design: Design | str | Path | xr.Dataset,
    overrides: Sequence[str] = (),
    selections: Mapping[str, Any] = {},
    *,
    repeats: tuple[int, int] | None = None,
    needles: int | None = None,
    face: Face | None = None,
    machine: Overrides | None = None,
    model: ModelOptions | None = None,
    capacitor: Capacitor | None = None,
    gauge: Gauge | None = None,
    material: Material | str | Path | None = None,
    **settings: Any,
) -> KnitSample:
    """Chart a design stitch by stitch, and write the knitout that knits it.

    Args:
        design: a design; a workflow by its name or path; or a cube, its path, or a test, which
            also predict its relaxed size and its Poisson's ratio.
        overrides: settings of a workflow, or sizes of a stitch of a cube, as text:
            ``"n_stripe=4"``.
        selections: a value for each coordinate of a cube, or of the cube of a workflow.
        repeats: how often its pattern repeats along the warp (y) and the weft (x); by default as in
            the design.
        needles: in place of that, needles to fill with whole repeats, twice as long as wide.
        face: face of the fabric for its conductors, ``"front"`` or ``"back"``; by default that to
            which their ridges point.
        machine: the model of a machine of ``params/machine.toml``, by default that of the material
            or of the paper, and values that replace its own, such as
            ``{"model": "Kniterate", "waste_courses": 10}``, or as text ``["model=Kniterate"]``.
        model: of a design, its model options, as for :func:`knitlab.simulate`.
        capacitor: of a design, its electrodes.
        gauge: of a design, the size of a stitch.
        material: in place of the paper's yarn, of a design a material or its file, of a workflow
            its file; a cube has its own.
        settings: of a workflow, settings that replace its own, as for :func:`knitlab.run`; of a
            cube, values of coordinates that select one design, and a size of a stitch.

    Raises:
        InputError: if it is not one design, if it cannot be knitted, or if a setting is invalid.

    Example:
        >>> sample = kl.knit("results/reference/periodic", n_stripe=4, n_subunit=16)
        >>> sample.chart.courses, sample.chart.wales
        (64, 32)
        >>> sample.save(folder / "sample.k").name
        'sample.k'
    """
    tables = {"model": model, "capacitor": capacitor, "gauge": gauge}
    if isinstance(material, str | Path):
        if isinstance(design, Design):
            material = Material.read(material)
        else:
            # It is the setting of a workflow.
            settings["material"] = material
            material = None
    given = tables | {"material": material}
    if isinstance(design, Design):
        if settings or overrides or selections:
            names = ", ".join([*settings, *overrides, *selections])
            message = f"cannot be given with a Design; give {', '.join(given)}, or change it"
            raise invalid(names, message)
        parameters = known_parameters(material, model).with_tables(**tables)
        plated = capacitor is not None
        case = case_of_design(design, [0.0], parameters, Protocol(), electrodes=plated)
        single = SingleDesign(case, parameters.gauge, None, parameters.material, parameters.yarn)
    elif names := ", ".join(name for name, table in given.items() if table is not None):
        message = "can only be given with a Design; give it as a setting of the workflow"
        raise invalid(names, message)
    else:
        sizes = declared(Gauge) if is_cube(design) else settings
        chosen = {name: value for name, value in settings.items() if name not in sizes}
        changed = {name: value for name, value in settings.items() if name in sizes}
        single = single_design(design, one_of(overrides, changed), {**selections, **chosen})
    if repeats is not None and needles is not None:
        raise invalid("repeats", "and needles both set the size; give one of them")
    if repeats is not None and (len(repeats) != 2 or min(repeats) < 1):
        raise invalid("repeats", f"are two counts from 1 up, (y, x), but are {repeats}")
    if face is not None and single.case.capacitor is None:
        raise invalid("face", f"needs electrodes, and {single.case.label} has none; leave it out")
    return knit_sample(single, stitch_chart(single.case, repeats, needles, face), machine)


def knit_sample(
    single: SingleDesign, chart: StitchChart, machine: Overrides | None = None
) -> KnitSample:
    """The chart of a design as a machine knits it; InputError if the machine cannot."""
    used = machine_of(single, machine)
    program = knitout(chart, used)
    assumed, differences = _assumptions(single, used)
    return KnitSample(chart, used, single.gauge, program, single.prediction, assumed, differences)


def machine_of(single: SingleDesign, machine: Overrides | None) -> Machine:
    """The machine that knits a design; InputError if a setting of it is unknown."""
    if machine is not None and not isinstance(machine, Mapping):
        read, mistakes = read_overrides(as_texts(machine), "machine")
        raise_if_any(mistakes)
        machine = {each.key: each.value for each in read}
    return read_machine(machine, single.yarn)


def read_chart(
    path: str | Path,
    *,
    first: Edge = "bottom",
    carrier: int | None = None,
    knit: str | None = None,
    purl: str | None = None,
) -> ReadChart:
    """Read any stitch chart as a pattern: its patches, their stripes, and what is neither.

    Args:
        path: rows of text as seen from the front, with ``k`` or ``1`` for a knit, ``p``, ``0`` or
            ``-`` for a purl, and a dot for the other one, or with any two symbols that ``knit`` and
            ``purl`` name; a ``.csv`` of :meth:`.KnitSample.save`; an image with one pixel a stitch
            in two colours, of which the darker is purl; or knitout (``.k``).
        first: edge of a text or an image that is knitted first, ``"bottom"`` or ``"top"``.
        carrier: of knitout, the carrier whose stitches are read; by default that with most.
        knit: symbol of a knit in a text, such as ``"|"``, or its colour in an image, such as
            ``"#ffffff"``. A blank, ``" "``, is also an empty cell of a table.
        purl: symbol or colour of a purl.

    Returns:
        Its ``pattern()`` for designs and workflows, ``n_stripe`` and ``n_subunit``, its ``chart``,
        and ``messages``, with the courses and wales that no pattern represents.

    Raises:
        InputError: if the file is no chart, is too large, or can be read in several ways.

    Example:
        >>> sample = kl.knit("results/reference/periodic", n_stripe=4, n_subunit=16)
        >>> read = kl.read_chart(sample.save(folder / "sample.k"))
        >>> read.pattern().rows, read.n_stripe, read.n_subunit, read.messages
        (('GR', 'RG'), 4, 16, ())
    """
    path = Path(path)
    stitches, remark = read_stitches(path, first, carrier, Key(knit, purl))
    return read_patches(stitches, f"{path.name} ({remark})" if remark else path.name)


def _assumptions(
    design: SingleDesign, machine: Machine
) -> tuple[tuple[tuple[str, str], ...], tuple[str, ...]]:
    """Yarn, stripes and gauge that a sample counts on, and what yarn and machine do not have."""
    case = design.case
    tables = defaults().stripes
    width = design.gauge.stitch_width
    height = design.gauge.stitch_height
    yarn = design.yarn or paper_yarn()
    rows = [("yarn", "that of the paper, params/stripes.toml")]
    if design.material is not None:
        rows = [("material", design.material), ("yarn", yarn.yarn or NOT_GIVEN)]
    differences = []
    if yarn.machine is not None and not same_model(yarn.machine, machine.model):
        whose = design.material or "the paper's yarn"
        message = f"stripes and stitch sizes of {whose} are for {yarn.machine}, not {machine.model}"
        differences.append(f"{message}: knit and calibrate swatches on this machine")
    if case.folds:
        angles = ", ".join(sorted({f"{fold.theta_0:.3g} rad" for fold in case.folds}))
        message = f"no stitch is known to make single folds of a rest angle, here {angles}, and"
        differences.append(f"{message} 1 × 1 rib is narrower than the gauge: knit a swatch first")
    for stripe in dict.fromkeys((case.weft, case.warp)):
        label = f"{stripe.knit} {stripe.n}"
        needed = {name: getattr(stripe, name) for name in STRIPE_QUANTITIES}
        numbers = ", ".join(f"{name} {value:.4g} {UNITS[name]}" for name, value in needed.items())
        rows.append((label, numbers))
        if design.material is not None or stripe.n not in tables.sizes(stripe.knit):
            continue
        given = tables.stripe(stripe.knit, stripe.n)
        factors = {name: value / getattr(given, name) for name, value in needed.items()}
        other = [f"{name} × {by:.2f}" for name, by in factors.items() if abs(by - 1) > 0.005]
        if other:
            hint = "find a yarn or a stitch size that has it, and calibrate it"
            differences.append(f"{label} needs {', '.join(other)} of the paper's yarn: {hint}")
    rows.append(("gauge", f"a stitch of {width:.3g} × {height:.3g} mm before the fabric folds"))
    commit = provenance()["git_commit"].partition(":")[0][:12]
    rows.append(("case", f"{case.case_id}, code {commit}"))
    return tuple(rows), tuple(differences)
