"""Samples of stripes: their covariance, paired settings, and first order against Monte Carlo."""

import math

import numpy as np
import pytest
import xarray as xr
from scipy.stats import kstest, norm
from scipy.stats import t as student_t

import knitlab as kl
from knitlab.cubes.uncertainty import NUMBERS
from knitlab.io.errors import InputError
from knitlab.io.toml import read_toml
from knitlab.lab.calibration import FITTED
from knitlab.runs.plan import make_plan
from knitlab.runs.stripe_covariance import with_period
from knitlab.runs.stripe_samples import student_hypercube

TABLES = kl.defaults().stripes
ERRORS = {"k_s": 0.02, "k_t": 0.012, "theta_0": 0.004, "period": 0.004}


def table(correlation=-0.8):
    """Covariance of a stripe whose k_s and θ0 are correlated."""
    matrix = np.diag([ERRORS[name] ** 2 for name in NUMBERS])
    matrix[0, 2] = matrix[2, 0] = correlation * ERRORS["k_s"] * ERRORS["theta_0"]
    rows = zip(NUMBERS, matrix.tolist(), strict=True)
    return {name: dict(zip(NUMBERS, row, strict=True)) for name, row in rows}


@pytest.fixture(scope="module")
def yarn(tmp_path_factory):
    """The paper's yarn with uncertain stripes, as a file."""
    path = tmp_path_factory.mktemp("yarn") / "yarn.toml"
    knits = ("rib", (4, 6)), ("garter", (8, 12))
    stripes = [TABLES.stripe(knit, n) for knit, sizes in knits for n in sizes]
    covariances = {(each.knit, each.n): table() for each in stripes}
    kl.Material(tuple(stripes), name="yarn", covariances=covariances).write(path)
    assert kl.Material.read(path).covariances == covariances
    return path


def test_repeats_and_degrees_of_freedom_travel_with_the_material(tmp_path):
    stripe, path = TABLES.stripe("rib", 4), tmp_path / "yarn.toml"
    known = kl.StripeCovariance(table(), 4, 5)
    of_curve = kl.StripeCovariance(table(), 7.5)
    for each in (known, of_curve):
        kl.Material((stripe,), name="yarn", covariances={("rib", 4): each}).write(path)
        read = kl.Material.read(path).covariances["rib", 4]
        assert (read, read.degrees_of_freedom) == (each, each.degrees_of_freedom)
        assert read.repeats == each.repeats
        assert with_period(read, stripe.theta_0).repeats == each.repeats
    text = path.read_text()
    path.write_text(text.replace("degrees_of_freedom = 7.5", "repeats = 1"))
    with pytest.raises(InputError, match="repeats"):
        kl.Material.read(path)
    kl.Material((stripe,), name="yarn").write(path)
    path.write_text(path.read_text().replace("[rib.n.4]", "[rib.n.4]\nrepeats = 5"))
    with pytest.raises(InputError, match=r"rib.*covariance; give it"):
        kl.Material.read(path)


def test_samples_of_few_repeats_are_those_of_the_multivariate_t():
    deviates = student_hypercube(4000, (4, 4), (4.0, math.inf), 0)
    along = deviates @ np.array([0.6, 0, 0.8, 0, 0, 0, 0, 0])
    assert kstest(along, student_t(4).cdf).pvalue > 0.01
    assert kstest(deviates[:, 5], norm.cdf).pvalue > 0.01
    # The deviates of one stripe are small and large together.
    assert np.corrcoef(abs(deviates[:, 0]), abs(deviates[:, 1]))[0, 1] > 0.1
    assert abs(np.corrcoef(abs(deviates[:, 0]), abs(deviates[:, 5]))[0, 1]) < 0.05


def test_samples_are_of_a_new_swatch_by_default_and_not_of_two_repeats(tmp_path):
    stripes = TABLES.stripe("rib", 4), TABLES.stripe("garter", 8)

    def sampled(repeats, **asked):
        known = kl.StripeCovariance(table(), repeats - 1, repeats)
        covariances = {(each.knit, each.n): known for each in stripes}
        kl.Material(stripes, name="yarn", covariances=covariances).write(tmp_path / "yarn.toml")
        path = tmp_path / "s.toml"
        kl.sample_stripes(tmp_path / "yarn.toml", path, n_stripe=4, samples=64, **asked)
        return read_toml(path)

    swatch, mean = sampled(5), sampled(5, uncertainty_of="mean")
    ratio = np.log(swatch["paired"]["rib_k_s"]).std() / np.log(mean["paired"]["rib_k_s"]).std()
    assert ratio == pytest.approx(np.sqrt(6), rel=1e-6)
    assert "a new swatch" in swatch["title"]
    assert "the mean stripe" in mean["title"]
    with pytest.raises(InputError, match=r"rib 4: .*1 degrees of freedom.*3 repeats"):
        sampled(2)


