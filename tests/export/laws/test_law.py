"""The law of a cloth: derivatives, a law that is known, and a fabric by work, plate and tests."""

import json
import runpy
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest

import knitlab as kl
from knitlab.export.laws.fitting import fitted, predicted
from knitlab.export.laws.law import errors_of
from knitlab.export.laws.ridge_law import MIRROR, RidgeLaw, Ridges
from knitlab.export.laws.strain_tests import (
    A,
    B,
    C,
    StrainTest,
    rows_of_tests,
    strain_of,
    strain_tests,
)
from knitlab.io.errors import InputError
from tests.export.meshes.synthetic import PREVIEW
from tests.refusals import refused

LAW = PREVIEW.parent / "law"
STIFFNESS = np.array([[1.0, -0.6, 0.0], [-0.6, 2.0, 0.0], [0.0, 0.0, 0.5]])  # auxetic


class Quadratic:
    """S = C E, whose tests have closed forms."""

    def stress(self, strain):
        return strain @ STIFFNESS

    def energy(self, strain):
        return np.sum(strain @ STIFFNESS * strain, axis=-1) / 2


def synthetic(angle, prescribed, applied, ratio=0.0):
    """A test of the quadratic law."""
    planned = np.tile([1.0, 1.0, 0.0], (len(applied), 1))
    if prescribed == (C,):
        planned[:, C] = applied
    else:
        planned[:, B] += applied
    planned[:, A] += ratio * np.asarray(applied)
    template = StrainTest("", angle, planned, prescribed, 0 * planned, np.zeros(len(applied)))
    stretch, force = predicted(Quadratic(), template)
    energy = Quadratic().energy(strain_of(stretch, angle))
    return StrainTest(f"{angle} {prescribed} {ratio}", angle, stretch, prescribed, force, energy)


APPLIED = np.linspace(0, 0.2, 9)
KNOWN = [
    *(synthetic(angle, (B,), APPLIED) for angle in (0, 20, 40, 65, 90)),
    *(synthetic(90, (A, B, C), APPLIED, ratio) for ratio in (0, 0.7, 1.3)),
    synthetic(90, (C,), APPLIED),
]


@pytest.fixture(scope="module")
def law():
    return kl.law(LAW)


@pytest.fixture
def random_law():
    numbers = np.random.default_rng(3)
    ridges = Ridges(numbers.normal(size=(30, 3)), numbers.normal(size=30) / 10, 0.02)
    return RidgeLaw(ridges, numbers.random(30))


def test_forces_are_the_derivatives_of_the_energy_and_stable(random_law):
    strains = np.random.default_rng(4).normal(size=(50, 3)) / 5
    step = 1e-5
    for part in range(3):
        ahead, behind = strains + step * np.eye(3)[part], strains - step * np.eye(3)[part]
        slope = (random_law.energy(ahead) - random_law.energy(behind)) / (2 * step)
        np.testing.assert_allclose(random_law.stress(strains)[:, part], slope, atol=1e-8)
        slope = (random_law.stress(ahead) - random_law.stress(behind)) / (2 * step)
        np.testing.assert_allclose(random_law.tangent(strains)[:, part], slope, atol=1e-5)
    assert (np.linalg.eigvalsh(random_law.tangent(strains)) > -1e-12).all()
    assert random_law.energy(np.zeros(3)) == pytest.approx(0, abs=1e-15)
    np.testing.assert_allclose(random_law.stress(np.zeros(3)), 0, atol=1e-15)


def test_stresses_of_a_test_are_those_of_the_law_that_it_obeys():
    for test in KNOWN:
        np.testing.assert_allclose(test.stress, Quadratic().stress(test.strain), atol=1e-9)


@pytest.mark.slow
def test_a_known_law_is_found_and_predicts_other_loads():
    law = fitted(KNOWN)
    np.testing.assert_allclose(law.tangent(np.zeros(3)), STIFFNESS, atol=0.02)
    for angle, prescribed, ratio in ((30, (B,), 0), (80, (B,), 0), (90, (A, B, C), 0.4)):
        other = synthetic(angle, prescribed, APPLIED, ratio)
        stretch, force = predicted(law, other)
        np.testing.assert_allclose(force, other.force, atol=0.01 * other.force.max())
        np.testing.assert_allclose(stretch, other.stretch, atol=2e-3)


def test_a_stiffness_at_rest_is_met():
    weak = [test for test in KNOWN if test.prescribed == (B,)]
    law = fitted(weak, stiffness=STIFFNESS)
    np.testing.assert_allclose(law.tangent(np.zeros(3)), STIFFNESS, atol=0.02)


def test_stresses_of_a_fabric_do_the_work_of_its_energy():
    for test in strain_tests(rows_of_tests(kl.open_cube(LAW), {})):
        mean = (test.stress[1:] + test.stress[:-1]) / 2
        work = np.cumsum(np.sum(mean * np.diff(test.strain, axis=0), axis=1))
        # By trapezoids; fabric that snaps gives up some energy.
        assert work[-1] == pytest.approx(test.energy[-1], rel=0.02), test.label
        np.testing.assert_allclose(work, test.energy[1:], atol=0.02 * test.energy[-1])


