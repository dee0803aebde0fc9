import tomllib
from dataclasses import asdict

import pytest

from knitlab.io.shipped import shipped
from knitlab.model.stripe import SPRING_LAWS, STRIPE_QUANTITIES, YARN_FIELDS, Stripe
from knitlab.runs.declared_fields import declared
from knitlab.runs.parameters import TABLES, Model, defaults
from knitlab.runs.plan import make_plan
from knitlab.runs.workflow import SECTIONS, SETTINGS
from knitlab.solvers.dynamics.settings import Dynamics
from knitlab.solvers.equilibrium.settings import Solver

DESIGN = ("n_stripe=4", "n_subunit=16")
FILES = {
    path.stem: tomllib.loads(path.read_text(encoding="utf-8"))
    for path in shipped("params").glob("*.toml")
}
ENTRIES = [
    (file, name)
    for file, table in FILES.items()
    for name, entry in table.items()
    if "value" in entry and "source" in entry
]
PARAMETERS = defaults()
DEFAULTS = {
    name: value for table in TABLES for name, value in asdict(getattr(PARAMETERS, table)).items()
}


@pytest.mark.parametrize(("file", "name"), ENTRIES)
def test_each_entry_of_a_parameter_file_is_a_setting_with_its_default_unit_and_source(file, name):
    stated = DEFAULTS[name], SETTINGS[name].unit, PARAMETERS.sources[name]
    assert stated == tuple(FILES[file][name][key] for key in ("value", "unit", "source"))


def test_no_two_sections_have_a_setting_of_the_same_name():
    assert len(SETTINGS) == sum(len(section.model_fields) for section in SECTIONS.values())


def test_each_stripe_quantity_can_be_replaced_and_multiplied_for_one_knit_or_both():
    assert set(STRIPE_QUANTITIES) == set(declared(Stripe)) - {
        "knit",
        "n",
        *SPRING_LAWS,
        *YARN_FIELDS,
    }
    for name in STRIPE_QUANTITIES:
        assert SETTINGS[f"{name}_factor"].factor_on == name
        for knit in ("rib", "garter"):
            assert SETTINGS[f"{knit}_{name}"].unit == FILES["stripes"][knit]["unit"][name]
            assert SETTINGS[f"{knit}_{name}_factor"].factor_on == f"{knit}_{name}"


@pytest.mark.parametrize(
    ("table", "file"), [(Solver, "solver"), (Dynamics, "dynamics"), (Model, "model")]
)
def test_defaults_of_tables_are_those_of_their_files(table, file):
    assert asdict(table()) == asdict(getattr(PARAMETERS, file))


@pytest.mark.parametrize(
    ("override", "units", "long_name"),
    [
        ("surface_density=1e-4,2e-4", "g/mm^2", "surface_density"),
        ("rib_period=1.3,1.4", "mm", "rib_period"),
        ("theta_0_factor=0.9,1", "1", "factor on theta_0"),
        ("garter_k_s_factor=0.9,1", "1", "factor on garter_k_s"),
        ("tolerance=1e-9,1e-8", "N", "tolerance"),
        ("boundary=clamped,periodic", "1", "boundary"),
        ("unit_cells=[[1, 1], [3, 2]]", "1", "unit cells of the sample, along y and x"),
    ],
)
def test_a_swept_setting_is_a_coordinate_with_its_declared_unit(override, units, long_name):
    (coordinate,) = make_plan("periodic", (*DESIGN, override)).coordinates.values()
    assert coordinate.dims == (override.partition("=")[0],)
    assert (coordinate.units, coordinate.long_name) == (units, long_name)


def test_what_is_swept_is_not_among_the_common_settings():
    plan = make_plan("periodic", (*DESIGN, "z_max_factor=1,2", "k_wall=90,100", "rib_k_s=0.8,0.9"))
    assert not {"z_max", "k_wall"} & set(plan.common["sheet"])
    assert "weft" not in plan.common
    sheet = make_plan("periodic", DESIGN).common["sheet"]
    assert (sheet["z_max"], sheet["k_wall"]) == (6.0, 100.0)
