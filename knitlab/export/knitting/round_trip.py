"""The round trip: a program must knit the chart that it was written from.

It is checked by knitlab and, without what its grammar refuses, run by ``knitout-interpreter``.
"""

import warnings
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import numpy as np

from knitlab.export.knitting.chart import Face, StitchChart, stitch_in_words
from knitlab.export.knitting.checks import FormedStitch, check
from knitlab.export.knitting.machine import Machine
from knitlab.export.knitting.program import operations

MAX_OPERATIONS = 20_000  # up to which the interpreter runs by default, at about 1 ms each
KNOWN_MACHINE = "SWG091N2"  # the only machine of the interpreter
KNOWN_HEADERS = (";;Gauge:", ";;Carriers:", ";;Position:")


class NotAChart(Exception):
    """A knit graph that is not a chart, or a program that the interpreter refuses, with why."""


@dataclass(frozen=True)
class RoundTrip:
    """What the checks of a program found: ``mistakes``, and ``notes`` of what was checked."""

    mistakes: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def faults(self) -> tuple[str, ...]:
        """Deprecated: ``mistakes``."""
        return self.mistakes


def round_trip(
    program: str, chart: StitchChart, machine: Machine, interpret: bool | None = None
) -> RoundTrip:
    """Check a program, and compare what it knits with the chart; see :meth:`.KnitSample.check`."""
    own, graph = check(program, machine)
    mistakes = [*map(str, own), *_differences(graph, chart, machine)]
    count = f"{len(graph)} stitches with waste, cast-on and end"
    notes = [f"own checks: {count}, {len(mistakes)} mistakes"]
    length = sum(1 for _ in operations(program))
    if interpret is False or not find_spec("knitout_interpreter"):
        notes.append("interpreter: not run; install it by pip install knitlab[knitting]")
    elif interpret is None and length > MAX_OPERATIONS:
        notes.append(f"interpreter: not run, as {length} operations take long; check fewer repeats")
    else:
        try:
            differences = _differences(interpreted(program), chart, machine)
        except NotAChart as error:
            differences = [f"refuses it: {error}"]
        notes.append(f"interpreter: {count}, {len(differences)} mistakes")
        mistakes += [f"the interpreter {each}" for each in differences]
    return RoundTrip(tuple(mistakes), tuple(notes))


def _differences(graph: Sequence[FormedStitch], chart: StitchChart, machine: Machine) -> list[str]:
    try:
        different = chart.difference(chart_stitches(graph, chart.front.shape, machine))
    except NotAChart as error:
        return [f"knits no chart: {error}"]
    return [f"knits another chart: {different}"] if different else []


def chart_stitches(
    graph: Sequence[FormedStitch], size: tuple[int, int], machine: Machine
) -> np.ndarray:
    """A knit graph as stitches of a chart, in words, if each wale is one chain; else NotAChart."""
    courses, wales = size
    chains: dict[int, list[int]] = defaultdict(list)
    for number, stitch in enumerate(graph):
        if machine.body_carrier in stitch.carriers and stitch.through:
            chains[stitch.position].append(number)
    if sorted(chains) != list(range(1, wales + 1)):
        knitted = f"from {min(chains)} to {max(chains)}" if chains else "nowhere"
        raise NotAChart(f"the body is knitted on needles {knitted}, not from 1 to {wales}")
    first = machine.setup_courses
    bound_off = machine.end == "bind_off"
    # A bind-off knits one more stitch in each wale, and its tail in the last.
    tail = machine.bind_off_tail if bound_off else 0
    more = {wale: len(chain) - first - courses - bound_off for wale, chain in chains.items()}
    wrong = [wale for wale, extra in more.items() if extra not in (0, tail)]
    if not wrong and sum(more.values()) != tail:
        wrong = [max(more, key=lambda wale: more[wale])]
    if wrong:
        count = courses + min(more[wrong[0]], more[wrong[0]] - tail, key=abs)
        raise NotAChart(f"wale {wrong[0]} has {count} stitches, not {courses}")
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


def _in_words(stitch: FormedStitch, machine: Machine) -> str:
    conductors = [each for each in stitch.carriers if each != machine.body_carrier]
    if not conductors:
        return stitch_in_words(stitch.front, 0, "front")
    carrier, *others = conductors
    if others or carrier not in machine.electrode_carriers:
        names = " and ".join(map(str, stitch.carriers))
        message = f"needle {stitch.position} knits carriers {names}, not the body's carrier and one"
        raise NotAChart(f"{message} conductor")
    is_first = stitch.carriers[0] == carrier
    on_front = is_first == machine.names_conductor_first(stitch.front, "front")
    face: Face = "front" if on_front else "back"
    return stitch_in_words(stitch.front, machine.electrode_carriers.index(carrier) + 1, face)


def stripped(text: str) -> str:
    """A program without what the grammar of the interpreter refuses; lines keep their numbers."""
    first, *lines = text.split("\n")
    kept = [first]
    for line in lines:
        operation = line.partition(";")[0].strip()
        if line.startswith(";;Machine:"):
            operation = f";;Machine: {KNOWN_MACHINE}"
        elif line.startswith(KNOWN_HEADERS):
            operation = line.strip()
        kept.append("" if operation.startswith("x-") else operation)
    return "\n".join(kept)


def interpreted(text: str) -> list[FormedStitch]:
    """The stitches that the interpreter forms; NotAChart also if loops are left over."""
    from knitout_interpreter.knitout_execution import Knitout_Executer
    from knitout_interpreter.knitout_language.Knitout_Parser import parse_knitout
    from virtual_knitting_machine.knitting_machine_warnings import Needle_Warnings

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        warnings.simplefilter("error", Needle_Warnings.Knit_on_Empty_Needle_Warning)
        try:
            executer: Any = Knitout_Executer(parse_knitout(stripped(text)))
        except Exception as error:  # it raises errors of many kinds, and its warnings
            raise NotAChart(" ".join(str(error).split()) or type(error).__name__) from error
    if left := executer.knitting_machine.all_loops():
        raise NotAChart(f"{len(left)} needles hold loops at the end, one of them {left[0]}")
    graph = executer.resulting_knit_graph
    parents: dict[int, list[int]] = defaultdict(list)
    pulled_to_front: dict[int, bool] = {}
    for parent, child, direction in graph.stitch_iter:
        parents[child.loop_count_on_machine].append(parent.loop_count_on_machine)
        pulled_to_front[child.loop_count_on_machine] = direction.name == "BtF"
    # Loops that one operation formed on a needle are one stitch.
    stitches: list[FormedStitch] = []
    stitch_of_loop: dict[int, int] = {}
    for loop in sorted(graph.sorted_loops, key=lambda each: int(each.loop_count_on_machine)):
        number = loop.loop_count_on_machine
        needle = loop.source_needle
        carriers: tuple[int, ...] = (int(loop.yarn.carrier.carrier_id),)
        through = tuple(sorted({stitch_of_loop[each] for each in parents[number]}))
        if stitches and through and stitches[-1].through == through:
            # A second yarn of the same operation.
            carriers = (*stitches.pop().carriers, *carriers)
        front = pulled_to_front.get(number, needle.is_front)
        stitches.append(FormedStitch(needle.position, front, carriers, through))
        stitch_of_loop[number] = len(stitches) - 1
    return stitches
