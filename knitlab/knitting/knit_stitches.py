"""Stitches of a fabric, as charted or as read back from a knit graph. Needs no JAX."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Int

if TYPE_CHECKING:
    from knitlab.knitting.machine import Machine

ELECTRODES = ("A", "B")


def electrode_name(number: int) -> str:
    """Name of an electrode by its number in a chart, from 1."""
    return ELECTRODES[number - 1]


class NotAChart(Exception):
    """A knit graph that is not a chart; its message says where and why."""


@dataclass(frozen=True, eq=False)
class KnitStitches:
    """The stitches of a fabric, course 0 knitted first and wale 0 leftmost, seen from the front.

    Attributes:
        front: whether a stitch is knitted on the front bed.
        conductor: number of the electrode that it is plated for, negative where the conductor lies
            on the back of the fabric; 0 where it is not plated.
    """

    front: Bool[np.ndarray, "course wale"]
    conductor: Int[np.ndarray, "course wale"]

    def in_words(self, course: int, wale: int) -> str:
        """A stitch in words, by its indices from 0."""
        bed = "front" if self.front[course, wale] else "back"
        number = int(self.conductor[course, wale])
        if not number:
            return f"a {bed} knit"
        face = "front" if number > 0 else "back"
        return f"a {bed} knit of electrode {electrode_name(abs(number))}, conductor on the {face}"

    def difference(self, other: "KnitStitches") -> str | None:
        """The first stitch that differs from the others', in words; None if all are equal."""
        if self.front.shape != other.front.shape:
            here, there = (
                "{} courses of {} wales".format(*each.front.shape) for each in (self, other)
            )
            return f"there are {there}, not {here}"
        differs = (self.front != other.front) | (self.conductor != other.conductor)
        if not differs.any():
            return None
        course, wale = np.argwhere(differs)[0].tolist()
        here, there = (each.in_words(course, wale) for each in (self, other))
        return f"course {course + 1}, wale {wale + 1} is {there}, not {here}"


@dataclass(frozen=True)
class FormedStitch:
    """A stitch of a knit graph.

    Attributes:
        position: number of the needle that formed it.
        front: whether that is on the front bed.
        carriers: carriers of its loops, in the order of the operation.
        through: the stitches that it was pulled through, by their numbers; none of a tuck.
    """

    position: int
    front: bool
    carriers: tuple[int, ...]
    through: tuple[int, ...]


def stitches_of(
    graph: Sequence[FormedStitch], size: tuple[int, int], machine: "Machine"
) -> KnitStitches:
    """Read the knit graph of a program as the stitches of a chart.

    Every wale must be one chain of stitches of the body's yarn, each pulled through the one before
    at the same position, and every course must be finished before the next begins.

    Args:
        graph: its stitches in the order in which they were formed.
        size: courses and wales of the chart, which the graph does not tell from its edges.
        machine: its carriers, and the setup courses before the chart.

    Raises:
        NotAChart: if a wale is not whole, or a stitch is plated with more than one conductor.
    """
    body = machine.carriers.body_carrier
    courses, wales = size
    by_position: dict[int, list[int]] = defaultdict(list)
    for number, stitch in enumerate(graph):
        if body in stitch.carriers and stitch.through:
            by_position[stitch.position].append(number)
    if sorted(by_position) != list(range(1, wales + 1)):
        found = f"from {min(by_position)} to {max(by_position)}" if by_position else "nowhere"
        raise NotAChart(f"the body is knitted on needles {found}, not from 1 to {wales}")
    first = machine.sections.setup_courses
    _check_counts(
        {position: len(chain) - first for position, chain in by_position.items()}, courses, machine
    )
    made = np.zeros(size, int)
    for position, chain in by_position.items():
        for before, number in zip(chain[first:], chain[first + 1 : first + courses], strict=False):
            if before not in graph[number].through:
                course = chain.index(number) - first + 1
                raise NotAChart(f"wale {position} is broken below course {course}")
        made[:, position - 1] = chain[first : first + courses]
    late = np.flatnonzero(made[1:].min(axis=1) < made[:-1].max(axis=1))
    if len(late):
        raise NotAChart(f"course {late[0] + 2} begins before course {late[0] + 1} is finished")
    front, conductor = np.zeros(size, bool), np.zeros(size, int)
    for place in np.ndindex(*size):
        stitch = graph[int(made[place])]
        front[place] = stitch.front
        conductor[place] = _conductor(stitch, machine)
    return KnitStitches(front, conductor)


def _check_counts(counts: dict[int, int], courses: int, machine: "Machine") -> None:
    """Check that every wale has as many stitches as the chart has courses, and no more.

    A bind-off knits one more in each, and its tail in the last.

    Raises:
        NotAChart: if not.
    """
    bound_off = machine.sections.end == "bind_off"
    tail = machine.sections.bind_off_tail if bound_off else 0
    more = {position: count - courses - bound_off for position, count in counts.items()}
    wrong = [position for position, its in more.items() if its not in (0, tail)]
    if not wrong and sum(more.values()) != tail:
        wrong = [max(more, key=lambda position: more[position])]
    if wrong:
        position = wrong[0]
        found = courses + min(more[position], more[position] - tail, key=abs)
        raise NotAChart(f"wale {position} has {found} stitches, not {courses}")


def _conductor(stitch: FormedStitch, machine: "Machine") -> int:
    """Number of the electrode of a stitch, negative where its conductor lies on the back."""
    conductors = [
        carrier for carrier in stitch.carriers if carrier != machine.carriers.body_carrier
    ]
    if not conductors:
        return 0
    carrier, *others = conductors
    if others or carrier not in machine.carriers.electrode_carriers:
        raise NotAChart(
            f"needle {stitch.position} knits carriers {' and '.join(map(str, stitch.carriers))},"
            " which are not a yarn of the body and one conductor"
        )
    number = machine.carriers.electrode_carriers.index(carrier) + 1
    named_first = stitch.carriers[0] == carrier
    on_loop_face = named_first == (machine.carriers.plating == "face_first")
    return number if on_loop_face == stitch.front else -number
