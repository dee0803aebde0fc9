"""From a measured curve to a stripe that a workflow uses."""

import json
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

import knitlab as kl
from knitlab.model.pure_stripe import PureStripe, tension_across
from knitlab.runs.material import add_stripe
from tests.commands import knitlab
from tests.fabrics import stripe

pytestmark = pytest.mark.usefixtures("in_folder")


@pytest.mark.slow
@pytest.mark.nightly
def test_a_calibrated_stripe_can_be_used_as_it_is():
    strain = np.linspace(0, 2, 30)
    force = 1.2 * np.asarray(tension_across(PureStripe.of(stripe("rib", 4)), jnp.asarray(strain)))
    # The load cell reads 50 mN at rest.
    rows = [f"{100 * a},{1000 * b + 50}" for a, b in zip(strain, force, strict=True)]
    Path("curve.csv").write_text("\n".join(["strain [%],force [mN]", *rows]))
    words = "calibrate", "curve.csv", "--stripe", "rib", "-n", "4", "--period", "1.41"
    done = knitlab(*words, "--zero", "0.05")
    assert done.exit_code == 0, done.output
    for part in ("0.05 N (", "is subtracted", "k_s", "k_t", "theta_0", "correlation", "misfit"):
        assert part in done.output
    assert {path.name for path in Path().iterdir()} == {
        "curve.csv",
        "material.toml",
        "material-rib-4.png",
    }
    refused = knitlab("plan", "periodic", "--material", "material.toml", "--set", "n_stripe=4")
    assert refused.exit_code == 2
    assert "n_stripe = 4 has no garter stripe of 8" in refused.output
    add_stripe(Path("material.toml"), stripe("garter", 8), "paper")
    planned = knitlab("plan", "periodic", "--material", "material.toml", "--set", "n_stripe=4")
    assert planned.exit_code == 0, planned.output
    cases = json.loads(Path("results/periodic/plan.json").read_text())["cases"]
    for case in cases.values():
        assert case["weft"]["k_s"] == pytest.approx(1.2 * 0.817, rel=1e-4)
        assert case["weft"]["theta_0"] == pytest.approx(0.772, rel=1e-4)
        assert case["weft"]["period"] == pytest.approx(1.41, rel=1e-4)
        assert case["warp"]["k_s"] == 4.78


def test_an_offset_or_preload_is_refused_until_it_is_said_which():
    rows = [f"{0.1 * k},{0.3 + k}" for k in range(12)]
    Path("curve.csv").write_text("\n".join(["strain [1],force [N]", *rows]))
    words = "calibrate", "curve.csv", "--stripe", "rib", "-n", "4", "--period", "1.41"
    done = knitlab(*words)
    assert done.exit_code == 2
    assert len(done.output.splitlines()) == 1
    for part in ("curve.csv", "0.3 N", "noise of", "--zero start", "--preload 0.3"):
        assert part in done.output
    wrong = knitlab(*words, "--zero", "begin")
    assert wrong.exit_code == 2
    assert "begin" in wrong.output
    assert {path.name for path in Path().iterdir()} == {"curve.csv"}


@pytest.mark.slow
@pytest.mark.nightly
def test_a_stripe_that_its_record_does_not_determine_is_not_written():
    strain = np.linspace(0, 0.3, 12)
    force = np.asarray(tension_across(PureStripe.of(stripe("rib", 4)), jnp.asarray(strain)))
    rows = [f"{a},{b}" for a, b in zip(strain, force, strict=True)]
    Path("curve.csv").write_text("\n".join(["strain [1],force [N]", *rows]))
    result = kl.calibrate_stripe("curve.csv", "rib", 4, period=1.41, output="own.toml")
    assert "k_s" in result.fit.undetermined
    assert "accept = True" in result.refusal
    assert {path.name for path in Path().iterdir()} == {"curve.csv", "own-rib-4.png"}


@pytest.mark.parametrize(
    ("options", "parts"),
    [
        (("--along-width", "50"), ("--along-width 50", "give --along")),
        (("--along-gauge-length", "70"), ("--along-gauge-length 70", "give --along")),
        (("--along", "along.csv"), ("--width", "across.csv", "--along-width")),
        (("--along", "along.csv", "--width", "80"), ("along.csv", "-1 at", "as positive")),
    ],
)
def test_a_record_along_the_ridges_goes_with_widths_and_tension(options, parts):
    for name, sign in (("across", 1), ("along", -160)):
        rows = [f"{0.1 * k},{sign * 0.1 * k}" for k in range(6)]
        Path(f"{name}.csv").write_text("\n".join(["strain [1],force [N]", *rows]))
    words = "calibrate", "across.csv", "--stripe", "rib", "-n", "4", "--period", "10", *options
    done = knitlab(*words)
    assert done.exit_code == 2
    assert len(done.output.splitlines()) == 1
    for part in parts:
        assert part in done.output
    assert {path.name for path in Path().iterdir()} == {"across.csv", "along.csv"}
