"""The designs of a workflow, which of them are possible, and the case of each.

Settings that have no meaning together are refused.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from knitlab.io.errors import InputError, Mistake, invalid, raise_if_any, unknown
from knitlab.io.toml import StrictModel, read_checked
from knitlab.model.electrodes import BadLayout, Capacitor
from knitlab.model.fold_friction import Friction
from knitlab.model.pattern import CELLS_PER_PERIOD, BadPattern, SingleFold
from knitlab.model.settings import ModelOptions, PlainKnit, largest_thickness
from knitlab.model.stripe import (
    GARTER_STITCHES_PER_RIB_STITCH,
    STRIPE_QUANTITIES,
    Knit,
    Stripe,
    cell_length,
    changed_stripe,
    changed_table,
    flat_stitch,
    lengths_ratio,
    periods_per_patch,
)
from knitlab.runs.declared_fields import declared
from knitlab.runs.material import SCALED, STITCH
from knitlab.runs.parameters import KNITS, UNITS, Parameters
from knitlab.runs.patterns import Pattern, PatternFile
from knitlab.runs.results_folder import Labels
from knitlab.runs.workflow import (
    CHANGES,
    LARGEST_STRAIN,
    PATTERN,
    PLAIN_NUMBERS,
    DesignSection,
    ElectrodesSection,
    StripesSection,
    Workflow,
    pattern_name,
)
from knitlab.runs.workflow_text import WorkflowText
from knitlab.solvers.case import Case, Label
from knitlab.solvers.dynamics.settings import Dynamics
from knitlab.solvers.equilibrium.settings import Solver

# A pure stripe has its ridges along x, whatever its knit, and is pulled across them along y.
PULLED_ACROSS = ("G",)
PATTERN_FILES = "design.pattern_files"
USUAL_STRAIN = 2.0  # largest usual applied strain: that of pure stripes, which unfold furthest
MOST_NODES = 10_000_000  # of a sample: about a terabyte
ANOTHER = 0.05  # part by which the stitches of a stripe and of the gauge may differ
FAR = 10.0  # factor beyond the values of the tables from which a value is unusual
Table = TypeVar("Table")
Pair = tuple[int, int]
Designs = dict[Labels, str | None]  # by labels along the dimensions, with why one is impossible
Source = Callable[[str], str]  # names where a `section.key` comes from, for a fault


def designs_of_section(section: DesignSection, parameters: Parameters, source: Source) -> Designs:
    """The designs of ``[design]``; InputError if a set or a member is unknown, or none is left."""
    name, sets = section.set or "paper", parameters.designs.root
    if name not in sets:
        raise invalid(source("design.set"), unknown(name, sets, "set"))
    if section.n_stripe is None or section.n_subunit is None:
        pairs = _members(section, name, sets[name].pairs, source)
    else:
        pairs = sorted({(n, m) for n in section.n_stripe for m in section.n_subunit})
    of_material = f" (material {parameters.material!r})" if parameters.material else ""
    reasons = {pair: parameters.stripes.impossible(*pair) for pair in pairs}
    designs: Designs = {pair: why and f"{why}{of_material}" for pair, why in reasons.items()}
    if all(designs.values()):
        asked = ", ".join(dict.fromkeys(map(source, ("design.n_stripe", "design.n_subunit"))))
        raise InputError(Mistake(asked, str(reason)) for reason in dict.fromkeys(designs.values()))
    return designs


def _members(
    section: DesignSection, name: str, pairs: tuple[Pair, ...], source: Source
) -> list[Pair]:
    mistakes = []
    for axis, (key, other) in enumerate((("n_stripe", "n_subunit"), ("n_subunit", "n_stripe"))):
        members = sorted({pair[axis] for pair in pairs})
        wanted = getattr(section, key) or members
        hint = f"choose from {members}, or give {other} too for a grid of your own"
        mistakes += [
            Mistake(source(f"design.{key}"), f"set {name!r} has no {key} = {value}; {hint}")
            for value in wanted
            if value not in members
        ]
        pairs = tuple(pair for pair in pairs if pair[axis] in wanted)
    raise_if_any(mistakes)
    return sorted(pairs)


def designs_of_stripes(section: StripesSection, parameters: Parameters, source: Source) -> Designs:
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


def sample_size(section: DesignSection, stitches: tuple[int, int]) -> tuple[int, int]:
    """Repeats along (y, x) of a pattern of (courses, wales); two courses are as long as a wale."""
    if section.needles is None:
        return section.unit_cells or (1, 1)
    courses, wales = stitches
    along_x = max(1, int(section.needles * section.scale // wales))
    length = section.aspect * along_x * wales
    return max(1, round(length * GARTER_STITCHES_PER_RIB_STITCH / courses)), along_x


def with_pattern_files(
    section: DesignSection, parameters: Parameters, text: WorkflowText
) -> tuple[Parameters, list[Path]]:
    """The parameters with a workflow's ``pattern_files``, and the files of its patterns."""
    patterns = dict(parameters.patterns)
    files = [text.folder(PATTERN_FILES) / name for name in section.pattern_files]
    for path in files:
        read = read_checked(PatternFile, path, text.source(PATTERN_FILES)).root
        patterns |= {name: (entry, path.parent) for name, entry in read.items()}
    names = {pattern_name(section.pattern), *text.axes.get(PATTERN, ())} & set(patterns)
    for entry, folder in (patterns[name] for name in sorted(map(str, names))):
        files += entry.files(folder)
    return replace(parameters, patterns=patterns), files


