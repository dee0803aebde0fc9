"""The round trip: a program must knit the chart that it was written from.

It is checked by knitlab and, without what its grammar refuses, run by ``knitout-interpreter``.
"""

import warnings
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from knitlab.export.knitting.chart import Face, StitchChart, stitch_in_words
from knitlab.export.knitting.checks import FormedStitch, check
from knitlab.export.knitting.machine import Machine
from knitlab.export.knitting.program import operations
from knitlab.export.knitting.shaping import shaping

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
        message = f"interpreter: not run, as {length} operations take long; check fewer repeats"
        notes.append(f"{message}, or a smaller piece")
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
        different = chart.difference(chart_stitches(graph, chart, machine))
    except NotAChart as error:
        return [f"knits no chart: {error}"]
    return [f"knits another chart: {different}"] if different else []


class _Run(NamedTuple):
    """Consecutive stitches of a wale, and the stitch that its last loop is joined to."""

    start: int  # first course
    stop: int  # the one after its last
    before: int  # stitches that close its cast-on
    after: int  # of its bind-off, a course later
    joined: tuple[int, int] | None  # course and needle, None at the end of the chart

    @property
    def stitches(self) -> int:
        return self.before + self.stop - self.start + self.after


def _runs(chart: StitchChart, machine: Machine) -> dict[int, list[_Run]]:
    """The runs of every wale by its needle."""
    shaped = shaping(chart, machine.inwards, machine.largest_racking)
    runs: dict[int, list[_Run]] = {}
    for needle, wale in enumerate(chart.present.T, start=1):
        changes = np.flatnonzero(np.diff(wale, prepend=False, append=False)).reshape(-1, 2)
        runs[needle] = []
        for start, stop in changes.tolist():
            cast_on = shaped[start].cast_on
            before = int(needle in cast_on and len(cast_on) > 1) if start else machine.setup_courses
            if stop == chart.courses:
                runs[needle].append(_Run(start, stop, before, machine.end == "bind_off", None))
                continue
            moved = [shift for needles, shift in shaped[stop].moved if needle in needles]
            late = needle in shaped[stop].bound_off
            course = stop if moved or late else stop - 1
            shift = moved[0] if moved else shaped[course].bound_off.step
            runs[needle].append(_Run(start, stop, before, late, (course, needle + shift)))
    return {needle: several for needle, several in runs.items() if several}


def chart_stitches(
    graph: Sequence[FormedStitch], chart: StitchChart, machine: Machine
) -> np.ndarray:
    """A knit graph as stitches, in words, if each wale is one chain; else NotAChart.

    From the chart only its outline is taken.
    """
    chains: dict[int, list[int]] = defaultdict(list)
    for number, stitch in enumerate(graph):
        if machine.body_carrier in stitch.carriers and stitch.through:
            chains[stitch.position].append(number)
    runs = _runs(chart, machine)
    if sorted(chains) != sorted(runs):
        knitted = f"from {min(chains)} to {max(chains)}" if chains else "nowhere"
        wanted = f"from {min(runs)} to {max(runs)}"
        raise NotAChart(f"the body is knitted on needles {knitted}, not {wanted}")
    # The tail of a bind-off is in one wale of the last course.
    tail = machine.bind_off_tail if machine.end == "bind_off" else 0
    more = {w: len(chain) - sum(run.stitches for run in runs[w]) for w, chain in chains.items()}
    wrong = [w for w, n in more.items() if n and (n != tail or runs[w][-1].stop < chart.courses)]
    if not wrong and sum(more.values()) != tail:
        wrong = [max(more, key=lambda wale: more[wale])]
    if wrong:
        count = sum(run.stop - run.start for run in runs[wrong[0]])
        knitted_count = count + min(more[wrong[0]], more[wrong[0]] - tail, key=abs)
        raise NotAChart(f"wale {wrong[0]} has {knitted_count} stitches, not {count}")
    made = np.full((chart.courses + 1, chart.wales), -1)
    for wale, chain in chains.items():
        first = 0
        for run in runs[wale]:
            stitches = chain[first : first + run.stitches]
            first += run.stitches
            for course, (below, number) in enumerate(pairwise(stitches), run.start - run.before):
                if below not in graph[number].through:
                    raise NotAChart(f"wale {wale} is broken below course {course + 2}")
            made[run.start : run.stop + run.after, wale - 1] = stitches[run.before :]
    for wale, run in ((wale, run) for wale, several in runs.items() for run in several):
        if run.joined:
            course, target = run.joined
            last = made[run.stop + run.after - 1, wale - 1]
            if last not in graph[made[course, target - 1]].through:
                joined = f"wale {target} in course {course + 1}"
                raise NotAChart(f"wale {wale} is not joined to {joined}")
    made = np.where(chart.present, made[:-1], -1)
    begun = np.where(made < 0, len(graph), made).min(axis=1)
    late = np.flatnonzero(begun[1:] < made[:-1].max(axis=1))
    if len(late):
        raise NotAChart(f"course {late[0] + 2} begins before course {late[0] + 1} is finished")
    words = [["" if n < 0 else _in_words(graph[n], machine) for n in row] for row in made]
    return np.array(words)


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
