"""Lead-outs of electrodes: where a program brings the yarn of each in, and takes it out.

An end at an edge of the fabric leaves there. An end inside must be led to an edge over the back,
which the model does not contain.
"""

from bisect import bisect
from collections.abc import Iterator
from typing import Literal, NamedTuple

import numpy as np

from knitlab.export.knitting.chart import StitchChart, electrode_name
from knitlab.export.knitting.machine import Machine
from knitlab.export.knitting.program import DIRECTED, operations

Edge = Literal["lower", "upper", "left", "right"]
COURSE = ";course "


class Lead(NamedTuple):
    """An end of the yarn of an electrode: its stitch, and the way from there to an edge."""

    electrode: int  # 1 A, 2 B
    enters: bool  # whether the yarn is brought in here, or taken out
    course: int  # of its stitch, from 0
    wale: int
    edge: Edge  # where it leaves the fabric
    distance: int  # stitches between its stitch and this edge, 0 if it leaves where it is

    @property
    def name(self) -> str:
        """The electrode, and which end."""
        return f"lead {electrode_name(self.electrode)} {'in' if self.enters else 'out'}"

    def __str__(self) -> str:
        where = f"course {self.course + 1}, wale {self.wale + 1}"
        if not self.distance:
            return f"{where}: leaves at the {self.edge} edge"
        stitches = "stitch" if self.distance == 1 else "stitches"
        return f"{where}: inside, {self.distance} {stitches} from the {self.edge} edge"


def leads(program: str, chart: StitchChart, machine: Machine) -> list[Lead]:
    """Where the yarn of each electrode of a chart enters and leaves, by electrode."""
    ends: dict[int, list[tuple[int, int]]] = {}
    of_carrier = {machine.carrier_of(electrode): electrode for electrode in chart.electrodes}
    for course, carriers, wale in _formed(program):
        for electrode in (of_carrier[each] for each in carriers if each in of_carrier):
            first, _ = ends.setdefault(electrode, [(course, wale)] * 2)
            ends[electrode] = [first, (course, wale)]
    return [
        Lead(electrode, enters, course, wale, *_way_out(chart, electrode, course, wale))
        for electrode, stitches in sorted(ends.items())
        for enters, (course, wale) in zip((True, False), stitches, strict=True)
    ]


def _formed(program: str) -> Iterator[tuple[int, tuple[int, ...], int]]:
    starts = [k for k, line in enumerate(program.split("\n"), 1) if line.startswith(COURSE)]
    for operation in operations(program):
        if operation.opcode in DIRECTED and operation.line > starts[0]:
            course = bisect(starts, operation.line) - 1
            yield course, tuple(map(int, operation.carriers)), operation.needles[0].number - 1


def _way_out(chart: StitchChart, electrode: int, course: int, wale: int) -> tuple[Edge, int]:
    """The nearest edge in a straight line clear of the other electrode, and its distance."""
    along_wale = chart.plated[:, wale]
    along_course = chart.plated[course]
    ways: dict[Edge, np.ndarray] = {
        "lower": along_wale[:course],
        "upper": along_wale[course + 1 :],
        "left": along_course[:wale],
        "right": along_course[wale + 1 :],
    }
    clear = {edge: way for edge, way in ways.items() if np.isin(way, (0, electrode)).all()}
    edge = min(clear or ways, key=lambda each: len(ways[each]))
    return edge, len(ways[edge])