def overridden(table: Table, section: StrictModel) -> Table:
    """A table of settings with what a workflow's section gives in place of them."""
    given = section.model_dump(include=set(declared(type(table))), exclude_none=True)
    # mypy knows no bound for "any dataclass".
    return replace(table, **given)  # type: ignore[type-var]


def cases(
    workflow: Workflow,
    labels: dict[str, Label],
    designs: Designs,
    parameters: Parameters,
    source: Source,
) -> Iterator[Case]:
    """Cases of the possible designs, also labelled by axes; InputError if settings contradict."""
    protocol, numbers = workflow.protocol, {*CHANGES, *PLAIN_NUMBERS}
    changes = workflow.model.model_dump(include=numbers, exclude_none=True)
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
        "load": protocol.as_load,
        "friction": overridden(parameters.friction, workflow.friction),
        "cycle": protocol.cycle,
        "robustness": protocol.robustness if protocol.method == "equilibrium" else 0,
        "capacitor": _capacitor(workflow.electrodes, parameters, source),
    }
    _check_together(workflow, model_options, solver, common["dynamics"], common["friction"], source)
    possible = [design for design, why_not in designs.items() if why_not is None]

    def stripe(knit: Knit, stitches: int) -> Stripe:
        return changed_stripe(parameters.stripes.stripe(knit, stitches), changes)

    if workflow.design is not None:
        entry, folder = _pattern(workflow.design, parameters, source)
        rows = entry.patches(folder)
        height, width = len(rows), len(rows[0])
        if "P" in "".join(rows):
            common["plain"] = _plain(parameters, changes, source)
        for n, m in possible:
            ratio = lengths_ratio(stripe("rib", n), common["sheet"], model_options)
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
                    folds=tuple(SingleFold(**fold.model_dump()) for fold in entry.folds),
                    cell_patches=entry.cell,
                    lengths_ratio=ratio,
                    **common,
                )
                _check_size(case, source)
                case.sample.grid_folds()
                if entry.cell and (height % entry.cell[0] or width % entry.cell[1]):
                    message = f"cell = {list(entry.cell)} does not fill the pattern of {height} by"
                    message += f" {width} patches; give numbers that divide them"
                    raise BadPattern([message])
                _check_thickness(case, source)
            except BadPattern as error:
                where = f"{source('design.pattern')} (n_stripe {n}, n_subunit {m})"
                raise InputError(Mistake(where, message) for message in error.messages) from error
            yield case.without_unused()
    elif workflow.stripes is not None:
        for knit, n, boundary in possible:
            pure = stripe(knit, n)
            case = Case(
                design={"knit": knit, "n": n, "boundary": boundary, **labels},
                weft=pure,
                warp=pure,
                options=replace(model_options, boundary=boundary),
                pattern=PULLED_ACROSS,
                periods=workflow.stripes.stripe_periods,
                unit_cells=(1, 1),
                lengths_ratio=lengths_ratio(pure, common["sheet"], model_options),
                **common,
            )
            _check_thickness(case, source)
            yield case.without_unused()


def _plain(parameters: Parameters, changes: dict[str, float], source: Source) -> PlainKnit:
    plain, names = parameters.plain, declared(PlainKnit)
    if plain is None and (missing := [name for name in names if name not in changes]):
        message = f"the material {parameters.material!r} has no plain knit; give {missing}"
        raise invalid(source("design.pattern"), f"{message}, or choose a pattern without P")
    return changed_table(plain or PlainKnit(**{name: changes[name] for name in names}), changes)


