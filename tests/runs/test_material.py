"""Materials: files and objects, what replaces the paper's yarn, and what is refused."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import knitlab as kl
from knitlab.io.errors import InputError
from knitlab.runs.material import SCALED, add_stripe, with_material
from knitlab.runs.parameters import StripeTables
from knitlab.runs.plan import make_plan

PAPER = kl.defaults()
RIB, GARTER = PAPER.stripes.stripe("rib", 4), PAPER.stripes.stripe("garter", 8)
STRAINS = [0.0, 0.05, 0.1]


def longer(stripe, factor):
    """A stripe of a similar fabric: all lengths multiplied, k_s kept, energies as lengths²."""
    return replace(stripe, period=factor * stripe.period, k_t=factor**2 * stripe.k_t)


def written(path, *stripes, **lengths):
    kl.Material(stripes, name="acrylic", **lengths).write(path)
    return str(path)


@pytest.mark.slow
@pytest.mark.nightly
def test_a_similar_fabric_of_another_size_has_the_same_curve():
    # Fails if any length that acts on the fabric, such as z_max, is not scaled with the periods.
    design = kl.Design(4, 16, boundary="periodic")
    similar = kl.Material((longer(RIB, 7.0), longer(GARTER, 7.0)))
    # Forces are 7 and areas 49 times as large. The pressure of contact is no length: it is given.
    sheet = with_material(PAPER, similar).sheet
    sheet = replace(sheet, contact_pressure=sheet.contact_pressure / 7.0)
    paper = kl.simulate(design, STRAINS)
    scaled = kl.simulate(design, STRAINS, material=similar, sheet=sheet)
    np.testing.assert_allclose(scaled["poisson_ratio"], paper["poisson_ratio"], rtol=1e-5)
    np.testing.assert_allclose(scaled["relaxed_cell_x"], 7.0 * paper["relaxed_cell_x"], rtol=1e-6)
    # Its periods are measured: the cloth is as large as the network.
    for axis in "xy":
        cloth, network = (scaled[f"{kind}_cell_{axis}"] for kind in ("knit", "relaxed"))
        np.testing.assert_allclose(cloth, network, rtol=1e-6)


def test_own_lengths_are_kept_and_the_others_are_stated(tmp_path):
    path = written(tmp_path / "a.toml", longer(RIB, 7.0), longer(GARTER, 7.0), z_max=38.0)
    settings = {"n_stripe": 4, "n_subunit": 16, "material": path}
    plan = make_plan("periodic", settings)
    (case,) = plan.cases.values()
    assert case.sheet.z_max == 38.0
    assert case.sheet.cloth_stitch_width == pytest.approx(plan.gauge.stitch_width)
    (case,) = make_plan("periodic", settings | {"z_max": 20.0}).cases.values()
    assert case.sheet.z_max == 20.0
    # A flat period has 2n stitches.
    width = 7 * RIB.period / RIB.contraction / (2 * RIB.n)
    height = 7 * GARTER.period / GARTER.contraction / (2 * GARTER.n)
    assert plan.gauge.stitch_width == pytest.approx(width)
    assert plan.gauge.stitch_height == pytest.approx(height)
    assert plan.material == "acrylic"
    (sentence,) = plan.warnings
    thickness = PAPER.sheet.thickness * width / PAPER.gauge.stitch_width
    assert f"thickness = {thickness:.3g} mm" in sentence
    assert make_plan("periodic", settings | {"z_max": 20.0, "thickness": 1.0}).warnings == ()


def test_another_stitch_than_that_of_the_periods_is_said_with_both_sizes(tmp_path):
    path = written(tmp_path / "a.toml", longer(RIB, 7.0), longer(GARTER, 7.0), stitch_width=2.0)
    settings = {"n_stripe": 4, "n_subunit": 16, "material": path, "z_max": 20.0, "thickness": 1.0}
    (sentence,) = make_plan("periodic", settings).warnings
    implied = 7 * RIB.period / RIB.contraction / (2 * RIB.n)
    for part in ("stitch_width = 2 mm", f"{implied:.3g} mm", "rib 4", "leave"):
        assert part in sentence


@pytest.mark.parametrize(
    ("setting", "value"), [("cell_size", "flat"), ("hinge_stiffness", "per_length")]
)
def test_model_options_that_contradict_the_material_are_refused(tmp_path, setting, value):
    own = replace(longer(RIB, 7.0), row_width=3.0), replace(longer(GARTER, 7.0), row_width=3.0)
    path = written(tmp_path / "a.toml", *own)
    settings = {"n_stripe": 4, "n_subunit": 16, "material": path}
    with pytest.raises(InputError, match=f"{value}.*'acrylic'"):
        make_plan("periodic", settings | {setting: value})
    model, material = replace(kl.Model(), **{setting: value}), kl.Material(own, name="acrylic")
    with pytest.raises(InputError, match=f"{value}.*'acrylic'"):
        kl.simulate(kl.Design(4, 16), STRAINS, material=material, model=model)


def test_stripes_over_width_and_of_rows_are_not_mixed(tmp_path):
    wide = replace(RIB, row_width=3.0)
    with pytest.raises(InputError, match="row_width for garter 8"):
        kl.Material((wide, GARTER))
    add_stripe(tmp_path / "a.toml", wide, "first")
    with pytest.raises(InputError, match="relaxed"):
        add_stripe(tmp_path / "a.toml", replace(GARTER, row_width=3.0), "second", cell_size="flat")
    with pytest.raises(InputError, match=r"a.toml: rib 4.*garter 8.*width"):
        add_stripe(tmp_path / "a.toml", GARTER, "second")
    # It may take the place of the only one.
    add_stripe(tmp_path / "a.toml", RIB, "again")
    add_stripe(tmp_path / "a.toml", GARTER, "second")


@pytest.mark.slow
def test_size_in_cloth_and_force_over_width_do_not_depend_on_the_convention():
    rib, garter = (replace(longer(each, 7.0), row_width=3.0) for each in (RIB, GARTER))
    flat = [replace(each, period=each.period / each.contraction) for each in (rib, garter)]
    design = kl.Design(4, 16, boundary="periodic")
    relaxed = kl.simulate(design, STRAINS, material=kl.Material((rib, garter)))
    other = kl.simulate(design, STRAINS, material=kl.Material(tuple(flat), cell_size="flat"))
    for name in ("knit_cell_x", "knit_cell_y", "force_per_width", "poisson_ratio"):
        np.testing.assert_allclose(other[name], relaxed[name], rtol=1e-6, atol=1e-9)


def test_a_length_that_is_not_given_is_stated_where_it_acts(tmp_path):
    path = written(tmp_path / "a.toml", longer(RIB, 7.0), longer(GARTER, 7.0))
    settings = {"n_stripe": 4, "n_subunit": 16, "material": path}
    wider = 7 * RIB.period / RIB.contraction / (2 * RIB.n) / PAPER.gauge.stitch_width
    (plain,) = make_plan("periodic", settings | {"contact": "none"}).warnings
    assert f"z_max = {wider * PAPER.sheet.z_max:.3g} mm" in plain
    assert "thickness" not in plain
    (contact,) = make_plan("periodic", settings).warnings
    assert f"thickness = {wider * PAPER.sheet.thickness:.3g} mm" in contact
    (sensor,) = make_plan("sensor", settings).warnings
    assert f"clearance = {wider * PAPER.capacitor.clearance:.3g} mm" in sensor


@pytest.mark.parametrize(
    ("workflow", "given", "problem"),
    [
        ("periodic", {"n_stripe": 6, "n_subunit": 12}, "n_stripe = 6"),
        ("periodic", {"n_stripe": 2}, "n_stripe = 2"),
        ("stripes", {"n": 6}, r"n = \[6\]"),
    ],
)
def test_the_papers_stripes_are_not_used_beside_a_material(tmp_path, workflow, given, problem):
    path = written(tmp_path / "a.toml", longer(RIB, 7.0), longer(GARTER, 7.0))
    with pytest.raises(InputError, match=problem):
        make_plan(workflow, given | {"material": path})
    plan = make_plan("periodic", {"material": path})
    assert {case.design["n_stripe"] for case in plan.cases.values()} == {4}
    assert all("acrylic" in reason for reason in plan.excluded.values())
    ribs = written(tmp_path / "rib.toml", RIB)
    with pytest.raises(InputError, match=r"garter stripe of 8.*'acrylic'"):
        make_plan("periodic", {"n_stripe": 4, "n_subunit": 16, "material": ribs})
    # Pure rib needs no garter.
    made = make_plan("stripes", {"knit": "rib", "material": ribs})
    assert {case.weft.n for case in made.cases.values()} == {4}


def test_plain_knit_of_the_paper_is_not_used_either(tmp_path):
    path = written(tmp_path / "a.toml", RIB, GARTER)
    given = {"n_stripe": 4, "n_subunit": 16, "pattern": ["GP", "RG"], "material": path}
    with pytest.raises(InputError, match=r"plain knit.*plain_stretch_weft"):
        make_plan("periodic", given)
    written(tmp_path / "a.toml", RIB, GARTER, plain=PAPER.plain)
    (case,) = make_plan("periodic", given).cases.values()
    assert case.plain == PAPER.plain


def test_stripes_are_interpolated_only_if_asked(tmp_path):
    ribs = [PAPER.stripes.stripe("rib", n) for n in (4, 8)]
    garters = [PAPER.stripes.stripe("garter", n) for n in (8, 16)]
    path = written(tmp_path / "a.toml", *ribs, *garters)
    given = {"n_stripe": 6, "n_subunit": 12, "material": path}
    with pytest.raises(InputError, match="n_stripe = 6"):
        make_plan("periodic", given)
    (case,) = make_plan("periodic", given | {"interpolate_stripes": True}).cases.values()
    assert case.weft.period == pytest.approx((ribs[0].period + ribs[1].period) / 2)
    assert case.weft.k_t == pytest.approx(np.sqrt(ribs[0].k_t * ribs[1].k_t))
    beyond = given | {"n_stripe": 10, "n_subunit": 20, "interpolate_stripes": True}
    with pytest.raises(InputError, match="n_stripe = 10"):
        make_plan("periodic", beyond)


def test_the_papers_stripes_are_interpolated_too_and_not_for_a_list():
    settings = {"n_stripe": 7, "n_subunit": 14, "interpolate_stripes": True}
    (case,) = make_plan("periodic", settings).cases.values()
    below, above = (PAPER.stripes.stripe("rib", n) for n in (6, 8))
    assert below.period < case.weft.period < above.period
    for name, value in (("interpolate_stripes", [True, False]), ("material", ["a", "b"])):
        with pytest.raises(InputError, match=name):
            make_plan("periodic", {name: value})


def test_a_stripe_between_stiffening_ones_is_refused():
    stripes = [replace(RIB, n=n, stiffening_strain=0.2) for n in (4, 8)]
    tables = StripeTables(interpolate=True).with_stripes(stripes)
    with pytest.raises(InputError, match="between 4 and 8"):
        tables.stripe("rib", 6)


POSITIVE = st.floats(1e-3, 1e3)


@settings(deadline=None)
@given(
    numbers=st.lists(
        st.tuples(POSITIVE, POSITIVE, st.floats(0.1, 3.0), POSITIVE), min_size=1, max_size=4
    ),
    lengths=st.dictionaries(st.sampled_from(sorted(SCALED)), POSITIVE),
    interpolate=st.booleans(),
)
def test_a_material_is_read_as_it_was_written(tmp_path_factory, numbers, lengths, interpolate):
    path = tmp_path_factory.mktemp("material") / "yarn.toml"
    knits = ("garter", "rib")
    stripes = tuple(
        sorted(
            (kl.Stripe(knits[k % 2], 2 + k, *values) for k, values in enumerate(numbers)),
            key=lambda stripe: (stripe.knit == "garter", stripe.n),
        )
    )
    material = kl.Material(stripes, name="yarn", interpolate=interpolate, source="test", **lengths)
    material.write(path)
    read = kl.Material.read(path)
    assert replace(read, source="test") == material


def test_a_calibrated_stripe_is_added_to_the_file_and_replaces_itself(tmp_path):
    path = tmp_path / "acrylic.toml"
    add_stripe(path, RIB, "first")
    add_stripe(path, GARTER, "second")
    add_stripe(path, replace(RIB, k_s=2.0), "third", {"k_s": {"k_s": 0.01}})
    read = kl.Material.read(path)
    assert read.name == "acrylic"
    assert read.stripes == (replace(RIB, k_s=2.0), GARTER)
    assert "third" in read.source


def test_a_material_with_mistakes_lists_every_one(tmp_path):
    path = tmp_path / "bad.toml"
    path.write_text('z_max = { value = -1.0, unit = "cm", source = "ruler" }\nthicknes = 3\n')
    with pytest.raises(InputError) as caught:
        make_plan("periodic", {"material": str(path)})
    assert all(name in str(caught.value) for name in ("z_max.value", "z_max.unit", "thicknes"))


@pytest.mark.parametrize("n", ["04", "0", "99999", "9" * 5000, "four", "4\n"])
def test_a_stripe_is_named_by_its_number_of_stitches(tmp_path, n):
    path = tmp_path / "a.toml"
    key = n.replace("\n", "\\n")
    path.write_text(Path(written(path, RIB)).read_text().replace("n.4]", f'n."{key}"]'))
    for make in (lambda: kl.Material.read(path), lambda: kl.Material((replace(RIB, n=n),))):
        with pytest.raises(InputError, match=r"1 to 9999|Stripe: n"):
            make()


def test_a_wrong_length_of_a_workflow_is_named_and_not_scaled(tmp_path):
    path = written(tmp_path / "a.toml", RIB, GARTER)
    workflow = tmp_path / "mine.toml"
    workflow.write_text('title = "mine"\n[design]\nn_stripe = [4]\n[gauge]\nstitch_width = "x"\n')
    with pytest.raises(InputError, match=r"gauge\.stitch_width"):
        make_plan(str(workflow), {"material": path})


def test_the_surface_density_of_a_material_is_that_of_its_dynamics(tmp_path):
    heavy = kl.Material((longer(RIB, 7.0), longer(GARTER, 7.0)), surface_density=4e-4)
    heavy.write(tmp_path / "heavy.toml")
    assert kl.Material.read(tmp_path / "heavy.toml").surface_density == 4e-4
    settings = {"n_stripe": 4, "n_subunit": 16, "material": str(tmp_path / "heavy.toml")}
    (case,) = make_plan("relaxation", settings).cases.values()
    assert case.motion.surface_density == 4e-4