@pytest.mark.slow
def test_a_law_predicts_the_tests_that_others_enclose(law):
    errors = law.errors
    between = errors[errors["between"]]
    assert len(between) >= 10
    assert between["force_error_left_out"].max() < 0.06
    assert between["ratio_error_left_out"].max() < 0.05


@pytest.mark.slow
@pytest.mark.nightly
def test_a_law_predicts_tests_at_angles_and_ratios_between_its_own(law, tmp_path):
    angles, ratios = [7.5, 22.5, 37.5, 52.5, 67.5, 82.5], [0.125, 0.375, 0.625, 0.875, 1.125, 1.375]
    loads = ["off_axis"] * len(angles) + ["biaxial"] * len(ratios) + ["biaxial_weft"]
    paired = {
        "load": loads,
        "load_angle": angles + [90] * (len(ratios) + 1),
        "load_ratio": [0] * len(angles) + [*ratios, 0.5],
    }
    text = Path("workflows/law.toml").read_text(encoding="utf-8").partition("[paired]")[0]
    workflow = tmp_path / "between.toml"
    lines = [f"{name} = {json.dumps(values)}" for name, values in paired.items()]
    workflow.write_text("\n".join([text, "[paired]", *lines, ""]), encoding="utf-8")
    cube = kl.run(workflow, results=tmp_path, workers=0)
    tests = strain_tests(rows_of_tests(cube, {}))
    of_force, of_ratio = np.array([errors_of(law.ridges, test) for test in tests]).T
    assert len(of_force) == len(loads)
    assert (of_ratio[[test.is_pull for test in tests]] < 0.02).all()
    # The largest is of one biaxial load at 21 and 24 %.
    assert sorted(of_force)[-2] < 0.05
    assert of_force.max() < 0.07


def test_the_tangent_of_a_law_is_the_plate_of_the_stretched_fabric(law):
    """The plate condenses the nodes of a cell out; the law has seen forces only."""
    plates = kl.plate_stiffness(LAW, sample=7).squeeze()
    (pull,) = (test for test in law.tests if test.label == "pull at 90°")
    for applied in (0.06, 0.09, 0.12, 0.15):
        state = round(applied / 0.03)
        a, b, _ = pull.stretch[state]
        scale = np.array([a**2, b**2, a * b])
        pushed = law.tangent(pull.strain[state]) * np.outer(scale, scale) / (a * b)
        plate = plates["membrane_stiffness"].sel(applied_strain=applied, method="nearest").values
        np.testing.assert_allclose(pushed, plate, atol=0.04 * plate.max())


def test_a_law_of_a_mirror_image_is_even_in_the_shear(law):
    strains = np.random.default_rng(5).normal(size=(20, 3)) / 10
    np.testing.assert_allclose(law.energy(strains), law.energy(strains * MIRROR))
    assert law.covers([0.05, 0.1, 0.01])
    assert not law.covers([0.05, 0.4, 0.0])


def test_functions_in_a_file_need_no_knitlab_and_agree(law, tmp_path):
    module = runpy.run_path(str(law.write(tmp_path / "law.py")))
    strains = np.random.default_rng(6).normal(size=(20, 3)) / 10
    for name in ("energy", "stress", "tangent"):
        np.testing.assert_allclose(module[name](strains), getattr(law, name)(strains), atol=1e-14)
    curvatures = strains / 10
    np.testing.assert_allclose(
        module["energy"](strains, curvatures), law.energy(strains, curvatures), atol=1e-14
    )
    one = jnp.asarray(strains[0])
    by_jax = jax.grad(lambda strain: module["energy"](strain, xp=jnp))(one)
    np.testing.assert_allclose(by_jax, law.stress(strains[0]), atol=1e-12)


def test_a_table_has_the_stress_over_the_strains_of_the_tests(law, tmp_path):
    table = pd.read_csv(law.write(tmp_path / "law.csv"))
    strains = table[["E_xx [1]", "E_yy [1]", "2 E_xy [1]"]].values
    np.testing.assert_allclose(table["S_yy [N/mm]"], law.stress(strains)[:, 1], atol=1e-7)
    assert 0 < table["between tests"].mean() < 1


def test_a_pull_along_the_wales_has_no_direction_of_its_own_and_is_the_same_test():
    rows = rows_of_tests(kl.open_cube(LAW), {})
    unnamed = rows.copy(deep=True)
    unnamed["load_direction"].values[rows["load_direction"] == 90] = np.nan
    for test, other in zip(strain_tests(rows), strain_tests(unnamed), strict=True):
        assert test.label == other.label
        np.testing.assert_array_equal(test.stress, other.stress)


def test_what_gives_no_law_is_refused(tmp_path):
    with refused("n_stripe", "select"):
        kl.law(PREVIEW)
    with refused("preview", "periodic"):
        kl.law(PREVIEW.parent / "preview", n_stripe=4, n_subunit=16)
    with refused("tests", "workflow law"):
        kl.law(PREVIEW, n_stripe=4, n_subunit=16)
    with pytest.raises(InputError, match=r"law\.inp"):
        kl.law(LAW, tmp_path / "law.inp")
