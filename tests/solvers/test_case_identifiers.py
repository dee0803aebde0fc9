"""Identifiers tell apart all that differs, and a new setting with its default renames no case."""

import json
from dataclasses import field, fields, is_dataclass, make_dataclass, replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter

from knitlab.cubes.case_file import read_case
from knitlab.cubes.cube_file import open_cube
from knitlab.io.shipped import shipped
from knitlab.runs.plan import make_plan
from knitlab.solvers.case import Case, case_of

REFERENCE = shipped("params").parent / "results" / "reference"
KEPT = sorted(REFERENCE.glob("*/cases/*.nc"))
FIXED_DEFAULTS = json.loads(Path(__file__).with_name("fixed_defaults.json").read_text())
"""Default in code of every field, by table and name.

A new field adds a line. A line is never changed: cases are identified without fields at these
values. To give users another value, change it in ``params/``.
"""


def planned(*settings, workflow="sensor"):
    plan = make_plan(workflow, ("n_stripe=4", "n_subunit=24", *settings))
    return next(iter(plan.cases.values()))


CASES = {
    "sensor": planned(),
    "dynamics": planned("method=dynamics", "ending=steps", workflow="small_samples"),
    "graded": planned("pattern=graded_stripes", workflow="graded"),
    "folds": planned("pattern=miura", workflow="periodic"),
}


def tables_of(case):
    """Fields of a case that hold a table, or several."""
    for each in fields(case):
        value = getattr(case, each.name)
        first = next(iter(value), None) if isinstance(value, tuple) else value
        if is_dataclass(first):
            yield each.name


def with_fields(value, kind, **new):
    """A table as another class has it."""
    return kind(**{each.name: getattr(value, each.name) for each in fields(value)} | new)


def later(kind):
    """A class of tables as a later version has it, with a field more."""
    added = ("gravity", float, field(default=0.0))
    return make_dataclass(kind.__name__, [added], bases=(kind,), frozen=True)


def of_later_version(case, table, gravity):
    """A case as a later version has it, with a field more: of its own, or of one of its tables."""
    if table is None:
        return with_fields(case, later(Case), gravity=gravity)
    value = getattr(case, table)
    kind = later(type(value[0] if isinstance(value, tuple) else value))
    if isinstance(value, tuple):
        new = tuple(with_fields(each, kind, gravity=gravity) for each in value)
        kind = tuple[kind, ...]
    else:
        new = with_fields(value, kind, gravity=gravity)
    # A table with a default, such as the load, has one in the later version too.
    has_default = is_dataclass(next(each for each in fields(Case) if each.name == table).default)
    added = (table, kind, field(default=kind())) if has_default else (table, kind)
    of_case = make_dataclass("Case", [added], bases=(Case,), frozen=True)
    return with_fields(case, of_case, **{table: new})


@pytest.mark.parametrize(
    ("name", "table"),
    [(name, table) for name, case in CASES.items() for table in (None, *tables_of(case))],
)
def test_a_new_field_renames_only_cases_that_do_not_have_its_default(name, table):
    case = CASES[name]
    at_default, *others = (of_later_version(case, table, gravity) for gravity in (0, 1, 2))
    assert at_default.case_id == case.case_id
    assert len({case.case_id, *(other.case_id for other in others)}) == 3
    assert json.dumps(at_default.record) != json.dumps(case.record), "the record states its value"
    earlier = json.loads(json.dumps(case.record))
    assert TypeAdapter(type(at_default)).validate_python(earlier) == at_default


def test_the_defaults_in_code_are_fixed():
    schema = TypeAdapter(Case).json_schema()
    defaults = {
        f"{table}.{name}": its["default"]
        for table, about in {"Case": schema, **schema["$defs"]}.items()
        for name, its in about["properties"].items()
        if "default" in its
    }
    assert len(defaults) > 50
    assert defaults == FIXED_DEFAULTS


@pytest.mark.parametrize("path", KEPT, ids=lambda path: path.stem)
def test_kept_case_files_are_found_by_the_identifier_of_their_record(path):
    folder = path.parent.parent
    kept = read_case(folder, path.stem)
    assert case_of(json.loads(kept.attrs["parameters"])).case_id == path.stem
    assert path.stem in open_cube(folder)["case_id"].values


def changes_of(table, **values):
    """Some fields of a table, each with one of two values."""
    return st.fixed_dictionaries(
        {}, optional={name: st.sampled_from(given) for name, given in values.items()}
    ).map(lambda chosen: {table: chosen})


OPTIONS = changes_of(
    "options",
    cell_size=["flat", "relaxed"],
    hinges=["all", "fold_lines"],
    length_scale=[1.0, 1.1],
    contact=["none", "barrier"],
    cells_per_period=[4, 8],
    ridge_fraction=[0.5, 0.25],
)
SOLVER = changes_of("solver", tolerance=[1e-8, 1e-9], start=["flat", "periodic"], drag=[0.0, 1.0])
SHEET = changes_of("sheet", z_max=[1.9, 6.0], thickness=[0.1, 0.2])
CAPACITOR = changes_of("capacitor", accuracy=[0.01, 0.02], ground=["none", "plane"])
OWN = st.fixed_dictionaries(
    {}, optional={"robustness": st.sampled_from([0, 2]), "unloading": st.booleans()}
)


@st.composite
def cases(draw):
    case = CASES["sensor"]
    for changes in (OPTIONS, SOLVER, SHEET, CAPACITOR):
        ((table, chosen),) = draw(changes).items()
        case = replace(case, **{table: replace(getattr(case, table), **chosen)})
    return replace(case, **draw(OWN))


@given(cases(), cases())
def test_cases_share_an_identifier_where_all_that_they_use_is_the_same(one, other):
    assert (one.case_id == other.case_id) == (one.record == other.record)


@given(cases())
def test_a_case_that_is_read_back_keeps_its_identifier(case):
    assert case_of(json.loads(json.dumps(case.record))).case_id == case.case_id
