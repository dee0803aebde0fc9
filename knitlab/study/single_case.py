"""A single case from a design and settings, without a workflow file."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

from knitlab.io.errors import BadInput, Fault, fault
from knitlab.io.shipped import shipped
from knitlab.io.suggestions import unknown
from knitlab.measure.knit_size import Gauge
from knitlab.model.stripe import Knit, Stripe
from knitlab.simulation.case import Case
from knitlab.study.cases import (
    cases,
    electrode_problems,
    overridden,
    with_pattern_files,
    with_stripe_files,
)
from knitlab.study.design_space import design_space
from knitlab.study.parameters import Parameters, StripeRow, StripeTable, read_parameters
from knitlab.study.patterns import Pattern
from knitlab.study.settings import SETTINGS
from knitlab.study.workflow_text import WorkflowText

OF_THE_DESIGN = ("design", "stripes")
"""Sections of a workflow that the design replaces."""
OF_THE_STRAINS = ("strain_max", "strain_step", "further_strains")
SOURCE = "given to knitlab.Design"
OWN_PATTERN = "own pattern"
"""Name of a pattern that is given as an object."""


@dataclass(frozen=True)
class SingleCase:
    """A case outside a sweep.

    Attributes:
        case: the case.
        gauge: size of a stitch in cloth.
    """

    case: Case
    gauge: Gauge


def single_case(
    design: Mapping[str, Any],
    stripes: Sequence[Stripe],
    applied_strain: Sequence[float],
    settings: Mapping[str, Any],
    pattern: Pattern | None = None,
) -> SingleCase:
    """Resolve one design, with settings that replace those of ``params/*.toml``.

    Args:
        design: keys of a workflow's ``[design]``, with one ``n_stripe`` and one ``n_subunit``.
        stripes: stripes that replace or complete the tables of ``params/stripes.toml``.
        applied_strain: strains of the tensile test, ascending from 0 [1].
        settings: one value for each of some keys of a workflow's other sections.
        pattern: the pattern that the design names :data:`OWN_PATTERN`; its paths are relative to
            the current folder.

    Raises:
        BadInput: if the design, the strains or the settings are wrong; it lists every fault.
    """
    faults = [*_refused(settings), *_bad_strains(applied_strain)]
    if faults:
        raise BadInput(faults)
    table: dict[str, Any] = {"title": "single design", "design": dict(design)}
    sources = {f"design.{name}": f"{name} = {value!r}" for name, value in design.items()}
    for name, value in settings.items():
        section = SETTINGS[name].section
        table.setdefault(section, {})[name] = value
        sources[f"{section}.{name}"] = f"{name} = {value!r}"
    text = WorkflowText(Path("settings"), table, (), sources, ())
    read = text.checked()
    if read.design is None:
        raise TypeError("a table with [design] was read as one without")
    parameters = with_stripe_files(read.model, read_parameters(shipped("params")), text)
    parameters = _with_stripes(parameters, stripes)
    parameters = with_pattern_files(read.design, parameters, text)
    if pattern is not None:
        patterns = {**parameters.patterns, OWN_PATTERN: (pattern, Path())}
        parameters = replace(parameters, patterns=patterns)
    space = design_space(read.design, parameters, text.source)
    (case,) = cases(read, (), space, parameters, text.source)
    if problems := electrode_problems(case):
        raise fault("layout", "; ".join(problems))
    strains = tuple(float(strain) for strain in applied_strain)
    gauge = overridden(parameters.gauge, read.gauge)
    return SingleCase(replace(case, applied_strain=strains), gauge)


def _refused(settings: Mapping[str, Any]) -> Iterator[Fault]:
    """Faults of settings that do not exist, or that a single case does not use."""
    for name, value in settings.items():
        setting = SETTINGS.get(name)
        if setting is None:
            yield Fault(name, unknown(name, SETTINGS, "setting"))
        elif setting.section in OF_THE_DESIGN:
            yield Fault(name, "belongs to the design; give it to knitlab.Design")
        elif name in OF_THE_STRAINS:
            yield Fault(name, "is not used where the strains are given; leave it out")
        elif isinstance(value, list) and not setting.takes_list:
            yield Fault(name, f"takes one value, not {value!r}; knitlab.run takes lists")


def _bad_strains(strains: Sequence[float]) -> Iterator[Fault]:
    listed = [float(strain) for strain in strains]
    if not listed or listed[0] != 0:
        yield Fault("applied_strain", f"begins at 0, the relaxed fabric, but is {listed}")
    elif any(later <= earlier for earlier, later in pairwise(listed)):
        yield Fault("applied_strain", f"ascends, but is {listed}; sort it and keep each once")


def _with_stripes(parameters: Parameters, stripes: Sequence[Stripe]) -> Parameters:
    """The parameters with some stripes replaced or added.

    Raises:
        BadInput: if a number of a stripe is out of range.
    """
    tables = parameters.stripes
    for stripe in stripes:
        knit: Knit = stripe.knit
        numbers = {name: its for name, its in asdict(stripe).items() if name not in ("knit", "n")}
        row = StripeRow.model_validate(numbers)
        table: StripeTable = tables.table(knit)
        changed = table.model_copy(update={"n": table.n | {str(stripe.n): row}, "source": SOURCE})
        tables = tables.model_copy(update={knit: changed})
    return replace(parameters, stripes=tables)
