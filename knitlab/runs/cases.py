"""The designs of a workflow, which of them are possible, and the case of each.

Two sections of a workflow make cases, each in a module of its own: :data:`KINDS`.
"""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from knitlab.model.electrodes import BadLayout
from knitlab.runs.case_settings import CaseSettings, Designs, Source
from knitlab.runs.checkerboards import checkerboard_cases, checkerboard_designs
from knitlab.runs.parameters import Parameters
from knitlab.runs.pure_stripes import stripe_cases, stripe_designs
from knitlab.solvers.case import Case


class Kind(NamedTuple):
    """A kind of case: its designs, by its section of a workflow, and their cases."""

    designs: Callable[[Any, Parameters, Source], Designs]
    cases: Callable[[Any, CaseSettings, Designs], Iterator[Case]]


KINDS: dict[str, Kind] = {
    "design": Kind(checkerboard_designs, checkerboard_cases),
    "stripes": Kind(stripe_designs, stripe_cases),
}
"""The kinds of cases, by the section of a workflow that asks for them."""


def cases(settings: CaseSettings, designs: Designs) -> Iterator[Case]:
    """Cases of the possible designs; InputError if settings contradict each other."""
    settings.check()
    for name, kind in KINDS.items():
        if (section := getattr(settings.workflow, name)) is not None:
            yield from kind.cases(section, settings, designs)


def electrode_problems(case: Case) -> tuple[str, ...]:
    """What is wrong with the layout of the electrodes of a case; nothing if it has none."""
    try:
        _ = case.capacitor and case.electrodes
    except BadLayout as error:
        return tuple(error.messages)
    return ()
