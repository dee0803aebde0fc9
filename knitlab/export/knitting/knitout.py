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
from knitlab.io.errors import invalid

VERSION = 2  # version of the language that version 0.6 of its specification describes
LEFTWARD, RIGHTWARD = -1, 1  # directions of the carriage, as steps from needle to needle


def knitout(chart: StitchChart, machine: Machine) -> str:
    """The text of a knitout file that knits a chart; InputError if it is wider than the machine."""
    if chart.wales > machine.needles:
        message = f"is wider than the {machine.needles} needles of {machine.model}"
        fitting = f"{machine.needles // chart.repeat[1]} repeats of {chart.repeat[1]} wales"
        path = f"chart of {chart.wales} wales"
        raise invalid(path, f"{message}; take {fitting}, or another machine")
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
        self.needles = range(1, chart.wales + 1)
        self.lines = [f"x-speed-number {machine.speed_number}"]
        self.on_front = np.ones(chart.wales, bool)
        self.inwards = LEFTWARD if machine.hooks else RIGHTWARD  # from where carriers come
        self.direction = self.inwards
        self.stitch_number: int | None = None
        self.active: set[int] = set()
        # No carrier may pass the inserting hook, which parks right of the first stitch of its own.
        # It is released late, so that many stitches hold the end of the yarn.
        self.hooked: int | None = None
        self.hook_from: int | None = None

    def written(self) -> list[str]:
        """The lines from cast-on to end."""
        machine = self.machine
        wales = self.chart.wales
        if machine.waste_courses:
            # 1 × 1 rib lies flat and gives the rollers something to hold.
            self.on_front = np.arange(wales) % 2 == 0
            self._band("waste", machine.waste_carrier, machine.waste_courses, casts_on=True)
            self._move_to(np.ones(wales, bool))
            # When this is drawn out, the sample parts from its waste.
            self._band("draw thread", machine.draw_carrier, 1)
        self.lines.append(";cast-on")
        self._take_stitch_size("body")
        self._bring_in(machine.body_carrier)
        self._tucks(machine.body_carrier)
        self._plain_courses(machine.setup_courses, machine.body_carrier)
        for course in range(self.chart.courses):
            self._course(course)
        if machine.end == "bind_off":
            self._bind_off()
            return self.lines
        self._bring_out(machine.body_carrier)
        if machine.waste_courses:
            self._band("waste", machine.waste_carrier, machine.waste_courses)
        dropped = (f"drop {needle}" for needle in map(Needle, self.on_front, self.needles))
        return [*self.lines, ";drop", *dropped]

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
        needle = Needle(bool(self.on_front[number - 1]), number)
        self.lines.append(f"{opcode} {sign} {needle} {' '.join(map(str, carriers))}")

    def _tucks(self, carrier: int) -> None:
        """A cast-on of tucks on every second needle inwards, and on the rest outwards."""
        order = self.needles[:: self.inwards]
        for number in order[::2]:
            self._form("tuck", self.inwards, number, [carrier])
        for number in order[1::2][::-1]:
            self._form("tuck", -self.inwards, number, [carrier])
        self._release_hook()

    def _plain_courses(self, count: int, carrier: int) -> None:
        for _ in range(count):
            for number in self.needles[:: self.direction]:
                self._form("knit", self.direction, number, [carrier])
            self.direction = -self.direction

    def _move_to(self, front: Bool[np.ndarray, " wale"]) -> None:
        """Transfer the wales whose bed changes, and no other."""
        self._release_hook()
        for to_front in (False, True):
            moved = np.flatnonzero((self.on_front != front) & (front == to_front)) + 1
            self.lines += [
                f"xfer {Needle(not to_front, number)} {Needle(to_front, number)}"
                for number in moved.tolist()
            ]
        self.on_front = front

    def _band(self, name: str, carrier: int, courses: int, *, casts_on: bool = False) -> None:
        """Plain courses of a yarn that is brought in and taken out again, inwards first."""
        self.lines.append(f";{name}")
        self._take_stitch_size("waste")
        self._bring_in(carrier)
        if casts_on:
            self._tucks(carrier)
        self.direction = self.inwards
        self._plain_courses(courses, carrier)
        self._bring_out(carrier)
        self.direction = self.inwards

    def _course(self, course: int) -> None:
        """One course, with a pass for every run of stitches of the same carriers."""
        plated = self.chart.plated[course]
        self.lines.append(f";course {course + 1}")
        self._move_to(self.chart.front[course])
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
        for electrode in np.setdiff1d(plated, self.chart.plated[course + 1 :]).tolist():
            if electrode:
                self._bring_out(self.machine.carrier_of(electrode))
        self.direction = -self.direction

    def _bind_off(self) -> None:
        """A chain: every loop is moved onto its neighbour, and knitted with it."""
        carrier = self.machine.body_carrier
        self.lines.append(";bind-off")
        self._take_stitch_size("body")
        self._move_to(np.ones(self.chart.wales, bool))
        order = self.needles[:: self.direction]
        self._form("knit", self.direction, order[0], [carrier])
        for number, following in pairwise(order):
            # At racking R, back needle B is opposite front needle B + R.
            self.lines += [f"xfer f{number} b{number}", f"rack {following - number}"]
            self.lines += [f"xfer b{number} f{following}", "rack 0"]
            self._form("knit", self.direction, following, [carrier])
        for _ in range(self.machine.bind_off_tail):
            self.direction = -self.direction
            self._form("knit", self.direction, order[-1], [carrier])
        self._bring_out(carrier)
        self.lines.append(f"drop f{order[-1]}")
