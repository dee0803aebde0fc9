"""The design space: which (n_stripe, n_subunit) a workflow asks for, and which are possible."""

from collections.abc import Callable
from dataclasses import dataclass

from knitlab.sweep.faults import BadInput, Fault, fault
from knitlab.sweep.parameters import Parameters
from knitlab.sweep.workflow import DesignSection

Design = tuple[int, int]
Source = Callable[[str], str]
DEFAULT_SET = "paper"


@dataclass(frozen=True)
class DesignSpace:
    """Designs of a sweep, on the grid of a cube.

    Attributes:
        designs: (n_stripe, n_subunit) to simulate, ordered.
        excluded: combinations of a grid that no fabric can have, with the reason.
    """

    designs: tuple[Design, ...]
    excluded: dict[Design, str]


def design_space(section: DesignSection, parameters: Parameters, source: Source) -> DesignSpace:
    """Resolve a workflow's ``[design]``.

    Impossible combinations of a grid are excluded.

    Args:
        section: what the workflow says.
        parameters: the stripes and sets there are.
        source: says where a ``section.key`` comes from, for a fault.

    Raises:
        BadInput: if a set or a member asked for does not exist, if a single design that was
            asked for is impossible, or if no design is left.
    """
    name, sets = section.set or DEFAULT_SET, parameters.designs.root
    if name not in sets:
        raise fault(source("design.set"), f"there is no set {name!r}; choose of {sorted(sets)}")
    if section.n_stripe is not None and section.n_subunit is not None:
        return _grid(section.n_stripe, section.n_subunit, parameters, source)
    return _members(section, name, sets[name].pairs, source)


def _grid(
    n_stripe: tuple[int, ...], n_subunit: tuple[int, ...], parameters: Parameters, source: Source
) -> DesignSpace:
    pairs = sorted({(n, m) for n in n_stripe for m in n_subunit})
    reasons = {pair: parameters.impossible(*pair) for pair in pairs}
    excluded = {pair: reason for pair, reason in reasons.items() if reason}
    if len(excluded) == len(pairs):
        asked = ", ".join(dict.fromkeys(map(source, ("design.n_stripe", "design.n_subunit"))))
        raise BadInput(Fault(asked, reason) for reason in dict.fromkeys(excluded.values()))
    return DesignSpace(tuple(pair for pair in pairs if pair not in excluded), excluded)


def _members(
    section: DesignSection, name: str, pairs: tuple[Design, ...], source: Source
) -> DesignSpace:
    faults = []
    for key, place in (("n_stripe", 0), ("n_subunit", 1)):
        wanted = getattr(section, key)
        if wanted is None:
            continue
        members = {pair[place] for pair in pairs}
        other = "n_subunit" if key == "n_stripe" else "n_stripe"
        faults += [
            Fault(
                source(f"design.{key}"),
                f"set {name!r} has no {key} = {value}; choose of {sorted(members)},"
                f" or give {other} too for a grid of your own",
            )
            for value in wanted
            if value not in members
        ]
        pairs = tuple(pair for pair in pairs if pair[place] in wanted)
    if faults:
        raise BadInput(faults)
    return DesignSpace(tuple(sorted(pairs)), {})
