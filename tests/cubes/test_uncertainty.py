"""Uncertainty: closed forms of linear quantities, normal probabilities, and Sobol indices."""

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import norm
from scipy.stats import t as student_t

import knitlab as kl
from knitlab.cubes.sampled import saltelli_design, sampled_uncertainty
from knitlab.cubes.uncertainty import NUMBERS, Stripes, UncertainStripe, first_order
from knitlab.io.errors import InputError
from knitlab.io.shipped import shipped
from knitlab.observables.schema import described
from knitlab.observables.status import Status
from knitlab.runs.stripe_samples import saltelli, student_hypercube

DIMS = ("n_stripe", "n_subunit")
PARAMETERS = [f"{knit}_{name}" for knit in ("rib", "garter") for name in NUMBERS]
RIB = kl.Stripe("rib", 4, period=10.0, k_s=2.0, theta_0=0.8, k_t=0.5)
GARTER = kl.Stripe("garter", 8, period=11.0, k_s=3.0, theta_0=1.2, k_t=0.7)
STRAINS = [0.0, 0.1, 0.2]


def cube(slopes, ratio=-0.3, force=2.0):
    """One design whose ratio and force have these logarithmic slopes, and one that failed."""
    slopes = np.asarray(slopes, float)
    along = np.stack([np.full(8, np.nan), slopes, 2 * slopes])
    ratios = np.array([np.nan, ratio, 2 * ratio])
    numbers = {
        f"{each.knit}_{name}": (DIMS, [[getattr(each, name), np.nan]])
        for each in (RIB, GARTER)
        for name in NUMBERS
    }
    states = (*DIMS, "applied_strain")
    missing = np.full((1, 2, 3, 8), np.nan)
    of_ratio, of_force = missing.copy(), missing.copy()
    of_ratio[0, 0], of_force[0, 0] = along, force * along
    curves = {
        "poisson_ratio": (states, [[ratios, np.full(3, np.nan)]]),
        "reaction_force": (states, [[force * np.array(STRAINS), np.full(3, np.nan)]]),
    }
    variables = {
        "status": (DIMS, np.array([[Status.ok, Status.failed]], np.int8)),
        "case_id": (DIMS, [["a", "b"]]),
        "poisson_ratio_min": (DIMS, [[2 * ratio, np.nan]]),
        "applied_strain_at_min": (DIMS, [[0.2, np.nan]]),
        "poisson_ratio_sensitivity": ((*states, "stripe_parameter"), of_ratio),
        "reaction_force_sensitivity": ((*states, "stripe_parameter"), of_force),
    }
    coordinates = {
        "n_stripe": [4],
        "n_subunit": [16, 24],
        "applied_strain": STRAINS,
        "stripe_parameter": PARAMETERS,
    }
    return described(xr.Dataset(variables | curves | numbers, coordinates))


def pair(rib, garter):
    both = UncertainStripe(RIB, rib), UncertainStripe(GARTER, garter)
    return Stripes(lambda n: both, "mean", "of the mean stripe")


def material(rib=None, garter=None, **changes):
    """A material with the covariances of ln k_s, ln k_t, θ0 and ln period."""
    tables = {
        ("rib", 4): np.eye(4) * 1e-4 if rib is None else rib,
        ("garter", 8): np.eye(4) * 4e-4 if garter is None else garter,
    }
    covariances = {
        key: {
            one: dict(zip(NUMBERS, row, strict=True))
            for one, row in zip(NUMBERS, each.tolist(), strict=True)
        }
        for key, each in tables.items()
    }
    return kl.Material((RIB, GARTER), covariances=covariances | changes)


matrices = st.lists(st.floats(-1, 1), min_size=16, max_size=16).map(
    lambda entries: (lambda root: 1e-3 * root @ root.T)(np.reshape(entries, (4, 4)))
)


