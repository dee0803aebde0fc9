"""The round trip: knitout run by ``knitout-interpreter``, whose knit graph is read back.

The interpreter is an optional extra. Its grammar refuses extensions (``x-…``), the headers of
yarns, and machines but one, so that it is given a copy without these.
"""

import warnings
from collections import defaultdict
from importlib.util import find_spec
from typing import Any

from knitlab.knitting.knit_stitches import FormedStitch
from knitlab.knitting.operations import headers

KNOWN_MACHINE = "SWG091N2"
"""The only machine of the interpreter."""
KNOWN_HEADERS = ("Gauge", "Carriers", "Position")


class Refused(Exception):
    """A program that the interpreter refuses; its message is the interpreter's."""


def is_installed() -> bool:
    """Whether the interpreter is there."""
    return find_spec("knitout_interpreter") is not None


def stripped(text: str) -> str:
    """A program without what the grammar of the interpreter refuses.

    Every line keeps its number, so that messages name lines of the original.
    """
    first, *lines = text.split("\n")
    count = len(headers(text))
    kept = [first]
    for place, line in enumerate(lines):
        operation = line.partition(";")[0].strip()
        if place >= count:
            kept.append("" if operation.startswith("x-") else operation)
        elif line.startswith(";;Machine:"):
            kept.append(f";;Machine: {KNOWN_MACHINE}")
        else:
            name = line[2:].partition(":")[0]
            kept.append(line if name in KNOWN_HEADERS else "")
    return "\n".join(kept)


def interpreted(text: str) -> list[FormedStitch]:
    """The knit graph that the interpreter builds of a program.

    Args:
        text: the program.

    Returns:
        Its stitches, in the order in which they were formed.

    Raises:
        Refused: if the interpreter refuses the program, or warns of a stitch on an empty needle, or
            if loops are left on the needles.
    """
    from knitout_interpreter.knitout_execution import Knitout_Executer
    from knitout_interpreter.knitout_language.Knitout_Parser import parse_knitout
    from virtual_knitting_machine.knitting_machine_warnings.Needle_Warnings import (
        Knit_on_Empty_Needle_Warning,
    )

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        warnings.simplefilter("error", Knit_on_Empty_Needle_Warning)
        try:
            executer: Any = Knitout_Executer(parse_knitout(stripped(text)))
        except Exception as error:  # it raises errors of many kinds, and its warnings
            raise Refused(" ".join(str(error).split()) or type(error).__name__) from error
    if left := executer.knitting_machine.all_loops():
        raise Refused(f"{len(left)} needles hold loops at the end, one of them {left[0]}")
    return _formed(executer.resulting_knit_graph)


def _formed(graph: Any) -> list[FormedStitch]:
    """Stitches of a graph: loops that one operation formed on a needle, together."""
    parents: dict[int, list[int]] = defaultdict(list)
    pulled_to_front: dict[int, bool] = {}
    for parent, child, direction in graph.stitch_iter:
        parents[child.loop_count_on_machine].append(parent.loop_count_on_machine)
        pulled_to_front[child.loop_count_on_machine] = direction.name == "BtF"
    stitches: list[FormedStitch] = []
    stitch_of_loop: dict[int, int] = {}
    loops = sorted(graph.sorted_loops, key=lambda loop: int(loop.loop_count_on_machine))
    for loop in loops:
        number, carrier = loop.loop_count_on_machine, int(loop.yarn.carrier.carrier_id)
        needle = loop.source_needle
        through = tuple(sorted({stitch_of_loop[each] for each in parents[number]}))
        front = pulled_to_front.get(number, needle.is_front)
        if stitches and through and stitches[-1].through == through:
            # A second yarn of the same operation.
            carriers = (*stitches[-1].carriers, carrier)
            stitches[-1] = FormedStitch(needle.position, front, carriers, through)
        else:
            stitches.append(FormedStitch(needle.position, front, (carrier,), through))
        stitch_of_loop[number] = len(stitches) - 1
    return stitches