def _pattern(
    section: DesignSection, parameters: Parameters, source: Source
) -> tuple[Pattern, Path]:
    """The pattern of a workflow, and the folder that its paths are relative to."""
    name = pattern_name(section.pattern)
    if name is None:
        return Pattern(rows=section.pattern), Path()
    if name not in parameters.patterns:
        raise invalid(source("design.pattern"), unknown(name, parameters.patterns, "pattern"))
    return parameters.patterns[name]


def electrode_problems(case: Case) -> tuple[str, ...]:
    """What is wrong with the layout of the electrodes of a case; nothing if it has none."""
    try:
        _ = case.capacitor and case.electrodes
    except BadLayout as error:
        return tuple(error.messages)
    return ()


def _capacitor(
    section: ElectrodesSection | None, parameters: Parameters, source: Source
) -> Capacitor | None:
    if section is None:
        return None
    layout = parameters.capacitor.layout
    if section.layout is not None:
        if section.layout not in parameters.layouts:
            message = unknown(section.layout, parameters.layouts, "layout")
            raise invalid(source("electrodes.layout"), f"{message}, or give a mask")
        layout = parameters.layouts[section.layout]
    # The section's ``layout`` is a name.
    numbers = overridden(parameters.capacitor, section)
    return replace(numbers, layout=overridden(layout, section))


def _check_together(
    workflow: Workflow,
    options: ModelOptions,
    solver: Solver,
    dynamics: Dynamics,
    friction: Friction,
    source: Source,
) -> None:
    """Refuse drag, contact, loads and friction where they have no meaning."""
    by_dynamics = workflow.protocol.method == "dynamics"
    load, sensitivities = workflow.protocol.as_load, workflow.protocol.sensitivities
    boundaries = workflow.stripes.boundaries if workflow.stripes else (options.boundary,)
    of_drag = {
        "holds back a sample that moves between clamps; periodic fabric has no place to move from:"
        " take boundary = clamped, or drag = 0": "periodic" in boundaries,
        "has no sensitivities, which are those of equilibria; take drag = 0": sensitivities,
    }
    of_contact = {
        "is integrated by leapfrog only; take integrator = leapfrog, or contact = none": by_dynamics
        and dynamics.integrator == "tsit5",
    }
    across = load.ratio * workflow.protocol.strain_max
    biaxial, off_axis = load.kind == "biaxial", load.kind == "off_axis"
    electrodes = workflow.electrodes is not None
    of_load = {
        "is biaxial, which needs load_ratio: strain along the weft over that along the"
        " warp": biaxial and workflow.protocol.load_ratio is None,
        f"is biaxial, and strain_max × load_ratio = {across:g} is the strain along the weft; keep"
        f" it above -1 and at most {LARGEST_STRAIN:g}": not -1 < across <= LARGEST_STRAIN,
        "is off_axis, which needs load_angle: degrees from the courses": off_axis
        and workflow.protocol.load_angle is None,
        "shears periodic fabric, which is found by equilibria; take method ="
        " equilibrium": load.shears and by_dynamics and "periodic" in boundaries,
        "is not warp, and has no sensitivities; leave them out": sensitivities,
        "is off_axis, which clamps cannot pull; take boundary = periodic": off_axis
        and "clamped" in boundaries,
        "shears periodic fabric, for which there are no electrodes; leave them out, or shear a"
        " clamped sample": load.shears and "periodic" in boundaries and electrodes,
    }
    of_friction = {
        "is found by equilibria; take method = equilibrium": by_dynamics,
        "has no sensitivities, which are those of a fabric without; leave them out": sensitivities,
        "is not combined with drag; take drag = 0": solver.drag > 0,
    }
    drag, contact = solver.drag > 0 and not by_dynamics, options.contact != "none"
    for key, used, refused in (
        ("solver.drag", drag, of_drag),
        ("model.contact", contact, of_contact),
        ("protocol.load", load.kind != "warp", of_load),
        ("protocol.cycle", workflow.protocol.cycle > 1, of_friction),
        ("friction.fold_friction", friction.fold_friction > 0, of_friction),
        ("friction.fold_drift", friction.fold_drift > 0, of_friction),
    ):
        for message in (message for message, holds in refused.items() if used and holds):
            raise invalid(source(key), message)


def _check_size(case: Case, source: Source) -> None:
    """Refuse a sample that no machine could hold, before its grid is made."""
    grading, (along_y, along_x) = case.grading, case.unit_cells
    rows, columns = case.periods * len(case.pattern), case.periods * len(case.pattern[0])
    if grading is not None:
        rows, columns = sum(grading.row_periods), sum(grading.column_periods)
    nodes = rows * along_y * columns * along_x * case.options.cells_per_period**2
    if nodes > MOST_NODES:
        message = f"makes a grid of {nodes:.1e} nodes, above {MOST_NODES:.0e}; make it smaller"
        raise invalid(source("design.unit_cells"), f"{case.label}: {message}")