@given(matrices, matrices, st.lists(st.floats(-2, 2), min_size=8, max_size=8))
def test_the_variance_is_that_of_a_linear_function(rib, garter, slopes):
    found = first_order(cube(slopes), pair(rib, garter)).isel(n_stripe=0, n_subunit=0)
    covariance = np.zeros((8, 8))
    covariance[:4, :4], covariance[4:, 4:] = rib, garter
    variance = slopes @ covariance @ slopes
    at = found.sel(applied_strain=0.1)
    assert at["poisson_ratio_sd"].item() ** 2 == pytest.approx(variance, rel=1e-9, abs=1e-14)
    assert at["reaction_force_sd"].item() == pytest.approx(2 * at["poisson_ratio_sd"].item())
    assert found["poisson_ratio_min_sd"].item() == pytest.approx(2 * at["poisson_ratio_sd"].item())
    if variance > 1e-10:
        np.testing.assert_allclose(at["poisson_ratio_share"].sum(), 1, rtol=1e-6)
        explained = at["poisson_ratio_explained"].values
        assert (explained <= 1 + 1e-9).all()
        # What is left of the variance when one number is known is that of the normal
        # distribution under this condition.
        number = int(np.argmax(np.diag(covariance)))
        known = covariance[number]
        left = covariance - np.outer(known, known) / covariance[number, number]
        assert explained[number] == pytest.approx(1 - slopes @ left @ slopes / variance, abs=1e-6)


def test_units_and_designs_without_a_result():
    found = first_order(cube(np.ones(8)), pair(np.eye(4), np.eye(4)))
    assert found["reaction_force_sd"].attrs["units"] == "N"
    assert found["poisson_ratio_sd"].attrs["units"] == "1"
    failed = found.isel(n_stripe=0, n_subunit=1)
    assert np.isnan(failed["poisson_ratio_min_sd"])
    assert failed["poisson_ratio_min_leading"].item() == ""
    assert np.isnan(found["poisson_ratio_sd"].isel(applied_strain=0)).all()


def test_the_covariance_of_an_angle_is_in_radians():
    # ν changes by 0.3 for a relative change of θ0 of the rib, whose error is 0.04 rad of 0.8 rad.
    rib = np.diag([0.0, 0.0, 0.04**2, 0.0])
    slopes = np.zeros(8)
    slopes[PARAMETERS.index("rib_theta_0")] = 0.3
    found = kl.uncertainty(cube(slopes), material=material(rib, np.zeros((4, 4))))
    at = found.isel(n_stripe=0, n_subunit=0).sel(applied_strain=0.1)
    assert at["poisson_ratio_sd"].item() == pytest.approx(0.3 * 0.04 / 0.8)
    assert at["poisson_ratio_leading"].item() == "rib_theta_0"


@pytest.mark.parametrize(
    ("given", "problem"),
    [
        (None, "rib 4: .*calibrate"),
        ({}, "rows"),
        ({"k_s": {"k_s": -1.0}}, "semidefinite.* -1"),
        ({"k_s": {"k_s": 1.0, "k_t": 2.0}, "k_t": {"k_s": 2.0, "k_t": 1.0}}, "semidefinite"),
        ({"k_s": {"k_s": 1.0, "k_t": 0.5}, "k_t": {"k_s": 0.0, "k_t": 1.0}}, "symmetric"),
        ({"k_s": {"k_s": 1.0}, "k_t": {"k_t": 1.0}}, "rows.* k_s, k_t"),
        ({"stretch": {"stretch": 1.0}}, "'stretch'; give .*k_s"),
        ({"k_s": {"k_s": 1e300}}, r"1e\+300, above 10"),
        ({"k_s": {"k_s": float("nan")}}, "numbers"),
    ],
)
def test_a_covariance_that_is_none_is_refused(given, problem):
    covariances = {**material().covariances, ("rib", 4): given}
    known = {stripe: table for stripe, table in covariances.items() if table is not None}
    with pytest.raises(InputError, match=problem):
        kl.uncertainty(cube(np.ones(8)), material=kl.Material((RIB, GARTER), covariances=known))


def test_what_has_no_uncertainty_is_refused():
    with pytest.raises(InputError, match="sensitivities = true"):
        kl.uncertainty(
            cube(np.ones(8)).drop_vars(["poisson_ratio_sensitivity", "reaction_force_sensitivity"]),
            material=material(),
        )
    other = cube(np.ones(8))
    other["rib_k_s"] = other["rib_k_s"] * 1.01
    with pytest.raises(InputError, match=r"rib_k_s of n_stripe 4: .*2\.02 .*2 "):
        kl.uncertainty(other, material=material())
    with pytest.raises(InputError, match=r"rib 4.*calibrate"):
        kl.uncertainty(cube(np.ones(8)), material=kl.Material((GARTER,)))
    with pytest.raises(InputError, match="cubes: "):
        kl.uncertainty(material=material())
    with pytest.raises(InputError, match="material: "):
        kl.uncertainty(cube(np.ones(8)))


