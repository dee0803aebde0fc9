"""The specification of a sample: what it takes to knit it, and what is to be expected of it."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

from knitlab.export.knitting.chart import StitchChart, electrode_name
from knitlab.export.knitting.knitout import knitout
from knitlab.export.knitting.leads import Lead, leads
from knitlab.export.knitting.machine import NOT_GIVEN, Machine, stitch_size_in_words
from knitlab.export.knitting.program import (
    Duration,
    Operation,
    duration,
    longest_floats,
    operations,
)
from knitlab.model.stitches import Gauge

WIDTHS = 0.5, 1.5  # of a stitch before it folds, over the distance of two needles; the paper's 0.8
HEIGHTS = 0.3, 1.5  # of a stitch over its width; the paper's 0.6


@dataclass(frozen=True, eq=False)
class Prediction:
    """What a cube says of a design."""

    source: str  # name of the cube
    sample: str  # periodic fabric, or a clamped sample of some size
    passes_through_itself: bool
    contraction: tuple[float, float]  # relaxed over flat length of unit cells along (x, y)
    applied_strain: Float[np.ndarray, " strain"]
    poisson_ratio: Float[np.ndarray, " strain"]
    low: Float[np.ndarray, " strain"]  # over perturbed copies of the design, NaN if it has none
    high: Float[np.ndarray, " strain"]

    def __repr__(self) -> str:
        return f"<Prediction {self.source}: {self.sample}, {len(self.applied_strain)} strains>"


@dataclass(frozen=True, eq=False)
class Specification:
    """What it takes to knit a chart by a program: passes, time, floats and sizes."""

    chart: StitchChart
    machine: Machine
    gauge: Gauge
    program: str
    prediction: Prediction | None = None
    assumed: tuple[tuple[str, str], ...] = ()  # yarn, stripes and gauge that it counts on
    differences: tuple[str, ...] = ()  # from the yarn and the machine that it needs

    @cached_property
    def operations(self) -> list[Operation]:
        """The operations of the program."""
        return list(operations(self.program))

    @cached_property
    def duration(self) -> Duration:
        """Passes and time of the program."""
        return duration(self.operations, self.machine)

    @cached_property
    def unplated(self) -> Duration:
        """The same without its electrodes."""
        bare = replace(self.chart, plated=np.zeros_like(self.chart.plated))
        return duration(operations(knitout(bare, self.machine)), self.machine)

    @cached_property
    def leads(self) -> list[Lead]:
        """Where the yarn of each electrode enters and leaves the fabric."""
        return leads(self.program, self.chart, self.machine)

    @property
    def flat_size(self) -> tuple[float, float]:
        """Width and length in cloth before it folds, by the gauge [mm]."""
        return self.chart.flat_size(self.gauge)

    @property
    def relaxed_size(self) -> tuple[float, float] | None:
        """Width and length in cloth as it folds, if they are predicted [mm]."""
        if self.prediction is None:
            return None
        (width, length) = self.flat_size
        (along_x, along_y) = self.prediction.contraction
        return width * along_x, length * along_y

    @property
    def carriers(self) -> list[tuple[int, str, str]]:
        """The carriers in use: number, yarn and what it knits."""
        machine = self.machine
        used = [(machine.body_carrier, machine.body_yarn or NOT_GIVEN, "body")]
        for number in self.chart.electrodes:
            use = f"electrode {electrode_name(number)}, on the {self.chart.plated_face[number - 1]}"
            used.append((machine.carrier_of(number), machine.conductive_yarn or NOT_GIVEN, use))
        if machine.waste_courses:
            used.append((machine.waste_carrier, machine.waste_yarn, "waste"))
            used.append((machine.draw_carrier, "draw-thread", "draw thread"))
        return sorted(used)

    @property
    def warnings(self) -> list[str]:
        """What makes its sizes doubtful: a gauge that contradicts the machine."""
        return [message] if (message := implausible_size(self.gauge, self.machine)) else []

    @property
    def remarks(self) -> list[str]:
        """What deserves a look before it is knitted."""
        remarks = list(self.differences)
        for use, name in (("body", "stitch_size"), ("plated", "plated_stitch_size")):
            used = use == "body" or self.chart.electrodes
            if used and getattr(self.machine, f"{use}_stitch_size") is None:
                hint = f"set {name} of the material or {use}_stitch_size of the machine"
                message = f"no stitch size of the {use} is given: find it with a swatch"
                remarks.append(f"{message}, and {hint}")
        for carrier, passed in longest_floats(self.operations).items():
            if passed > self.machine.longest_float:
                remarks.append(f"the yarn of carrier {carrier} floats past {passed} needles")
        if inside := [lead.name for lead in self.leads if lead.distance]:
            hint = "leave these ends long, and lead them to the edge over the back"
            message = f"{', '.join(inside)}: the conductive yarn ends inside the fabric"
            remarks.append(f"{message}; {hint} (the model has no leads)")
        if self.prediction is not None and self.prediction.passes_through_itself:
            remarks.append("the relaxed shape passes through itself: its size is uncertain")
        return remarks

    def rows(self) -> Iterator[tuple[str, str]]:
        """Names and values of its lines."""
        chart = self.chart
        machine = self.machine
        time = self.duration
        plated = int((chart.plated > 0).sum())
        yield "design", " ".join(chart.title.split())
        whole = "none: it is a whole sample"
        yield "repeats", whole if chart.is_whole_sample else chart.repeats_in_words
        needles = f"{machine.needles} needles, {machine.needles_per_inch} an inch"
        yield "machine", f"{machine.model}, {needles}"
        yield "needles", f"{chart.wales}, 1 to {chart.wales} on both beds"
        yield "courses", str(chart.courses)
        if chart.spans is not None:
            widths = np.diff(chart.spans)
            yield "shape", f"{widths.min()} to {widths.max()} wales a course"
        on_back = int((~chart.front & chart.present).sum())
        yield "stitches", f"{int(chart.present.sum())}, {on_back} on the back bed"
        if plated:
            yield "plated", f"{plated} stitches"
        yield "transfers", f"{chart.transfers} between courses"
        for number, yarn, use in self.carriers:
            yield f"carrier {number}", f"{use}: {yarn}"
        for lead in self.leads:
            yield lead.name, str(lead)
        sizes = f"body {stitch_size_in_words(machine.body_stitch_size)}"
        if plated:
            sizes += f", plated {stitch_size_in_words(machine.plated_stitch_size)}"
        yield "stitch size", f"{sizes} (machine units)"
        yield "end", machine.end.replace("_", "-")
        passes = sum(time.passes.values())
        kinds = ", ".join(f"{count} {kind}" for kind, count in time.passes.items())
        yield "passes", f"{passes}: {kinds}"
        yield "machine time", f"about {_minutes(time.seconds)}"
        if plated:
            bare = self.unplated
            more = time.seconds - bare.seconds
            added = passes - sum(bare.passes.values())
            share = f"{more / bare.seconds:.0%} more"
            yield "plating adds", f"{_minutes(more)} ({share}) and {added} passes"
        yield "size flat", _millimetres(self.flat_size)
        if self.relaxed_size is not None:
            yield "size relaxed", _millimetres(self.relaxed_size)
        yield from self.assumed


def _minutes(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 100 else f"{seconds / 60:.0f} min"


def _millimetres(size: tuple[float, float]) -> str:
    return f"{size[0]:.0f} × {size[1]:.0f} mm (width × length)"


def implausible_size(gauge: Gauge, machine: Machine) -> str | None:
    """How the size of a stitch contradicts the machine, or the shape of a stitch; or None."""
    width = gauge.stitch_width
    height = gauge.stitch_height
    pitch = machine.pitch
    if not WIDTHS[0] <= width / pitch <= WIDTHS[1]:
        low, high = (factor * pitch for factor in WIDTHS)
        message = f"stitch_width is {width:.4g} mm, but the needles of {machine.model} are"
        message += f" {pitch:.3g} mm apart, which makes stitches of {low:.2g} to {high:.2g} mm"
        hint = "give stitch_width as measured on a swatch of this machine, or the machine of the"
        return f"{message}: {hint} swatch by model or needles_per_inch"
    if not HEIGHTS[0] <= height / width <= HEIGHTS[1]:
        low, high = (factor * width for factor in HEIGHTS)
        message = f"stitch_height is {height:.4g} mm, and stitches {width:.4g} mm wide are"
        return f"{message} {low:.2g} to {high:.2g} mm high: measure both on a swatch"
    return None
