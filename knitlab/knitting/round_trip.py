"""The round trip: a program must knit the chart that it was written from."""

from dataclasses import dataclass

from knitlab.knitting import interpreter
from knitlab.knitting.chart import StitchChart
from knitlab.knitting.checks import check
from knitlab.knitting.knit_stitches import NotAChart, stitches_of
from knitlab.knitting.machine import Machine
from knitlab.knitting.operations import operations

MOST_OPERATIONS = 20_000
"""Operations up to which the interpreter runs by default; it takes about 1 ms for each."""


@dataclass(frozen=True)
class RoundTrip:
    """What the checks of a program found.

    Attributes:
        faults: what is wrong, with the line where there is one.
        notes: what was checked, and what was not.
    """

    faults: tuple[str, ...]
    notes: tuple[str, ...]


def round_trip(
    program: str, chart: StitchChart, machine: Machine, interpret: bool | None = None
) -> RoundTrip:
    """Check a program, and compare what it knits with the chart.

    Args:
        program: the program.
        chart: the chart that it is to knit.
        machine: the machine.
        interpret: whether ``knitout-interpreter`` runs it too; by default if it is installed and
            the program is short enough for that to take less than a minute.
    """
    checked = check(program, machine)
    faults = [str(finding) for finding in checked.findings]
    count = f"{len(checked.graph)} stitches with waste, cast-on and end"
    try:
        different = chart.stitches.difference(
            stitches_of(checked.graph, chart.front.shape, machine)
        )
        faults += [f"knits another chart: {different}"] if different else []
    except NotAChart as error:
        faults.append(f"knits no chart: {error}")
    notes = [f"own checks: {count}, {len(faults)} faults"]
    length = sum(1 for _ in operations(program))
    if interpret is False or not interpreter.is_installed():
        notes.append("interpreter: not run; install it by pip install knitlab[knitting]")
    elif interpret is None and length > MOST_OPERATIONS:
        notes.append(f"interpreter: not run, as {length} operations take long; take fewer repeats")
    else:
        found = _interpreted(program, chart, machine)
        notes.append(f"interpreter: {count}, {len(found)} faults")
        faults += found
    return RoundTrip(tuple(faults), tuple(notes))


def _interpreted(program: str, chart: StitchChart, machine: Machine) -> list[str]:
    try:
        graph = interpreter.interpreted(program)
        different = chart.stitches.difference(stitches_of(graph, chart.front.shape, machine))
    except interpreter.Refused as error:
        return [f"the interpreter refuses it: {error}"]
    except NotAChart as error:
        return [f"the interpreter knits no chart: {error}"]
    return [f"the interpreter knits another chart: {different}"] if different else []