def test_designs_are_ranked_by_the_normal_probability_of_the_target():
    # ν does not depend on the angles.
    slopes = np.where([name.endswith("theta_0") for name in PARAMETERS], 0, 1.0)
    deviation = np.sqrt(3e-4 + 12e-4)
    found = kl.find(
        cube(slopes), targets="poisson_ratio = -0.32 ± 0.03 @ 0.1", material=material()
    ).table
    wanted = norm.cdf((0.05) / deviation) - norm.cdf((-0.01) / deviation)
    assert found["probability"].tolist() == [pytest.approx(wanted, abs=0.005)]
    # The lowest ratio has twice the deviation, and the two targets depend on the same numbers.
    both = ["poisson_ratio < -0.32 @ 0.1", "poisson_ratio_min < -0.64"]
    joint = kl.find(cube(slopes), targets=both, material=material()).table["probability"].item()
    assert joint == pytest.approx(norm.cdf(-0.02 / deviation), abs=0.005)
    reduced = kl.find(
        cube(slopes), targets="mean(poisson_ratio) < -0.45 @ 0.1:0.2", material=material()
    )
    assert reduced.table["probability"].item() == pytest.approx(0.5, abs=0.005)
    # What must be met counts with its probability, and what has no sensitivity as exact.
    only = {"subject_to": ["reaction_force > 0.2 @ 0.1", "n_stripe < 5"], "material": material()}
    assert kl.find(cube(slopes), targets="poisson_ratio < 0 @ 0.1", **only).table[
        "probability"
    ].item() == pytest.approx(0.5, abs=0.005)
    with pytest.raises(InputError, match="tolerance"):
        kl.find(cube(slopes), targets="poisson_ratio = -0.32 @ 0.1", material=material())


def repeated(repeats, garter_repeats=None):
    """A material whose covariances are those of repeats."""
    counts = {("rib", 4): repeats, ("garter", 8): garter_repeats or repeats}
    tables = material().covariances
    return kl.Material(
        (RIB, GARTER),
        covariances={
            key: kl.StripeCovariance(tables[key], count - 1, count) for key, count in counts.items()
        },
    )


def test_a_new_swatch_is_less_certain_than_the_mean_by_students_t():
    # Only the rib counts, so that the interval is exact.
    slopes = np.where([name in ("rib_k_s", "rib_k_t") for name in PARAMETERS], 1.0, 0)
    asked = cube(slopes)
    found = {
        subject: kl.uncertainty(asked, material=repeated(5), uncertainty_of=subject)
        for subject in (None, "swatch", "mean")
    }
    at = {"n_stripe": 4, "n_subunit": 16, "applied_strain": 0.1}
    mean, swatch = (found[subject].sel(at) for subject in ("mean", "swatch"))
    assert mean["poisson_ratio_sd"].item() == pytest.approx(np.sqrt(2e-4))
    assert swatch["poisson_ratio_sd"].item() == pytest.approx(np.sqrt(6 * 2e-4))
    for each in (mean, swatch):
        wanted = student_t.ppf(0.975, 4) * each["poisson_ratio_sd"].item()
        assert each["poisson_ratio_halfwidth"].item() == pytest.approx(wanted)
        assert each["poisson_ratio_degrees_of_freedom"].item() == pytest.approx(4)
    assert found[None].attrs == found["swatch"].attrs
    assert found[None].attrs["uncertainty_of"] == "swatch"
    assert "new swatch" in found[None].attrs["comment"]
    assert "mean stripe" in found["mean"].attrs["comment"]


def test_what_is_known_of_one_curve_is_said_and_no_new_swatch():
    asked, one = cube(np.ones(8)), material()
    found = kl.uncertainty(asked, material=one)
    assert found.attrs["uncertainty_of"] == "mean"
    assert all(word in found.attrs["comment"] for word in ("mean", "not known", "rib 4", "garter"))
    nearest = kl.find(asked, targets="poisson_ratio < -0.3 @ 0.1", material=one)
    assert nearest.uncertainty == found.attrs["comment"]
    with pytest.raises(InputError, match=r"rib 4: .*new swatch.*calibrate repeats"):
        kl.uncertainty(asked, material=one, uncertainty_of="swatch")
    with pytest.raises(InputError, match=r"uncertainty_of mena: .*mean"):
        kl.uncertainty(asked, material=one, uncertainty_of="mena")
    with pytest.raises(InputError, match=r"uncertainty_of mean: .*material"):
        kl.find(asked, targets="poisson_ratio < -0.3 @ 0.1", uncertainty_of="mean")


