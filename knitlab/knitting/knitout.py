"""Knitout of a stitch chart: cast-on, waste, body and end, as a documented subset of version 0.6.

The subset is ``inhook``, ``releasehook``, ``outhook``, ``tuck``, ``knit``, ``xfer``, ``rack`` and
``drop``, with the extensions ``x-stitch-number`` and ``x-speed-number``. Needles are numbered from
1 at the left. Courses are knitted leftwards and rightwards in turn, beginning leftwards, since the
inserting hook brings yarn in from the right.
"""

from collections.abc import Iterator
from itertools import groupby, pairwise

import numpy as np
from jaxtyping import Bool

from knitlab.io.errors import fault
from knitlab.knitting.chart import StitchChart
from knitlab.knitting.machine import Machine
from knitlab.knitting.writer import LEFTWARD, RIGHTWARD, Direction, KnitoutWriter, opposite

VERSION = 2
"""Version of the language that version 0.6 of its specification describes."""


def knitout(chart: StitchChart, machine: Machine) -> str:
    """The text of a knitout file that knits a chart.

    Args:
        chart: the chart.
        machine: the machine.

    Raises:
        BadInput: if the chart is wider than the machine.
    """
    if chart.wales > machine.bed.needles:
        repeat = chart.repeat[1]
        raise fault(
            f"chart of {chart.wales} wales",
            f"is wider than the {machine.bed.needles} needles of {machine.bed.model}; take"
            f" {machine.bed.needles // repeat} repeats of {repeat} wales, or another machine",
        )
    return "\n".join([*_header(chart, machine), *_Program(chart, machine).lines()]) + "\n"


def _header(chart: StitchChart, machine: Machine) -> Iterator[str]:
    carriers, stitches, yarns = machine.carriers, machine.stitches, machine.yarns
    yield f";!knitout-{VERSION}"
    yield f";;Machine: {machine.bed.model}"
    yield f";;Gauge: {machine.bed.needles_per_inch}"
    if machine.sections.waste_courses:
        yield f";;Yarn-{carriers.waste_carrier}: {yarns.waste_yarn} yellow"
        yield f";;Yarn-{carriers.draw_carrier}: draw-thread red"
    yield f";;Yarn-{carriers.body_carrier}: {yarns.body_yarn} white"
    for electrode in chart.electrodes:
        yield f";;Yarn-{machine.carrier_of(electrode)}: {yarns.conductive_yarn} grey"
    yield f";;Carriers: {' '.join(map(str, range(1, carriers.carriers + 1)))}"
    yield ";;Position: Center"
    yield f";;X-Design: {' '.join(chart.title.split())}"
    yield f";;X-Chart: {chart.courses} courses {chart.wales} wales"
    for use in ("waste", "body", "plated"):
        number, size = (getattr(stitches, f"{use}_stitch_{what}") for what in ("number", "size"))
        yield f";;X-Stitch-Number-{number}: {use} {size}"


