"""The cases of a design space: what a workflow and the parameters make of each design."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from knitlab.fabric.electrodes import BadLayout
from knitlab.fabric.pattern import BadPattern
from knitlab.fabric.stripe import (
    GARTER_STITCHES_PER_RIB_STITCH,
    Knit,
    Stripe,
    periods_per_patch,
)
from knitlab.io.errors import BadInput, Fault, fault
from knitlab.io.strict_model import StrictModel
from knitlab.io.suggestions import unknown
from knitlab.measure.capacitance.capacitor import Capacitor
from knitlab.simulation.case import Case, Label
from knitlab.simulation.stripe_changes import changed_stripe, changed_table
from knitlab.sweep.axes import SweepAxis, combinations
from knitlab.sweep.contradicting_settings import check_contact, check_drag, check_thickness
from knitlab.sweep.declared_fields import declared
from knitlab.sweep.design_space import DesignSpace, Source
from knitlab.sweep.parameters import Parameters, read_stripe_file
from knitlab.sweep.patterns import Pattern, read_pattern_file
from knitlab.sweep.sample_size import sample_size
from knitlab.sweep.settings import PATTERN
from knitlab.sweep.workflow import (
    DesignSection,
    ElectrodesSection,
    ModelSection,
    Workflow,
    pattern_name,
)
from knitlab.sweep.workflow_text import WorkflowText

# A pure stripe has its ridges along x, whatever its knit, and is pulled across them along y.
PULLED_ACROSS = ("G",)
STRIPE_FILES = "model.stripe_files"
PATTERN_FILES = "design.pattern_files"
Table = TypeVar("Table")


def with_stripe_files(
    section: ModelSection, parameters: Parameters, text: WorkflowText
) -> Parameters:
    """The parameters, with the stripes of a workflow's ``stripe_files`` added or replaced.

    Raises:
        BadInput: with every fault of a file.
    """
    stripes = parameters.stripes
    for path in stripe_files(section, text):
        stripes = read_stripe_file(path, text.source(STRIPE_FILES)).over(stripes)
    return replace(parameters, stripes=stripes)


def stripe_files(section: ModelSection, text: WorkflowText) -> list[Path]:
    """Paths of the ``stripe_files`` of a workflow."""
    return [text.folder(STRIPE_FILES) / name for name in section.stripe_files]


def cases(
    workflow: Workflow,
    axes: tuple[SweepAxis, ...],
    space: DesignSpace,
    parameters: Parameters,
    source: Source,
) -> Iterator[Case]:
    """Every case of a workflow: every design under every combination of the axes' values.

    Args:
        workflow: the workflow, with the first value of each axis.
        axes: its axes.
        space: its designs.
        parameters: values that it does not replace.
        source: names where a ``section.key`` comes from, for a fault.

    Raises:
        BadInput: if settings contradict each other.
    """
    for labels, chosen in combinations(workflow, axes):
        yield from _cases(chosen, labels, space, parameters, source)


def overridden(table: Table, section: StrictModel) -> Table:
    """A table of settings with what a workflow's section gives in place of them."""
    given = section.model_dump(include=set(declared(type(table))), exclude_none=True)
    # mypy knows no bound for "any dataclass".
    return replace(table, **given)  # type: ignore[type-var]


