import json
from dataclasses import replace

import pytest

from knitlab.io.errors import InputError
from knitlab.runs.plan import batched, make_plan


def designs(plan):
    return sorted(tuple(case.design.values()) for case in plan.cases.values())


def workflow(tmp_path, text):
    path = tmp_path / "mine.toml"
    path.write_text(text)
    return str(path)


def test_the_preview_holds_the_papers_designs_up_to_four_periods():
    plan = make_plan("periodic")
    assert len(plan.cases) == 10
    assert {case.design["n_stripe"] for case in plan.cases.values()} == {2, 4, 6, 8}
    assert max(case.periods for case in plan.cases.values()) == 4
    assert plan.applied_strain == tuple(round(0.03 * k, 12) for k in range(16))


def test_a_batch_shares_one_mesh_shape_and_no_case_is_left_out():
    plan = make_plan("periodic")
    for batch in plan.batches:
        assert len({plan.cases[case_id].mesh_shape for case_id in batch.cases}) == 1
        assert batch.unknowns <= 8_000
        assert batch.estimated_seconds > 0
        assert batch.estimated_bytes < 2e9
    planned = [case_id for batch in plan.batches for case_id in batch.cases]
    assert sorted(planned) == sorted(plan.cases)


def test_cases_of_another_kind_of_fold_angle_are_not_in_one_batch():
    (case,) = make_plan("periodic", ("n_stripe=4", "n_subunit=16")).cases.values()
    other = replace(case, options=replace(case.options, fold_angle="across_edge"))
    assert len(batched({"one": case, "same": case, "other": other})) == 2


def test_overrides_reach_the_case():
    overrides = ("n_stripe=4", "n_subunit=16", "cell_size=flat", "model.z_max=0.6")
    (case,) = make_plan("periodic", (*overrides, "path_step=0.02")).cases.values()
    assert case.design == {"n_stripe": 4, "n_subunit": 16}
    assert case.options.cell_size == "flat"
    assert case.sheet.z_max == 0.6
    assert case.solver.path_step == 0.02


def test_one_coordinate_alone_keeps_members_of_the_set():
    assert designs(make_plan("periodic", ("n_stripe=4",))) == [(4, 16), (4, 24), (4, 32)]
    assert designs(make_plan("periodic", ("n_subunit=48",))) == [(6, 48), (8, 48)]


def test_impossible_combinations_of_a_grid_are_excluded_with_their_reason():
    plan = make_plan("periodic", ("n_stripe=4,5,6", "n_subunit=24,32"))
    assert designs(plan) == [(4, 24), (4, 32), (6, 24)]
    assert sorted(plan.excluded) == [(5, 24), (5, 32), (6, 32)]
    assert "no rib stripe" in plan.excluded[5, 24]
    assert "multiple of 2 × n_stripe = 12" in plan.excluded[6, 32]


def test_further_strains_join_the_even_ones():
    plan = make_plan(
        "periodic", ("strain_max=0.3", "strain_step=0.1", "further_strains=0.23,0.1,0.4")
    )
    assert plan.applied_strain == (0.0, 0.1, 0.2, 0.23, 0.3)


def test_every_mistake_of_a_workflow_is_in_one_message(tmp_path):
    path = workflow(
        tmp_path,
        'figures = ["maps"]\n[design]\nn_stripe = [0]\n'
        "[model]\nwall = 3\n[protocol]\nstrain_max = -1\n",
    )
    with pytest.raises(InputError) as caught:
        make_plan(path, ("hinges=none",))
    text = "\n".join(map(str, caught.value.mistakes))
    places = ("title", "figures.0", "n_stripe.0", "model.wall", "strain_max", "hinges=none")
    assert all(place in text for place in places)


def test_mistakes_of_workflow_and_design_are_in_one_message():
    with pytest.raises(InputError) as caught:
        make_plan("periodic", ("n_stripe=5", "n_subunit=20", "k_wall=-1", "hinge=all"))
    bad = ["settings hinge=all", "settings k_wall=-1", "settings n_stripe=5, settings n_subunit=20"]
    assert [mistake.path for mistake in caught.value.mistakes] == bad


def test_a_workflow_may_be_a_file_of_the_same_form(tmp_path):
    plan = make_plan(workflow(tmp_path, 'title = "a"\n[design]\nn_stripe = 4\nn_subunit = [16]\n'))
    assert plan.workflow == "mine"
    assert designs(plan) == [(4, 16)]


@pytest.mark.parametrize(
    ("overrides", "same"),
    [
        *((override, False) for override in ["z_max=5.9", "strain_max=0.42", "tolerance=1e-9"]),
        *((override, False) for override in ["hinges=fold_lines", "garter_start=mountain"]),
        *((override, False) for override in ["unit_cells=1,2", "pattern=RG,GR"]),
        ("load=warp load_angle=30", True),
        ("fold_slide=0.2", True),
        ("fold_friction=0.1", False),
    ],
)
def test_what_changes_numbers_and_nothing_else_changes_the_identifier(overrides, same):
    design = ("n_stripe=4", "n_subunit=16")
    (one,), (other,) = (
        make_plan("periodic", (*design, *more)).cases for more in ((), overrides.split())
    )
    assert (one == other) is same


