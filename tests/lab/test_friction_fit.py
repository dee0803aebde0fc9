"""Friction fitted to cycles of a stripe: a scalar test in small steps, and numbers found again."""

import math
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

import knitlab as kl
from knitlab.lab.friction_fit import FITTED, fit_friction, sheet_forces
from knitlab.lab.tension_record import LoadingCycles, Passage
from knitlab.model.pure_stripe import PureStripe, tension_across
from tests.refusals import refused
from tests.solvers.equilibrium.test_friction import Hinge

PERIOD = 1.41
NUMBERS = np.array([0.817, 0.0107, 0.772, 0.15, 0.03])
STRAIN = np.linspace(0.0, 2.2, 30)
THERE, BACK = Passage(STRAIN, STRAIN, loading=True), Passage(STRAIN[::-1], STRAIN, loading=False)


def test_without_friction_the_sheet_is_that_of_three_unknowns():
    (force,) = sheet_forces(PERIOD, NUMBERS * [1, 1, 1, 0, 0], [THERE])
    k_s, k_t, theta_0 = NUMBERS[:3]
    stripe = kl.Stripe("rib", 4, PERIOD, k_s=k_s, theta_0=theta_0, k_t=k_t)
    expected = tension_across(PureStripe.of(stripe), jnp.asarray(STRAIN))
    np.testing.assert_allclose(force, expected, atol=1e-12)


def test_cycles_are_those_of_a_fold_that_turns_in_small_steps():
    """Independent: the fold is driven by its angle, and its force and strain follow."""
    k_s, k_t, rest, friction, _ = NUMBERS.tolist()
    cell, hinge = PERIOD / 4 / math.sin(rest / 2), Hinge(kl.Friction(friction), k_t)

    def pull_of(spring):
        """Force of a cell across the ridges at a length, with its height in balance."""

        def along(height):
            return (
                height - cell + 2 * height * (1 - math.sqrt(2) * cell / math.hypot(spring, height))
            )

        height = brentq(along, 0.2 * cell, 2 * cell, xtol=1e-15)
        inclined = 1 - math.sqrt(2) * cell / math.hypot(spring, height)
        return k_s * (spring - cell + 2 * spring * inclined)

    def state(angle, moment):
        """Strain and force of a fold at an angle that its spring and its hinge pull."""

        def imbalance(spring):
            return pull_of(spring) * spring / math.tan(angle / 2) - k_t * (angle - rest) - moment

        spring = brentq(imbalance, 0.5 * cell, 10 * cell, xtol=1e-15)
        return 4 * spring * math.sin(angle / 2) / PERIOD - 1, pull_of(spring) / math.sin(angle / 2)

    drift_free = NUMBERS * [1, 1, 1, 1, 0]
    for passage, angles in zip([THERE, BACK], [(rest, 2.9), (2.9, rest)], strict=True):
        curve = []
        for angle in np.linspace(*angles, 400):
            hinge.turn(angle - rest)
            curve.append(state(angle, hinge.moment))
        strain, force = np.array(curve).T
        even = np.linspace(0, float(strain.max()), 40)
        loaded = Passage(even, even, loading=True)
        at = strain[force > 0]
        history = [loaded] if passage is THERE else [loaded, Passage(at, at, loading=False)]
        last = [*sheet_forces(PERIOD, drift_free, history)][-1]
        if passage is THERE:
            np.testing.assert_allclose(last, np.interp(loaded.strain, strain, force), atol=2e-5)
        else:
            np.testing.assert_allclose(last, force[force > 0], atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("passages", "within"),
    [
        pytest.param([THERE, BACK, THERE, BACK], 0.1, id="cycles"),
        pytest.param([THERE] * 3, 0.2, id="loading alone", marks=pytest.mark.nightly),
    ],
)
def test_numbers_are_found_again(passages, within):
    noise = np.random.default_rng(5)
    made = [
        replace(each, force=force + 2e-4 * noise.normal(size=len(force)))
        for each, force in zip(passages, sheet_forces(PERIOD, NUMBERS, passages), strict=True)
    ]
    fit = fit_friction(PERIOD, LoadingCycles(tuple(made)))
    assert fit.comparison.wanted
    for name, true in zip(FITTED, NUMBERS, strict=True):
        assert fit.values[name] == pytest.approx(true, rel=within)
        assert abs(fit.values[name] - true) < 4 * fit.standard_errors[name]


@pytest.mark.slow
@pytest.mark.nightly
def test_repeats_that_only_scatter_have_no_drift():
    """Repeats that differ as wholes by 4 %: errors of independent points would often deny it."""
    noise = np.random.default_rng(1)
    (force,) = sheet_forces(PERIOD, NUMBERS * [1, 1, 1, 0, 0], [THERE])
    for _ in range(4):
        scattered = [force * (1 + 0.04 * noise.normal()) for _ in range(5)]
        repeats = [
            replace(THERE, force=each + 2e-4 * noise.normal(size=len(each))) for each in scattered
        ]
        fit = fit_friction(PERIOD, LoadingCycles(tuple(repeats)))
        assert fit.values["fold_drift"] < 3 * fit.standard_errors["fold_drift"]
        assert not fit.comparison.wanted


def test_cycles_are_of_one_swatch_and_friction_at_a_late_start_is_no_offset(tmp_path):
    passages = [THERE, BACK, THERE]
    forces = [*sheet_forces(PERIOD, NUMBERS, passages)]
    strain = np.concatenate([each.strain for each in passages])
    rows = zip(strain, np.concatenate(forces), strict=True)
    path = tmp_path / "cycles.csv"
    lines = [f"{one},{other}" for one, other in rows if one > 0.1]
    path.write_text("\n".join(["strain [1],force [N]", *lines]))
    with refused("give zero = none"):
        kl.read_cycles(path)
    plain = kl.read_cycles(path, zero="none")
    assert [each.loading for each in plain.passages] == [True, False, True]
    numbered = (f"{number > 40},{line}" for number, line in enumerate(lines))
    path.write_text("\n".join(["specimen,strain [1],force [N]", *numbered]))
    with refused("specimen", "several swatches"):
        kl.read_cycles(path)


def test_friction_from_zero_strain_on_is_no_offset(tmp_path):
    strain = np.linspace(0.0, 2.2, 300)
    (force,) = sheet_forces(PERIOD, NUMBERS, [Passage(strain, strain, loading=True)])
    path = tmp_path / "loading.csv"
    rows = [f"{one},{other}" for one, other in zip(strain, force, strict=True)]
    path.write_text("\n".join(["strain [1],force [N]", *rows]))
    assert kl.read_cycles(path).summary == ()


def test_one_loading_tells_nothing_of_friction():
    cycles = LoadingCycles((replace(THERE, force=STRAIN),))
    with refused("cycles", "give unloading"):
        kl.calibrate_friction(cycles, period=1.0)