class _Program:
    """The operations that knit a chart."""

    def __init__(self, chart: StitchChart, machine: Machine) -> None:
        self.chart, self.machine = chart, machine
        self.needles = range(1, chart.wales + 1)
        self.out = KnitoutWriter()
        self.on_front = np.ones(chart.wales, bool)
        self.direction: Direction = LEFTWARD

    def lines(self) -> list[str]:
        """The lines of the whole program."""
        sections = self.machine.sections
        self.out.lines.append(f"x-speed-number {self.machine.stitches.speed_number}")
        if sections.waste_courses:
            self._waste()
            self._draw_thread()
        self._cast_on()
        self._body()
        if sections.end == "bind_off":
            self._bind_off()
        else:
            self._drop()
        return self.out.lines

    def _towards(self, direction: Direction) -> range:
        """All needles in the order that the carriage passes them."""
        return self.needles if direction == RIGHTWARD else self.needles[::-1]

    def _tucks(self, carrier: int) -> None:
        """A cast-on of tucks on every second needle leftwards, and on the rest rightwards."""
        last = self.needles[-1]
        for direction, parity in ((LEFTWARD, 0), (RIGHTWARD, 1)):
            for number in self._towards(direction):
                if (last - number) % 2 == parity:
                    self.out.tuck(direction, bool(self.on_front[number - 1]), number, [carrier])
        self.out.release()

    def _plain_courses(self, count: int, carrier: int) -> None:
        """Courses over all wales, on the needles that hold them."""
        for _ in range(count):
            for number in self._towards(self.direction):
                front = bool(self.on_front[number - 1])
                self.out.knit(self.direction, front, number, [carrier])
            self.direction = opposite(self.direction)

    def _move_to(self, front: Bool[np.ndarray, " wale"]) -> None:
        """Transfer the wales whose bed changes, and no other."""
        for to_front in (False, True):
            moved = np.flatnonzero((self.on_front != front) & (front == to_front)) + 1
            self.out.transfer(to_front, moved.tolist())
        self.on_front = front.copy()

    def _waste(self) -> None:
        """Waste in 1 × 1 rib, which lies flat and gives the rollers something to hold."""
        carrier = self.machine.carriers.waste_carrier
        self.out.comment("waste")
        self.out.stitch_number(self.machine.stitches.waste_stitch_number)
        self.on_front = np.arange(self.chart.wales) % 2 == 0
        self.out.bring_in(carrier)
        self._tucks(carrier)
        self._plain_courses(self.machine.sections.waste_courses, carrier)
        self.out.bring_out(carrier)
        self._move_to(np.ones(self.chart.wales, bool))

    def _draw_thread(self) -> None:
        """One course of a thread that parts the sample from its waste when it is drawn out."""
        carrier = self.machine.carriers.draw_carrier
        self.out.comment("draw thread")
        self.out.bring_in(carrier)
        self._plain_courses(1, carrier)
        self.out.bring_out(carrier)
        self.direction = LEFTWARD

    def _cast_on(self) -> None:
        carrier = self.machine.carriers.body_carrier
        self.out.comment("cast-on")
        self.out.stitch_number(self.machine.stitches.body_stitch_number)
        self.out.bring_in(carrier)
        self._tucks(carrier)
        self._plain_courses(self.machine.sections.setup_courses, carrier)

    def _body(self) -> None:
        chart = self.chart
        last_course = {
            number: int(np.flatnonzero((chart.plated == number).any(axis=1))[-1])
            for number in chart.electrodes
        }
        for course in range(chart.courses):
            self.out.comment(f"course {course + 1}")
            self._move_to(chart.front[course])
            self._course(course)
            for electrode, last in last_course.items():
                if course == last:
                    self.out.bring_out(self.machine.carrier_of(electrode))
            self.direction = opposite(self.direction)

    def _course(self, course: int) -> None:
        """One course, with a pass for every run of stitches of the same carriers."""
        plated = self.chart.plated[course]
        stitches = self.machine.stitches
        for electrode, run in groupby(
            self._towards(self.direction), key=lambda number: int(plated[number - 1])
        ):
            numbers = list(run)
            self.out.stitch_number(
                stitches.plated_stitch_number if electrode else stitches.body_stitch_number
            )
            if electrode and not self.out.is_in(self.machine.carrier_of(electrode)):
                self._bring_in_conductor(self.machine.carrier_of(electrode), numbers)
            for number in numbers:
                front = bool(self.on_front[number - 1])
                carriers = self._carriers(electrode, front)
                self.out.knit(self.direction, front, number, carriers)

    def _bring_in_conductor(self, carrier: int, numbers: list[int]) -> None:
        """Bring a conductor in; before stitches rightwards, by tucks leftwards on their needles."""
        self.out.bring_in(carrier)
        if self.direction == RIGHTWARD:
            for number in numbers[::-1][::2]:
                self.out.tuck(LEFTWARD, bool(self.on_front[number - 1]), number, [carrier])

    def _carriers(self, electrode: int, front: bool) -> list[int]:
        """Carriers of a stitch.

        The face of a front loop is on the front of the fabric, and that of a back loop on its back.
        """
        body = self.machine.carriers.body_carrier
        if not electrode:
            return [body]
        conductor = self.machine.carrier_of(electrode)
        on_face = (self.chart.plated_face[electrode - 1] == "front") == front
        pair = [conductor, body] if on_face else [body, conductor]
        return pair if self.machine.carriers.plating == "face_first" else pair[::-1]

    def _bind_off(self) -> None:
        """A chain: every loop is moved onto its neighbour, and knitted with it."""
        carrier = [self.machine.carriers.body_carrier]
        self.out.comment("bind-off")
        self.out.stitch_number(self.machine.stitches.body_stitch_number)
        self._move_to(np.ones(self.chart.wales, bool))
        order = self._towards(self.direction)
        self.out.knit(self.direction, True, order[0], carrier)
        for number, following in pairwise(order):
            self.out.rack(0)
            self.out.transfer(False, [number])
            self.out.move(False, number, following)
            self.out.rack(0)
            self.out.knit(self.direction, True, following, carrier)
        for _ in range(self.machine.sections.bind_off_tail):
            self.direction = opposite(self.direction)
            self.out.knit(self.direction, True, order[-1], carrier)
        self.out.bring_out(*carrier)
        self.out.drop(True, order[-1])

    def _drop(self) -> None:
        """Waste on the live loops, and that is dropped."""
        self.out.bring_out(self.machine.carriers.body_carrier)
        carrier = self.machine.carriers.waste_carrier
        if self.machine.sections.waste_courses:
            self.out.comment("waste")
            self.out.stitch_number(self.machine.stitches.waste_stitch_number)
            self.out.bring_in(carrier)
            self.direction = LEFTWARD
            self._plain_courses(self.machine.sections.waste_courses, carrier)
            self.out.bring_out(carrier)
        self.out.comment("drop")
        for number in self.needles:
            self.out.drop(bool(self.on_front[number - 1]), number)