def test_what_changes_no_number_leaves_the_identifier(tmp_path):
    text = '{title}\n[design]\nset = "preview"\nn_stripe = [{n}]\n[model]\nboundary = "periodic"\n'
    alone = make_plan(workflow(tmp_path, text.format(title='title = "a"', n="4")))
    among = make_plan(
        workflow(tmp_path, text.format(title='title = "b"\nfigures = ["curves"]', n="4, 8"))
    )
    assert set(alone.cases) < set(among.cases)


def test_a_plan_records_everything_it_resolved(tmp_path):
    plan = make_plan("periodic", ("n_stripe=4",))
    plan.write(tmp_path / "plan.json")
    record = json.loads((tmp_path / "plan.json").read_text())
    assert list(record["cases"]) == list(plan.cases)
    case = next(iter(record["cases"].values()))
    given = {name: value for name, value in case["warp"].items() if value is not None}
    stripe = {"period": 1.44, "k_s": 4.78, "theta_0": 0.68, "k_t": 0.045}
    assert given == {"knit": "garter", "n": 8, **stripe}
    assert case["options"]["fold_phase"] == "stripe_border"
    assert list(tmp_path.iterdir()) == [tmp_path / "plan.json"]


def test_the_stripes_workflow_holds_all_nine_under_both_boundaries():
    plan = make_plan("stripes")
    assert plan.dims == ("knit", "n", "boundary")
    assert len(plan.cases) == 18
    assert all(case.pure and case.pattern == ("G",) for case in plan.cases.values())
    assert {case.options.boundary for case in plan.cases.values()} == {"periodic", "clamped"}


@pytest.mark.parametrize(
    ("settings", "same"),
    [
        (("boundary=periodic",), True),
        (("boundary=periodic", "method=dynamics"), False),
        (("boundary=clamped", "start=dynamics"), False),
        (("boundary=clamped", "start=flat"), True),
        (("boundary=clamped", "start=periodic"), True),
    ],
)
def test_mass_and_damping_change_the_identifier_of_what_moves_alone(settings, same):
    design = ("n_stripe=4", "n_subunit=16", *settings)
    for name, values in (("damping_ratio", (0.01, 0.03)), ("surface_density", (1e-4, 3e-4))):
        (one,), (other,) = (make_plan("periodic", (*design, f"{name}={v}")).cases for v in values)
        assert (one == other) is same


def test_fabrics_that_move_otherwise_are_not_in_one_batch():
    settings = ("n_stripe=4", "n_subunit=16", "boundary=clamped", "start=dynamics")
    swept = make_plan("periodic", (*settings, "damping_ratio=0.01,0.03"))
    assert len(batched(swept.cases)) == 1
    swept = make_plan("periodic", (*settings, "rest_force=1e-6,1e-7"))
    assert len(batched(swept.cases)) == 2


def test_a_workflow_is_of_checkerboards_or_of_stripes(tmp_path):
    for path, overrides in (
        ("stripes", ("n_stripe=4",)),
        (workflow(tmp_path, 'title = "neither"\n'), ()),
    ):
        with pytest.raises(InputError, match=r"\[design\].*\[stripes\]"):
            make_plan(path, overrides)
    with pytest.raises(InputError, match=r"n = \[5\]"):
        make_plan("stripes", ("n=5",))


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ("[design]\nn_stripe = [[4, 6]]\nn_subunit = 24", r"n_stripe.*\[4, 6\]"),
        ("[design]\nn_strip = 4", "'n_stripe'"),
        ('[design]\n[model]\ncell_sise = "flat"', "'cell_size'"),
        ("[design]\n[modell]\nz_max = 1.0", "'model'"),
        ('[design]\nmaterial = "mine.toml"', r"design.material: .*\[model\]"),
        ("strain_max = 0.3\n[design]", r"strain_max: .*\[protocol\]"),
        ('[design]\nfigures = ["auxetic"]', "design.figures: .*top level"),
        ("[design.model]", "design.model: .*top level"),
        ('figures = ["auxetc"]\n[design]', "'auxetic'"),
    ],
)
def test_a_mistake_in_a_workflow_is_reported_once_with_its_remedy(tmp_path, lines, said):
    with pytest.raises(InputError, match=said) as caught:
        make_plan(workflow(tmp_path, f'title = "mine"\n{lines}\n'))
    assert len(caught.value.mistakes) == 1


@pytest.mark.parametrize(
    ("workflow", "setting", "said"),
    [
        ("periodic", "strain_max=9", ("strain_max = 9", "0.2 to 0.6")),
        ("periodic", "k_t_factor=1e4", ("k_t of rib 4", "178 N", "0.0048 to 0.0498 N")),
        ("periodic", "rib_period=30", ("period of rib 4", "30 mm", "1.09 to 2.44 mm")),
        ("preview", "drag=1", ("drag = 1", "dynamics")),
        ("periodic", "load_ratio=2", ("load_ratio", "load = warp", "load = biaxial")),
        ("periodic", "cycle=2", ("cycle = 2", "friction")),
    ],
)
def test_what_is_unusual_or_ignored_is_said(workflow, setting, said):
    plan = make_plan(workflow, ("n_stripe=4", "n_subunit=16", "strain_step=0.03", setting))
    assert any(all(part in warning for part in said) for warning in plan.warnings)


@pytest.mark.parametrize("workflow", ["periodic", "paper", "sensor", "stripes", "options"])
def test_shipped_values_give_no_warning(workflow):
    assert make_plan(workflow).warnings == ()
