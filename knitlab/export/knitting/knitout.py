"""Knitout of a stitch chart: cast-on, waste, body and end, as a documented subset of version 0.6.

Needles are numbered from 1 at the left. Courses go leftwards and rightwards in turn, leftwards
first, since the inserting hook brings yarn in from the right. A machine without hooks takes ``in``
and ``out``, and begins rightwards, since its carriers park at the left.
"""

from collections.abc import Iterator, Sequence
from itertools import groupby, pairwise

import numpy as np
from jaxtyping import Bool

from knitlab.export.knitting.chart import StitchChart
from knitlab.export.knitting.machine import NOT_GIVEN, Machine, stitch_size_in_words
from knitlab.export.knitting.program import Needle
from knitlab.export.knitting.shaping import shaping
from knitlab.io.errors import invalid

VERSION = 2  # version of the language that version 0.6 of its specification describes
LEFTWARD, RIGHTWARD = -1, 1  # directions of the carriage, as steps from needle to needle


def knitout(chart: StitchChart, machine: Machine) -> str:
    """The text of a knitout file that knits a chart; InputError if it is wider than the machine."""
    if chart.wales > machine.needles:
        message = f"is wider than the {machine.needles} needles of {machine.model}"
        fitting = f"take {machine.needles // chart.repeat[1]} repeats of {chart.repeat[1]} wales"
        if chart.spans is not None:
            fitting = "make the piece narrower"
        path = f"chart of {chart.wales} wales"
        raise invalid(path, f"{message}; {fitting}, or take another machine")
    if chart.electrodes and chart.spans is not None:
        message = "is plated and shaped, which is not supported"
        raise invalid(f"chart {chart.size}", f"{message}; leave out its electrodes or its shape")
    if chart.electrodes and machine.carriers_of_a_stitch == 1:
        message = f"is plated, but {machine.model} ({machine.back_end}) takes one carrier a stitch"
        raise invalid(f"chart {chart.size}", f"{message}; leave out its electrodes")
    return "\n".join([*_header(chart, machine), *_Program(chart, machine).written()]) + "\n"


def _header(chart: StitchChart, machine: Machine) -> Iterator[str]:
    yield f";!knitout-{VERSION}"
    yield f";;Machine: {machine.model}"
    yield f";;Gauge: {machine.needles_per_inch}"
    yield f";;Width: {machine.needles}"  # without it back ends centre on another machine's beds
    if machine.waste_courses:
        yield f";;Yarn-{machine.waste_carrier}: {_word(machine.waste_yarn)} yellow"
        yield f";;Yarn-{machine.draw_carrier}: draw-thread red"
    yield f";;Yarn-{machine.body_carrier}: {_word(machine.body_yarn)} white"
    for electrode in chart.electrodes:
        yield f";;Yarn-{machine.carrier_of(electrode)}: {_word(machine.conductive_yarn)} grey"
    yield f";;Carriers: {' '.join(map(str, range(1, machine.carriers + 1)))}"
    yield ";;Position: Center"
    yield f";;X-Design: {' '.join(chart.title.split())}"
    yield f";;X-Chart: {chart.courses} courses {chart.wales} wales"
    for use in ("waste", "body", "plated"):
        number, size = (getattr(machine, f"{use}_stitch_{what}") for what in ("number", "size"))
        yield f";;X-Stitch-Number-{number}: {use} {stitch_size_in_words(size)}"


def _word(yarn: str | None) -> str:
    """A yarn as one word: a header separates it from its colour by a space."""
    return "-".join((yarn or NOT_GIVEN).split())


