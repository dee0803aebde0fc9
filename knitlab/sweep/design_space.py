"""The design space: the designs of a workflow, which of them are possible, and their size."""

from collections.abc import Callable
from dataclasses import dataclass

from knitlab.fabric.stripe import GARTER_STITCHES_PER_RIB_STITCH
from knitlab.io.errors import BadInput, Fault, fault
from knitlab.simulation.case import Label
from knitlab.sweep.parameters import Parameters
from knitlab.sweep.workflow import DesignSection, StripesSection

Design = tuple[Label, ...]
Pair = tuple[int, int]
Source = Callable[[str], str]
"""Names where a ``section.key`` comes from, for a fault."""
DEFAULT_SET = "paper"


@dataclass(frozen=True)
class DesignSpace:
    """Labels of the designs to simulate, and impossible combinations of their grid with the reason.

    They are (n_stripe, n_subunit) of a checkerboard, (knit, n, boundary) of a pure stripe.
    """

    designs: tuple[Design, ...]
    excluded: dict[Design, str]


def design_space(section: DesignSection, parameters: Parameters, source: Source) -> DesignSpace:
    """Resolve a workflow's ``[design]``; impossible combinations of a grid are excluded.

    Raises:
        BadInput: if a set or a member of it does not exist, or if no design is left.
    """
    name, sets = section.set or DEFAULT_SET, parameters.designs.root
    if name not in sets:
        raise fault(source("design.set"), f"there is no set {name!r}; choose from {sorted(sets)}")
    if section.n_stripe is None or section.n_subunit is None:
        return _members(section, name, sets[name].pairs, source)
    pairs = sorted({(n, m) for n in section.n_stripe for m in section.n_subunit})
    reasons = {pair: parameters.stripes.impossible(*pair) for pair in pairs}
    excluded: dict[Design, str] = {pair: reason for pair, reason in reasons.items() if reason}
    if len(excluded) == len(pairs):
        asked = ", ".join(dict.fromkeys(map(source, ("design.n_stripe", "design.n_subunit"))))
        raise BadInput(Fault(asked, reason) for reason in dict.fromkeys(excluded.values()))
    return DesignSpace(tuple(pair for pair in pairs if pair not in excluded), excluded)


def _members(
    section: DesignSection, name: str, pairs: tuple[Pair, ...], source: Source
) -> DesignSpace:
    faults = []
    for key, place in (("n_stripe", 0), ("n_subunit", 1)):
        wanted = getattr(section, key)
        if wanted is None:
            continue
        members = sorted({pair[place] for pair in pairs})
        other = "n_subunit" if key == "n_stripe" else "n_stripe"
        remedy = f"choose from {members}, or give {other} too for a grid of your own"
        faults += [
            Fault(source(f"design.{key}"), f"set {name!r} has no {key} = {value}; {remedy}")
            for value in wanted
            if value not in members
        ]
        pairs = tuple(pair for pair in pairs if pair[place] in wanted)
    if faults:
        raise BadInput(faults)
    return DesignSpace(tuple(sorted(pairs)), {})


def stripe_space(section: StripesSection, parameters: Parameters, source: Source) -> DesignSpace:
    """Resolve a workflow's ``[stripes]``: all stripes of the tables, or those of given sizes.

    If only one knit has a stripe of some size, this size is excluded for the other knit.
    """
    there = {knit: sorted(map(int, parameters.stripes.table(knit).n)) for knit in section.knit}
    sizes = sorted(set().union(*there.values()))
    if section.n and (strangers := sorted(set(section.n) - set(sizes))):
        problem = f"there is no stripe of n = {strangers}; choose from {sizes}"
        raise fault(source("stripes.n"), problem)
    asked = [
        (knit, n, boundary)
        for knit in dict.fromkeys(section.knit)
        for n in sorted(set(section.n or sizes))
        for boundary in dict.fromkeys(section.boundaries)
    ]
    excluded: dict[Design, str] = {
        (knit, n, boundary): f"there is no {knit} stripe of n = {n}; choose from {there[knit]}"
        for knit, n, boundary in asked
        if n not in there[knit] and section.n
    }
    return DesignSpace(tuple(design for design in asked if design[1] in there[design[0]]), excluded)


def sample_size(section: DesignSection, stitches: tuple[int, int]) -> tuple[int, int]:
    """Repeats of a pattern of (courses, wales) in a sample along (y, x) (paper, "Kinematics").

    Two courses count as long as a wale is wide.
    """
    if section.needles is None:
        return section.unit_cells or (1, 1)
    courses, wales = stitches
    along_x = max(1, int(section.needles * section.scale // wales))
    length = section.aspect * along_x * wales
    return max(1, round(length * GARTER_STITCHES_PER_RIB_STITCH / courses)), along_x
