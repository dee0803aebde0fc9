"""Knit graphs: the stitches that a program forms, read as the stitches of a chart."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from knitlab.knitting.chart import Face, stitch_in_words
from knitlab.knitting.machine import Machine


class NotAChart(Exception):
    """A knit graph that is not a chart; its message says where and why."""


@dataclass(frozen=True)
class FormedStitch:
    """A stitch of a knit graph, formed on the needle at a position of the front or back bed.

    ``carriers`` are those of its loops, in the order of the operation; ``through`` are the numbers
    of the stitches that it was pulled through, none of a tuck.
    """

    position: int
    front: bool
    carriers: tuple[int, ...]
    through: tuple[int, ...]


def stitches_of(
    graph: Sequence[FormedStitch], size: tuple[int, int], machine: Machine
) -> np.ndarray:
    """Read the knit graph of a program as the stitches of a chart, in words, (course, wale).

    Every wale must be one chain of stitches of the body's yarn, each pulled through the one before
    at the same position, and every course must be finished before the next begins.

    Raises:
        NotAChart: if a wale is not whole, or a stitch is plated with more than one conductor.
    """
    courses, wales = size
    chains: dict[int, list[int]] = defaultdict(list)
    for number, stitch in enumerate(graph):
        if machine.carriers.body_carrier in stitch.carriers and stitch.through:
            chains[stitch.position].append(number)
    if sorted(chains) != list(range(1, wales + 1)):
        knitted = f"from {min(chains)} to {max(chains)}" if chains else "nowhere"
        raise NotAChart(f"the body is knitted on needles {knitted}, not from 1 to {wales}")
    first = machine.sections.setup_courses
    _check_counts({wale: len(chain) - first for wale, chain in chains.items()}, courses, machine)
    for position, chain in chains.items():
        for course in range(1, courses):
            before, number = chain[first + course - 1 : first + course + 1]
            if before not in graph[number].through:
                raise NotAChart(f"wale {position} is broken below course {course + 1}")
    made = np.array([chains[wale][first : first + courses] for wale in range(1, wales + 1)]).T
    late = np.flatnonzero(made[1:].min(axis=1) < made[:-1].max(axis=1))
    if len(late):
        raise NotAChart(f"course {late[0] + 2} begins before course {late[0] + 1} is finished")
    return np.array([[_in_words(graph[number], machine) for number in course] for course in made])


def _check_counts(counts: dict[int, int], courses: int, machine: Machine) -> None:
    """Check the stitches of wales; a bind-off knits one more in each, and its tail in the last."""
    bound_off = machine.sections.end == "bind_off"
    tail = machine.sections.bind_off_tail if bound_off else 0
    more = {wale: count - courses - bound_off for wale, count in counts.items()}
    wrong = [wale for wale, its in more.items() if its not in (0, tail)]
    if not wrong and sum(more.values()) != tail:
        wrong = [max(more, key=lambda wale: more[wale])]
    if wrong:
        count = courses + min(more[wrong[0]], more[wrong[0]] - tail, key=abs)
        raise NotAChart(f"wale {wrong[0]} has {count} stitches, not {courses}")


def _in_words(stitch: FormedStitch, machine: Machine) -> str:
    conductors = [each for each in stitch.carriers if each != machine.carriers.body_carrier]
    if not conductors:
        return stitch_in_words(stitch.front, 0, "front")
    carrier, *others = conductors
    if others or carrier not in machine.carriers.electrode_carriers:
        raise NotAChart(
            f"needle {stitch.position} knits carriers {' and '.join(map(str, stitch.carriers))},"
            " which are not a yarn of the body and one conductor"
        )
    electrode = machine.carriers.electrode_carriers.index(carrier) + 1
    named_first = stitch.carriers[0] == carrier
    on_loop_face = named_first == (machine.carriers.plating == "face_first")
    face: Face = "front" if on_loop_face == stitch.front else "back"
    return stitch_in_words(stitch.front, electrode, face)