class _Program:
    def __init__(self, chart: StitchChart, machine: Machine) -> None:
        self.chart = chart
        self.machine = machine
        self.needles = self._needles_of(0)  # that hold stitches of the chart
        self.lines = [f"x-speed-number {machine.speed_number}"]
        self.on_front = np.ones(chart.wales, bool)
        self.inwards = machine.inwards
        self.direction = self.inwards
        self.shaping = shaping(chart, self.inwards, machine.largest_racking)
        self.stitch_number: int | None = None
        self.active: set[int] = set()
        # No carrier may pass the inserting hook, which parks right of the first stitch of its own.
        # It is released late, so that many stitches hold the end of the yarn.
        self.hooked: int | None = None
        self.hook_from: int | None = None

    def _needles_of(self, course: int) -> range:
        start, stop = self.chart.edges[course].tolist()
        return range(start + 1, stop + 1)

    def written(self) -> list[str]:
        """The lines from cast-on to end."""
        machine = self.machine
        wales = self.chart.wales
        if machine.waste_courses:
            # 1 × 1 rib lies flat and gives the rollers something to hold.
            self.on_front = np.arange(wales) % 2 == 0
            self._band("waste", machine.waste_carrier, machine.waste_courses, casts_on=True)
            self._move_to(np.ones(wales, bool), self.needles)
            # When this is drawn out, the sample parts from its waste.
            self._band("draw thread", machine.draw_carrier, 1)
        self.lines.append(";cast-on")
        self._take_stitch_size("body")
        self._bring_in(machine.body_carrier)
        self._tucks(machine.body_carrier, self.needles[:: self.inwards])
        self._plain_courses(machine.setup_courses, machine.body_carrier)
        for course in range(self.chart.courses):
            self._course(course)
        if machine.end == "bind_off":
            self._bind_off()
            return self.lines
        self._bring_out(machine.body_carrier)
        if machine.waste_courses:
            self._band("waste", machine.waste_carrier, machine.waste_courses)
        return [*self.lines, ";drop", *(f"drop {self._needle(each)}" for each in self.needles)]

    def _needle(self, number: int) -> Needle:
        """The needle that holds a wale."""
        return Needle(bool(self.on_front[number - 1]), number)

    def _take_stitch_size(self, use: str) -> None:
        number = getattr(self.machine, f"{use}_stitch_number")
        if number != self.stitch_number:
            self.lines.append(f"x-stitch-number {number}")
            self.stitch_number = number

    def _bring_in(self, carrier: int) -> None:
        """Bring a carrier in; its next stitch goes inwards, leftwards from the inserting hook."""
        self._release_hook()
        self.lines.append(f"{self.machine.bring_in} {carrier}")
        self.hooked = carrier if self.machine.hooks else None
        self.active.add(carrier)

    def _release_hook(self) -> None:
        if self.hooked is not None:
            self.lines.append(f"releasehook {self.hooked}")
            self.hooked = self.hook_from = None

    def _bring_out(self, carrier: int) -> None:
        self._release_hook()
        self.lines.append(f"{self.machine.bring_out} {carrier}")
        self.active.remove(carrier)

    def _form(self, opcode: str, direction: int, number: int, carriers: Sequence[int]) -> None:
        if self.hook_from is not None and number >= self.hook_from:
            self._release_hook()
        elif self.hooked in carriers and self.hook_from is None:
            self.hook_from = number + 1
        sign = "+" if direction == RIGHTWARD else "-"
        carried = " ".join(map(str, carriers))
        self.lines.append(f"{opcode} {sign} {self._needle(number)} {carried}")

    def _tucks(self, carrier: int, needles: range) -> None:
        """A cast-on of tucks on every second needle in order, and on the rest coming back."""
        for number in needles[::2]:
            self._form("tuck", needles.step, number, [carrier])
        for number in needles[1::2][::-1]:
            self._form("tuck", -needles.step, number, [carrier])
        self._release_hook()

    def _plain_courses(self, count: int, carrier: int) -> None:
        for _ in range(count):
            for number in self.needles[:: self.direction]:
                self._form("knit", self.direction, number, [carrier])
            self.direction = -self.direction

    def _move_to(self, front: Bool[np.ndarray, " wale"], needles: range) -> None:
        """Transfer the wales of some needles whose bed changes, and no other."""
        self._release_hook()
        here = np.zeros(self.chart.wales, bool)
        here[needles.start - 1 : needles.stop - 1] = True
        for to_front in (False, True):
            moved = np.flatnonzero(here & (self.on_front != front) & (front == to_front)) + 1
            self.lines += [
                f"xfer {Needle(not to_front, number)} {Needle(to_front, number)}"
                for number in moved.tolist()
            ]
        self.on_front = np.where(here, front, self.on_front)

    def _pass_on(self, needles: Sequence[int], shift: int) -> None:
        """Move the loops of needles onto others, ``shift`` needles away."""
        for to_front in (True, False):
            passed = [each for each in needles if self.on_front[each + shift - 1] == to_front]
            if not passed:
                continue
            self.lines += [
                f"xfer {self._needle(each)} {Needle(not to_front, each)}"
                for each in passed
                if self.on_front[each - 1] == to_front
            ]
            # At racking R, back needle B is opposite front needle B + R.
            self.lines.append(f"rack {shift if to_front else -shift}")
            self.lines += [
                f"xfer {Needle(not to_front, each)} {self._needle(each + shift)}" for each in passed
            ]
            self.lines.append("rack 0")

    def _band(self, name: str, carrier: int, courses: int, *, casts_on: bool = False) -> None:
        """Plain courses of a yarn that is brought in and taken out again, inwards first."""
        self.lines.append(f";{name}")
        self._take_stitch_size("waste")
        self._bring_in(carrier)
        if casts_on:
            self._tucks(carrier, self.needles[:: self.inwards])
        self.direction = self.inwards
        self._plain_courses(courses, carrier)
        self._bring_out(carrier)
        self.direction = self.inwards

    def _course(self, course: int) -> None:
        """One course, with a pass for every run of stitches of the same carriers."""
        plated = self.chart.plated[course]
        self.lines.append(f";course {course + 1}")
        self._shape(course)
        bound_off = self.shaping[course].bound_off
        needles = self.needles[:: self.direction]
        for electrode, run in groupby(needles, key=lambda number: int(plated[number - 1])):
            numbers = list(run)
            self._take_stitch_size("plated" if electrode else "body")
            if electrode and (conductor := self.machine.carrier_of(electrode)) not in self.active:
                self._bring_in(conductor)
                # The hook needs stitches leftwards first, and back ends one of this carrier alone:
                # tucks on the needles of the run, or one where the course goes leftwards itself.
                anchors = numbers[::-1][::2] if self.direction == RIGHTWARD else numbers[:1]
                for number in anchors:
                    self._form("tuck", LEFTWARD, number, [conductor])
            for number in numbers:
                carriers = [self.machine.body_carrier]
                if electrode:
                    front = self.on_front[number - 1]
                    face = self.chart.plated_face[electrode - 1]
                    first = self.machine.names_conductor_first(bool(front), face)
                    carriers.insert(0 if first else 1, self.machine.carrier_of(electrode))
                self._form("knit", self.direction, number, carriers)
                if number in bound_off:
                    self._pass_on([number], self.direction)
        for electrode in np.setdiff1d(plated, self.chart.plated[course + 1 :]).tolist():
            if electrode:
                self._bring_out(self.machine.carrier_of(electrode))
        self.direction = -self.direction

    def _shape(self, course: int) -> None:
        """From the needles and beds of the course before to those of a course."""
        here = self._needles_of(course)
        kept = range(max(here.start, self.needles.start), min(here.stop, self.needles.stop))
        front = self.chart.front[course]
        self._move_to(front, kept)
        changes = self.shaping[course]
        for needles, shift in changes.moved:
            self._pass_on(needles, shift)
        carrier = self.machine.body_carrier
        for number in changes.bound_off:
            if number not in here:
                self._form("knit", self.direction, number, [carrier])
                self._pass_on([number], self.direction)
        self._cast_on(changes.cast_on, front)
        if len(changes.cast_on) > 1:
            # The course begins at the outermost of these.
            for number in changes.cast_on:
                self._form("knit", -self.direction, number, [carrier])
        if changes.cast_on_ahead:
            self._cast_on(changes.cast_on_ahead, self.chart.front[course + 1])
        self.needles = here

    def _cast_on(self, needles: range, front: Bool[np.ndarray, " wale"]) -> None:
        """Cast needles on at an edge, on their beds."""
        wales = np.array(needles, int) - 1
        self.on_front[wales] = front[wales]
        self._tucks(self.machine.body_carrier, needles)

    def _bind_off(self) -> None:
        """A chain: every loop is moved onto its neighbour, and knitted with it."""
        carrier = self.machine.body_carrier
        self.lines.append(";bind-off")
        self._take_stitch_size("body")
        self._move_to(np.ones(self.chart.wales, bool), self.needles)
        order = self.needles[:: self.direction]
        self._form("knit", self.direction, order[0], [carrier])
        for number, following in pairwise(order):
            self._pass_on([number], following - number)
            self._form("knit", self.direction, following, [carrier])
        for _ in range(self.machine.bind_off_tail):
            self.direction = -self.direction
            self._form("knit", self.direction, order[-1], [carrier])
        self._bring_out(carrier)
        self.lines.append(f"drop f{order[-1]}")