def changes_of(sampled, knit, n):
    """Changes of the uncertain numbers of a stripe in the cases of a plan."""
    stripe = TABLES.stripe(knit, n)
    got = [case.weft if knit == "rib" else case.warp for case in sampled.values()]
    return np.array(
        [
            [
                each.theta_0 - stripe.theta_0
                if name == "theta_0"
                else np.log(getattr(each, name) / getattr(stripe, name))
                for name in NUMBERS
            ]
            for each in got
        ]
    )


@pytest.mark.slow
def test_samples_have_the_covariance_of_the_material_and_its_lengths(yarn, tmp_path):
    path = kl.sample_stripes(yarn, tmp_path / "s.toml", n_stripe=4, samples=400)
    plan = kl.plan(path, n_subunit=16)
    assert plan.dims == ("n_stripe", "n_subunit", "sample")
    wanted = np.array([[table()[one][other] for other in NUMBERS] for one in NUMBERS])
    scale = np.sqrt(np.outer(np.diag(wanted), np.diag(wanted)))
    for knit, n in (("rib", 4), ("garter", 8)):
        changes = changes_of(plan.cases, knit, n)
        np.testing.assert_allclose(changes.mean(axis=0) / np.sqrt(np.diag(wanted)), 0, atol=0.02)
        np.testing.assert_allclose(np.cov(changes.T) / scale, wanted / scale, atol=0.15)
        assert np.std(changes[:, 1]) == pytest.approx(ERRORS["k_t"], rel=0.02)
    # All else is that of a run with the material, but for perturbed copies.
    (case,) = kl.plan(
        "periodic", n_stripe=4, n_subunit=16, material=yarn, robustness=0
    ).cases.values()
    for each in plan.cases.values():
        assert (each.sheet, each.options, each.robustness) == (case.sheet, case.options, 0)


@pytest.mark.slow
def test_samples_for_sobol_indices_leave_out_correlations(yarn, tmp_path):
    path = kl.sample_stripes(yarn, tmp_path / "s.toml", n_stripe=4, samples=64, sobol=True)
    plan = kl.plan(path, n_subunit=16)
    assert len(plan.cases) == 64 * (8 + 2)
    changes = changes_of(plan.cases, "rib", 4)[: 2 * 64]
    assert abs(np.corrcoef(changes.T)[0, 2]) < 0.2
    with pytest.raises(InputError, match=r"samples 48.*power of 2"):
        kl.sample_stripes(yarn, tmp_path / "s.toml", n_stripe=4, samples=48, sobol=True)


def test_what_cannot_be_sampled_is_refused(yarn, tmp_path):
    with pytest.raises(InputError, match="rib 8"):
        kl.sample_stripes(yarn, tmp_path / "s.toml", n_stripe=8)
    with pytest.raises(InputError, match="suffix"):
        kl.sample_stripes(yarn, tmp_path / "s", n_stripe=4)
    with pytest.raises(InputError, match="designs"):
        kl.sample_stripes(yarn, tmp_path / "s.toml", n_stripe=4, workflow="stripes")


WORKFLOW = """
title = "Pairs"
[design]
n_stripe = [4]
n_subunit = [16]
[model]
boundary = "periodic"
"""


def paired(tmp_path, lines, **settings):
    path = tmp_path / "pairs.toml"
    path.write_text(f"{WORKFLOW}\n[paired]\n{lines}\n")
    return make_plan(str(path), settings)


def test_paired_lists_change_together(tmp_path):
    lists = "rib_k_s = [1.0, 1.0, 2.0]\nz_max = [3.0, 4.0, 4.0]\nbranch_limit = [0.1, 0.2, 0.3]"
    cases = paired(tmp_path, lists, k_t_factor=[1.0, 1.2]).cases.values()
    got = {
        (case.design["k_t_factor"], case.design["sample"]): (
            case.weft.k_s,
            case.sheet.z_max,
            case.solver.branch_limit,
        )
        for case in cases
    }
    sets = [(1.0, 3.0, 0.1), (1.0, 4.0, 0.2), (2.0, 4.0, 0.3)]
    assert got == {
        (factor, number): values
        for factor in (1.0, 1.2)
        for number, values in enumerate(sets, start=1)
    }


