"""The designs of a workflow, which of them are possible, and the case of each.

Two sections of a workflow make cases: ``[design]`` (patches) and ``[stripes]`` (pure stripes).
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from knitlab.io.errors import InputError, Mistake, invalid, raise_if_any, unknown
from knitlab.io.toml import read_checked
from knitlab.model.electrodes import BadLayout
from knitlab.model.pattern import BadPattern, SingleFold
from knitlab.model.settings import PlainKnit
from knitlab.model.stripe import GARTER_STITCHES_PER_RIB_STITCH, changed_table, periods_per_patch
from knitlab.runs.case_settings import CaseSettings, Designs, Source, check_thickness
from knitlab.runs.declared_fields import declared
from knitlab.runs.parameters import Parameters
from knitlab.runs.patterns import PatternFile, PatternTable
from knitlab.runs.workflow import PATTERN, DesignSection, StripesSection, pattern_name
from knitlab.runs.workflow_text import WorkflowText
from knitlab.solvers.case import Case

PATTERN_FILES = "design.pattern_files"
MAX_NODES = 10_000_000  # of a sample: about a terabyte
# A pure stripe has its ridges along x, whatever its knit, and is pulled across them along y.
PULLED_ACROSS = ("G",)


def checkerboard_designs(section: DesignSection, parameters: Parameters, source: Source) -> Designs:
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
    section: DesignSection, name: str, pairs: tuple[tuple[int, int], ...], source: Source
) -> list[tuple[int, int]]:
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


def checkerboard_cases(
    section: DesignSection, settings: CaseSettings, designs: Designs
) -> Iterator[Case]:
    """Cases of the possible designs; InputError if a pattern or a sample is impossible."""
    source = settings.source
    name, patterns = pattern_name(section.pattern), settings.parameters.patterns
    if name is not None and name not in patterns:
        raise invalid(source("design.pattern"), unknown(name, patterns, "pattern"))
    if name is None:
        entry, folder = PatternTable(rows=section.pattern), Path()
    else:
        entry, folder = patterns[name]
    rows = entry.patches(folder)
    height, width = len(rows), len(rows[0])
    plain = _plain(settings) if "P" in "".join(rows) else None
    possible = [design for design, reason in designs.items() if reason is None]
    ribs = {n: settings.stripe("rib", n) for n, _ in possible}
    twice = GARTER_STITCHES_PER_RIB_STITCH
    garters = {n: settings.stripe("garter", twice * n) for n, _ in possible}
    for n, m in possible:
        try:
            case = Case(
                design={"n_stripe": n, "n_subunit": m, **settings.labels},
                weft=ribs[n],
                warp=garters[n],
                options=settings.options,
                pattern=rows,
                periods=periods_per_patch(n, m),
                unit_cells=sample_size(section, entry.stitches(rows, n, m)),
                grading=entry.grading(rows, n, m, settings.stripe),
                folds=tuple(SingleFold(**fold.model_dump()) for fold in entry.folds),
                cell_patches=entry.cell,
                plain=plain,
                lengths_ratio=settings.lengths_ratio("rib", n),
                **settings.common,
            )
            _check_size(case, source)
            case.sample.grid_folds()
            if entry.cell and (height % entry.cell[0] or width % entry.cell[1]):
                message = f"cell = {list(entry.cell)} does not fill the pattern of {height} by"
                raise BadPattern([f"{message} {width} patches; give numbers that divide them"])
            check_thickness(case, source)
        except BadPattern as error:
            where = f"{source('design.pattern')} (n_stripe {n}, n_subunit {m})"
            raise InputError(Mistake(where, message) for message in error.messages) from error
        yield case.without_unused()


def _plain(settings: CaseSettings) -> PlainKnit:
    """The plain knit of the material, with the numbers that the workflow gives."""
    plain, changes = settings.parameters.plain, settings.changes
    names = declared(PlainKnit)
    if plain is None and (missing := [name for name in names if name not in changes]):
        message = f"the material {settings.parameters.material!r} has no plain knit"
        hint = f"give {missing}, or choose a pattern without P"
        raise invalid(settings.source("design.pattern"), f"{message}; {hint}")
    return changed_table(plain or PlainKnit(**{name: changes[name] for name in names}), changes)


def _check_size(case: Case, source: Source) -> None:
    """Refuse a sample that no machine could hold, before its grid is made."""
    grading, (along_y, along_x) = case.grading, case.unit_cells
    rows, columns = case.periods * len(case.pattern), case.periods * len(case.pattern[0])
    if grading is not None:
        rows, columns = sum(grading.row_periods), sum(grading.column_periods)
    nodes = rows * along_y * columns * along_x * case.options.cells_per_period**2
    if nodes > MAX_NODES:
        message = f"makes a grid of {nodes:.1e} nodes, above {MAX_NODES:.0e}; make it smaller"
        raise invalid(source("design.unit_cells"), f"{case.label}: {message}")


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
            lengths_ratio=settings.lengths_ratio(knit, n),
            **settings.common,
        )
        check_thickness(case, settings.source)
        yield case.without_unused()


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