def _cases(
    workflow: Workflow,
    labels: dict[str, Label],
    space: DesignSpace,
    parameters: Parameters,
    source: Source,
) -> Iterator[Case]:
    protocol, changes = workflow.protocol, workflow.model.changes
    model_options = overridden(parameters.model, workflow.model)
    solver = overridden(parameters.solver, workflow.solver)
    common: dict[str, Any] = {
        "sheet": changed_table(parameters.sheet, changes),
        "applied_strain": protocol.applied_strain,
        "method": protocol.method,
        "solver": None if protocol.method == "dynamics" else solver,
        "dynamics": overridden(parameters.dynamics, workflow.dynamics),
        "sensitivities": protocol.sensitivities,
        "unloading": protocol.unloading,
        "robustness": protocol.robustness if protocol.method == "equilibrium" else 0,
        "capacitor": _capacitor(workflow.electrodes, parameters, source),
    }
    if protocol.method != "dynamics" and solver.drag:
        check_drag(workflow, model_options.boundary, source)
    if model_options.contact != "none":
        check_contact(workflow, solver.drag, source)

    def stripe(knit: Knit, stitches: int) -> Stripe:
        return changed_stripe(parameters.stripes.stripe(knit, stitches), changes)

    if workflow.design is not None:
        entry, folder = _pattern(workflow.design, parameters, source)
        rows = entry.patches(folder)
        if "P" in "".join(rows):
            common["plain"] = changed_table(parameters.plain, changes)
        for n_stripe, n_subunit in space.designs:
            n, m = int(n_stripe), int(n_subunit)
            try:
                case = Case(
                    design={"n_stripe": n, "n_subunit": m, **labels},
                    weft=stripe("rib", n),
                    warp=stripe("garter", GARTER_STITCHES_PER_RIB_STITCH * n),
                    options=model_options,
                    pattern=rows,
                    periods=periods_per_patch(n, m),
                    unit_cells=sample_size(workflow.design, entry.stitches(rows, n, m)),
                    grading=entry.grading(rows, n, m, stripe),
                    folds=entry.single_folds,
                    cell_patches=entry.cell,
                    **common,
                )
                case.sample.grid_folds()
                case.check_cells()
                check_thickness(case, source)
            except BadPattern as error:
                place = f"{source('design.pattern')} (n_stripe {n}, n_subunit {m})"
                raise BadInput(Fault(place, problem) for problem in error.problems) from error
            yield case.without_unused()
    elif workflow.stripes is not None:
        for knit, stitches, boundary in space.designs:
            pure = stripe("rib" if knit == "rib" else "garter", int(stitches))
            options: dict[str, Any] = {"boundary": boundary}
            case = Case(
                design={"knit": knit, "n": stitches, "boundary": boundary, **labels},
                weft=pure,
                warp=pure,
                options=replace(model_options, **options),
                pattern=PULLED_ACROSS,
                periods=workflow.stripes.stripe_periods,
                unit_cells=(1, 1),
                **common,
            )
            check_thickness(case, source)
            yield case.without_unused()


def _pattern(
    section: DesignSection, parameters: Parameters, source: Source
) -> tuple[Pattern, Path]:
    """The pattern of a workflow, and the folder that its paths are relative to."""
    name = pattern_name(section.pattern)
    if name is None:
        return Pattern(rows=section.pattern), Path()
    if name not in parameters.patterns:
        raise fault(source("design.pattern"), unknown(name, parameters.patterns, "pattern"))
    return parameters.patterns[name]


def pattern_inputs(
    section: DesignSection, parameters: Parameters, text: WorkflowText
) -> list[Path]:
    """Files that the patterns of a workflow are read from, besides ``patterns.toml``."""
    swept = [value for axis in text.axes if axis.name == PATTERN for value in axis.values]
    names = {pattern_name(section.pattern), *swept} & set(parameters.patterns)
    used = [parameters.patterns[name] for name in sorted(map(str, names))]
    return [
        *_pattern_files(section, text),
        *(path for entry, folder in used for path in entry.files(folder)),
    ]


def _pattern_files(section: DesignSection, text: WorkflowText) -> list[Path]:
    return [text.folder(PATTERN_FILES) / name for name in section.pattern_files]


def with_pattern_files(
    section: DesignSection, parameters: Parameters, text: WorkflowText
) -> Parameters:
    """The parameters, with the patterns of a workflow's ``pattern_files`` added or replaced.

    Raises:
        BadInput: with every fault of a file.
    """
    patterns = dict(parameters.patterns)
    for path in _pattern_files(section, text):
        read = read_pattern_file(path, text.source(PATTERN_FILES))
        patterns |= {name: (entry, path.parent) for name, entry in read.items()}
    return replace(parameters, patterns=patterns)


def electrode_problems(case: Case) -> tuple[str, ...]:
    """What is wrong with the layout of the electrodes of a case; nothing if it has none."""
    if case.capacitor is None:
        return ()
    try:
        case.electrodes  # noqa: B018  (it raises)
    except BadLayout as error:
        return tuple(error.problems)
    return ()


def _capacitor(
    section: ElectrodesSection | None, parameters: Parameters, source: Source
) -> Capacitor | None:
    if section is None:
        return None
    layout = parameters.capacitor.layout
    if section.layout is not None:
        if section.layout not in parameters.layouts:
            known = ", ".join(parameters.layouts)
            problem = f"there is no layout {section.layout!r}; choose from {known}, or give a mask"
            raise fault(source("electrodes.layout"), problem)
        layout = parameters.layouts[section.layout]
    # The section's ``layout`` is a name.
    numbers = overridden(parameters.capacitor, section)
    return replace(numbers, layout=overridden(layout, section))