@pytest.mark.parametrize(
    ("lines", "settings", "problem"),
    [
        ("rib_k_s = [1.0]\nz_max = [3.0, 4.0]", {}, "as long as the others"),
        ("rib_k_s = 1.0", {}, "as long"),
        ("rib_k_s = [1.0, -2.0]", {}, "rib_k_s: value 2"),
        ("rib_k = [1.0, 2.0]", {}, "rib_k"),
        ("material = ['a', 'b']", {}, "material"),
        ("boundary = ['periodic', 'clamped']", {}, r"one value in \[model\] too"),
        ("rib_k_s = [1.0, 2.0]", {"rib_k_s": 1.0}, r"one value in \[model\] too"),
    ],
)
def test_lists_that_cannot_be_paired_are_refused(tmp_path, lines, settings, problem):
    with pytest.raises(InputError, match=problem):
        paired(tmp_path, lines, **settings)


def test_a_flat_period_varies_with_the_angle_from_which_it_follows():
    theta, matrix = 0.9, np.array([[4.0, 1.0, -1.0], [1.0, 2.0, 0.5], [-1.0, 0.5, 1.0]]) * 1e-6
    fitted = {
        one: dict(zip(FITTED, row, strict=True))
        for one, row in zip(FITTED, matrix.tolist(), strict=True)
    }
    found = with_period(kl.StripeCovariance(fitted), theta)
    names = [*FITTED, "period"]
    samples = np.random.default_rng(0).multivariate_normal(np.zeros(3), matrix, 100_000)
    period = -np.log(np.sin((theta + samples[:, 2]) / 2) / np.sin(theta / 2))
    wanted = np.cov(np.column_stack([samples, period]).T)
    got = np.array([[found[one][other] for other in names] for one in names])
    np.testing.assert_allclose(got, wanted, atol=3e-8)
    assert np.linalg.eigvalsh(got).min() > -1e-15


DESIGNS = {4: [8, 16, 24], 6: [12, 24]}


@pytest.mark.slow
@pytest.mark.nightly
def test_first_order_agrees_with_monte_carlo_on_five_designs(yarn, tmp_path):
    for n_stripe, subunits in DESIGNS.items():
        settings = {"n_subunit": subunits, "strain_max": 0.09, "results": tmp_path}
        path = kl.sample_stripes(
            yarn, tmp_path / f"s{n_stripe}.toml", n_stripe=n_stripe, samples=12
        )
        samples = kl.run(path, **settings)
        exact = {"material": yarn, "sensitivities": True, "robustness": 0, "n_stripe": n_stripe}
        cube = kl.run("periodic", **exact, **settings | {"results": tmp_path / str(n_stripe)})
        linear = kl.uncertainty(cube, material=yarn)
        spread = kl.uncertainty(samples)
        assert (spread["samples"] == 12).all()
        changes = {}
        for name in cube["stripe_parameter"].values:
            relative = samples[name] / cube[name]
            changes[name] = relative - 1 if name.endswith("theta_0") else np.log(relative)
        for quantity in ("poisson_ratio", "reaction_force"):
            # The same samples by the linear function.
            slope = cube[f"{quantity}_sensitivity"]
            predicted = sum(
                slope.sel(stripe_parameter=name) * each for name, each in changes.items()
            )
            at = {"applied_strain": slice(0.03, None)}
            off_by = abs(samples[quantity] - cube[quantity] - predicted).sel(at)
            deviation = predicted.std("sample", ddof=1).sel(at)
            # Some samples relax to another shape, which no derivative knows; where ridges touch at
            # rest, to one of several that are nearly alike.
            touches = cube["energy_contact"].sel(applied_strain=0) > 0
            roughness = touches * 0.015 * abs(cube[quantity].sel(at))
            assert (off_by.quantile(0.7, "sample") < 0.15 * deviation + roughness).all()
            # Twelve samples know a deviation to about a fifth.
            by_covariance = linear[f"{quantity}_sd"].sel(at)
            sampled = spread[f"{quantity}_sd"].sel(at)
            assert (abs(deviation / by_covariance - 1) < xr.where(touches, 0.5, 0.4)).all()
            assert (abs(sampled / by_covariance - 1) < xr.where(touches, 0.6, 0.5)).all()