@pytest.mark.parametrize("repeats", [(2, 2), (3, 10), (5, 5)])
def test_a_probability_agrees_with_the_interval(repeats):
    asked, known = cube(np.ones(8)), repeated(*repeats)
    half = kl.uncertainty(asked, material=known).sel(n_stripe=4, n_subunit=16, applied_strain=0.1)
    target = f"poisson_ratio = -0.3 ± {half['poisson_ratio_halfwidth'].item()} @ 0.1"
    found = kl.find(asked, targets=target, material=known)
    assert found.table["probability"].item() == pytest.approx(0.95, abs=0.005)


@pytest.mark.parametrize("wrong", [{"degrees_of_freedom": 0.0}, {"repeats": 1}])
def test_degrees_of_freedom_and_repeats_are_checked(wrong):
    (name,) = wrong
    with pytest.raises(InputError, match=f"{name}: is .*give"):
        kl.StripeCovariance({"k_s": {"k_s": 1.0}}, **wrong)


def sampled(deviates, ratio):
    """A cube of samples: ν is a function of rib_k_s and garter_k_t."""
    count = len(deviates)
    dims = (*DIMS, "sample")
    numbers = np.exp(0.1 * deviates)
    values = ratio(deviates)
    curves = np.stack([np.full(count, np.nan), values, 2 * values], axis=-1)
    variables = {
        "status": (dims, np.full((1, 1, count), Status.ok, np.int8)),
        "case_id": (dims, np.full((1, 1, count), "a", object)),
        "rib_k_s": (dims, numbers[:, 0][None, None]),
        "rib_k_t": (dims, np.ones((1, 1, count))),
        "garter_k_t": (dims, numbers[:, 1][None, None]),
        "poisson_ratio": ((*dims, "applied_strain"), curves[None, None]),
    }
    coordinates = {"n_stripe": [4], "n_subunit": [16], "applied_strain": STRAINS}
    return described(xr.Dataset(variables, coordinates))


def test_samples_have_the_deviation_and_the_sobol_indices_of_a_known_function():
    made = sampled(saltelli(1024, 2, 0), lambda z: 3 * z[:, 0] + z[:, 1] + z[:, 0] * z[:, 1])
    assert saltelli_design(made) == (["rib_k_s", "garter_k_t"], 1024)
    found = sampled_uncertainty(made).isel(n_stripe=0, n_subunit=0).sel(applied_strain=0.1)
    # The variances of 3a, b and ab are 9, 1 and 1.
    assert found["poisson_ratio_sd"].item() == pytest.approx(np.sqrt(11), rel=0.05)
    np.testing.assert_allclose(found["poisson_ratio_first_order"], [9 / 11, 1 / 11], atol=0.05)
    np.testing.assert_allclose(found["poisson_ratio_total"], [10 / 11, 2 / 11], atol=0.05)
    assert found["samples"].item() == 2048


def test_a_latin_hypercube_has_deviations_and_no_indices():
    made = sampled(student_hypercube(64, (2,), (np.inf,), 0), lambda z: 3 * z[:, 0] + z[:, 1])
    made["status"][0, 0, 0] = Status.failed
    assert saltelli_design(made) is None
    found = sampled_uncertainty(made).isel(n_stripe=0, n_subunit=0).sel(applied_strain=0.1)
    assert found["poisson_ratio_sd"].item() == pytest.approx(np.sqrt(10), rel=0.05)
    assert found["samples"].item() == 63
    assert "poisson_ratio_first_order" not in found


@pytest.mark.slow
@pytest.mark.nightly
def test_candidates_of_a_design_are_ranked_by_probability(tmp_path):
    target = "poisson_ratio < -0.35 @ 0.03:0.06"
    path = shipped("workflows").parent / "docs" / "examples" / "swatches" / "acrylic.toml"
    settings = {"material": path, "sensitivities": True, "strain_max": 0.06}
    vary = {"n_stripe": [4], "n_subunit": [16, 24]}
    designed = kl.design(targets=target, vary=vary, robustness=0, results=tmp_path, **settings)
    found = kl.find(designed.cube, targets=target, material=path).table
    assert found["n_subunit"].tolist() == [24, 16]
    assert 1 > found["probability"][0] > found["probability"][1] > 0