def _check_thickness(case: Case, source: Source) -> None:
    """Refuse a fabric so thick that contact would press open its folds at rest."""
    if case.options.contact == "none":
        return
    pair = case.stripe_pair.weft, case.stripe_pair.warp
    refinement = case.options.cells_per_period // CELLS_PER_PERIOD
    cell = refinement * min(float(cell_length(each, case.options).min()) for each in pair)
    sharpest = min(float(each.theta_0.min()) for each in pair)
    largest = largest_thickness(cell, sharpest)
    thickness = case.sheet.thickness
    largest /= case.lengths_ratio
    if thickness >= largest:
        message = f"is too thick for the folds of {case.label}; give less than {largest:.3g} mm"
        raise invalid(source("model.thickness"), f"{thickness:g} mm {message}")


def _other_stitches(parameters: Parameters) -> Iterator[str]:
    """Sentences on stripes of a material whose stitches have another size than its gauge."""
    for knit, name in zip(KNITS, STITCH, strict=True):
        given = getattr(parameters.gauge, name)
        for n in parameters.stripes.rows(knit):
            stripe = parameters.stripes.stripe(knit, n)
            implied = flat_stitch(stripe, parameters.model.cell_size)
            if abs(implied / given - 1) > ANOTHER:
                sizes = f"{given:.3g} mm, and the period of {knit} {n} implies {implied:.3g} mm"
                yield (
                    f"{name} = {sizes};"
                    " forces and lengths of the cloth are off by as much: measure the period and"
                    " count its stitches again, or leave the size of the stitch out"
                )


def unusual_values(
    workflow: Workflow, cases: Iterable[Case], parameters: Parameters
) -> tuple[str, ...]:
    """Sentences on values that may be mistakes: far from the tables, or ignored by the method."""
    cases = tuple(cases)
    contact = any(case.options.contact != "none" for case in cases)
    uses = {"sheet": True, "gauge": not workflow.stripes, "capacitor": bool(workflow.electrodes)}
    scaled = [
        f"{name} = {value:.3g} mm"
        for name, value in sorted(parameters.scaled.items())
        if uses[SCALED[name]] and (contact or name != "thickness")
    ]
    sentences = []
    if scaled:
        origin = f"the paper's, scaled to the stitches of the material {parameters.material!r}"
        sentences.append(f"{', '.join(scaled)}: {origin}; give others in its file or as settings")
    if parameters.material is not None:
        sentences += _other_stitches(parameters)
    for case in cases:
        if (strain := case.applied_strain[-1]) > USUAL_STRAIN:
            usual = "usual are 0.2 to 0.6, and 0.15 is 15 %"
            sentences.append(f"strain_max = {strain:g} is {strain:.0%} of the length; {usual}")
        for stripe in (case.weft, case.warp):
            rows = parameters.stripes.rows(stripe.knit).values()
            for name in STRIPE_QUANTITIES:
                value, unit = getattr(stripe, name), UNITS[name]
                known = [getattr(row, name) for row in rows]
                if not min(known) / FAR <= value <= max(known) * FAR:
                    usual = f"usual are {min(known):g} to {max(known):g} {unit}"
                    subject = f"{name} of {stripe.knit} {stripe.n}"
                    sentences.append(f"{subject} is {value:.4g} {unit}; {usual}")
    protocol = workflow.protocol
    for name, kind in (("load_ratio", "biaxial"), ("load_angle", "off_axis")):
        if getattr(protocol, name) is not None and all(case.load.kind != kind for case in cases):
            sentences.append(f"{name} is ignored by load = {protocol.load}; take load = {kind}")
    if protocol.cycle > 1 and not any(case.friction.acts for case in cases):
        same = f"cycle = {protocol.cycle} is as the first without friction, unless the fabric snaps"
        sentences.append(f"{same}; give fold_friction or fold_drift")
    drag = overridden(parameters.solver, workflow.solver).drag
    if protocol.method == "dynamics" and drag:
        ignored = f"drag = {drag:g} is ignored by dynamics"
        sentences.append(f"{ignored}, which have a damping_ratio")
    if protocol.robustness and protocol.method != "equilibrium":
        ignored = f"robustness = {protocol.robustness} is ignored by {protocol.method}"
        sentences.append(f"{ignored}: siblings are tested in equilibrium only")
    return tuple(dict.fromkeys(sentences))
