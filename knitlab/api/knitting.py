"""Knitting a design: its stitch chart, the program of a machine, and its specification."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import xarray as xr

from knitlab.api.simulation import Design, case_of_design
from knitlab.api.single_design import SingleDesign, is_cube, single_design
from knitlab.fabric.settings import ModelOptions
from knitlab.io.atomic_write import atomic_write
from knitlab.io.errors import fault
from knitlab.knitting.chart import Face, StitchChart
from knitlab.knitting.knitout import knitout
from knitlab.knitting.machine import Machine, read_machine
from knitlab.knitting.round_trip import RoundTrip, round_trip
from knitlab.knitting.specification import Specification
from knitlab.knitting.stitch_chart import stitch_chart
from knitlab.measure.capacitance.capacitor import Capacitor
from knitlab.measure.knit_size import Gauge
from knitlab.sweep.figure_names import STILL_SUFFIXES, check_still
from knitlab.sweep.parameters import defaults
from knitlab.sweep.workflow import ProtocolSection

if TYPE_CHECKING:
    from matplotlib.figure import Figure

KNITOUT, TABLE = ".k", ".csv"


@dataclass(frozen=True, eq=False)
class KnitSample:
    """A design as it is knitted.

    Attributes:
        chart: its stitches.
        machine: the machine.
        program: the text of its knitout file.
        specification: what it takes to knit it.
    """

    chart: StitchChart
    machine: Machine
    program: str
    specification: Specification

    def __repr__(self) -> str:
        return f"<KnitSample {self.chart.size}, {len(self.program.splitlines())} lines of knitout>"

    def check(self, interpret: bool | None = None) -> RoundTrip:
        """Check the program, and compare what it knits with the chart.

        Args:
            interpret: whether ``knitout-interpreter`` runs it too; by default if it is installed
                and the program is short.

        Returns:
            Its ``faults``, and ``notes`` of what was checked.
        """
        return round_trip(self.program, self.chart, self.machine, interpret)

    def chart_figure(self) -> "Figure":
        """The chart as a matplotlib figure."""
        from knitlab.figures.stitch_chart import stitch_chart_figure
        from knitlab.figures.style import print_style

        with print_style():
            return stitch_chart_figure(self.chart)

    def sheet_figure(self) -> "Figure":
        """The specification sheet as a matplotlib figure, one page A4."""
        from knitlab.figures.stitch_chart import specification_sheet
        from knitlab.figures.style import print_style

        with print_style():
            return specification_sheet(self.specification)

    def save(self, path: str | Path) -> Path:
        """Write the knitout or the chart.

        Args:
            path: the file; its suffix says what: ``.k`` knitout, ``.csv`` the chart as a table,
                ``.svg``, ``.png`` or ``.pdf`` the chart as a figure.

        Raises:
            BadInput: if it has another suffix, or cannot be written.
        """
        path = Path(path)
        check_output(path)
        suffix = path.suffix.lower()
        if suffix in STILL_SUFFIXES:
            _save_figure(self.chart_figure(), path)
        else:
            with atomic_write(path) as temporary:
                text = self.program if suffix == KNITOUT else self.chart.table()
                temporary.write_text(text, encoding="utf-8", newline="\n")
        return path

    def save_sheet(self, path: str | Path) -> Path:
        """Write the specification sheet.

        Args:
            path: the file: ``.pdf``, ``.svg`` or ``.png``.

        Raises:
            BadInput: if it has another suffix, or cannot be written.
        """
        path = Path(path)
        check_still(path)
        _save_figure(self.sheet_figure(), path)
        return path


def knit(
    design: Design | str | Path | xr.Dataset,
    *,
    repeats: tuple[int, int] | None = None,
    needles: int | None = None,
    face: Face | None = None,
    machine: Mapping[str, Any] | None = None,
    model: ModelOptions | None = None,
    capacitor: Capacitor | None = None,
    gauge: Gauge | None = None,
    **settings: Any,
) -> KnitSample:
    """Chart a design stitch by stitch, and write the knitout that knits it.

    Args:
        design: a design; a workflow by its name or path; or a cube, its path, or a test, which
            also predict its relaxed size and its Poisson's ratio.
        repeats: how often its pattern repeats along the warp (y) and the weft (x); by default as in
            the design.
        needles: in place of that, needles to fill with whole repeats, twice as long as wide.
        face: face of the fabric for the conductors of its electrodes, ``"front"`` or ``"back"``; by
            default that to which their ridges point.
        machine: values that replace those of ``params/machine.toml``, such as
            ``{"end": "drop", "waste_courses": 10}``.
        model: of a design, its model options, as for :func:`knitlab.simulate`.
        capacitor: of a design, its electrodes, likewise.
        gauge: of a design, the size of a stitch, likewise.
        settings: of a workflow, settings that replace its own, as for :func:`knitlab.run`; of a
            cube, values of coordinates that select one design.

    Returns:
        The sample: its chart, its program and its specification.

    Raises:
        BadInput: if it is not one design, if it cannot be knitted, or if a setting is at fault.

    Example:
        >>> import knitlab as kl
        >>> sample = kl.knit("results/reference/periodic", n_stripe=4, n_subunit=16)
        >>> sample.chart.courses, sample.chart.wales
        (64, 32)
        >>> sample.check(interpret=False).faults
        ()
        >>> sample.save(folder / "sample.k").name
        'sample.k'
    """
    tables = {"model": model, "capacitor": capacitor, "gauge": gauge}
    if isinstance(design, Design):
        if settings:
            raise fault(
                ", ".join(settings),
                f"is of a workflow or a cube; of a Design, give {', '.join(tables)}",
            )
        parameters = defaults().with_tables(**tables)
        plated = capacitor is not None
        case = case_of_design(design, [0.0], parameters, ProtocolSection(), electrodes=plated)
        single = SingleDesign(case, parameters.gauge)
    elif given := [name for name, table in tables.items() if table is not None]:
        raise fault(", ".join(given), "is of a Design; leave it out of a workflow or a cube")
    elif isinstance(design, xr.Dataset) or is_cube(design):
        single = single_design(design, (), settings)
    else:
        single = single_design(design, settings, {})
    return knitted(single, repeats, needles, face, machine)


def knitted(
    design: SingleDesign,
    repeats: tuple[int, int] | None,
    needles: int | None,
    face: Face | None,
    machine: Mapping[str, Any] | None,
) -> KnitSample:
    """A single design as it is knitted; arguments and errors as of :func:`knit`."""
    if repeats is not None and needles is not None:
        raise fault("repeats", "and needles both set the size; give one of them")
    if repeats is not None and (len(repeats) != 2 or min(repeats) < 1):
        raise fault("repeats", f"are two counts from 1 up, (y, x), but are {repeats}")
    used = read_machine(machine)
    if face is not None and design.case.capacitor is None:
        raise fault("face", f"is of electrodes, and {design.case.label} has none; leave it out")
    chart = stitch_chart(design.case, repeats, needles, face)
    program = knitout(chart, used)
    needed = Specification(chart, used, design.gauge, program, design.prediction)
    return KnitSample(chart, used, program, needed)


def check_output(path: Path) -> None:
    """Refuse a file whose suffix says neither knitout nor a chart.

    Raises:
        BadInput: if so.
    """
    known = (KNITOUT, TABLE, *STILL_SUFFIXES)
    if path.suffix.lower() not in known:
        problem = f"has no suffix of knitout or a chart; give {', '.join(known)}"
        raise fault(f"output {path}", problem)


def _save_figure(figure: "Figure", path: Path) -> None:
    from knitlab.figures.figure_files import save
    from knitlab.figures.style import print_style

    with print_style():
        save(figure, path)
