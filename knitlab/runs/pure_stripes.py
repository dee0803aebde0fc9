"""Pure stripes: the ``[stripes]`` of a workflow, and the case of each."""

from collections.abc import Iterator
from dataclasses import replace

from knitlab.io.errors import invalid
from knitlab.model.stripe import lengths_ratio
from knitlab.runs.case_settings import CaseSettings, Designs, Source, check_thickness
from knitlab.runs.parameters import Parameters
from knitlab.runs.workflow import StripesSection
from knitlab.solvers.case import Case

# A pure stripe has its ridges along x, whatever its knit, and is pulled across them along y.
PULLED_ACROSS = ("G",)


def stripe_designs(section: StripesSection, parameters: Parameters, source: Source) -> Designs:
    """The stripes of ``[stripes]``; sizes that only one knit has are excluded for the other."""
    there = {knit: list(parameters.stripes.rows(knit)) for knit in section.knit}
    sizes = sorted(set().union(*there.values()))
    if section.n and (strangers := sorted(set(section.n) - set(sizes))):
        message = f"there is no stripe of n = {strangers}; choose from {sizes}"
        raise invalid(source("stripes.n"), message)
    return {
        (knit, n, boundary): None
        if n in there[knit]
        else f"there is no {knit} stripe of n = {n}; choose from {there[knit]}"
        for knit in dict.fromkeys(section.knit)
        for n in sorted(set(section.n or there[knit]))
        for boundary in dict.fromkeys(section.boundaries)
    }


def stripe_cases(
    section: StripesSection, settings: CaseSettings, designs: Designs
) -> Iterator[Case]:
    """Cases of the stripes that exist."""
    for knit, n, boundary in (design for design, reason in designs.items() if reason is None):
        stripe = settings.stripe(knit, n)
        case = Case(
            design={"knit": knit, "n": n, "boundary": boundary, **settings.labels},
            weft=stripe,
            warp=stripe,
            options=replace(settings.options, boundary=boundary),
            pattern=PULLED_ACROSS,
            periods=section.stripe_periods,
            unit_cells=(1, 1),
            lengths_ratio=lengths_ratio(stripe, settings.sheet, settings.options),
            **settings.common,
        )
        check_thickness(case, settings.source)
        yield case.without_unused()
