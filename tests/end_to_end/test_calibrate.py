"""From a measured curve to a stripe that a workflow uses."""

import json
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from click.testing import CliRunner

from knitlab.cli import main
from knitlab.fabric.zigzag import zigzag
from knitlab.sweep.material import add_stripe
from tests.fabrics import compiled_tension, stripe


@pytest.fixture(autouse=True)
def in_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def knitlab(*words):
    return CliRunner().invoke(main, words)


@pytest.mark.slow
def test_a_calibrated_stripe_can_be_used_as_it_is():
    strain = np.linspace(0, 2, 30)
    force = 1.2 * np.asarray(compiled_tension(zigzag(stripe("rib", 4)), jnp.asarray(strain)))
    rows = [f"{100 * a},{1000 * b}" for a, b in zip(strain, force, strict=True)]
    Path("curve.csv").write_text("\n".join(["strain [%],force [mN]", *rows]))
    done = knitlab("calibrate", "curve.csv", "--stripe", "rib", "-n", "4", "--period", "1.41")
    assert done.exit_code == 0, done.output
    for part in ("k_s", "k_t", "theta_0", "correlation", "misfit"):
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


def test_a_bad_curve_ends_with_code_2_and_writes_nothing():
    Path("curve.csv").write_text("strain,force [N]\n0,0\n")
    done = knitlab("calibrate", "curve.csv", "--stripe", "rib", "-n", "4", "--period", "1.41")
    assert done.exit_code == 2
    assert "has no unit" in done.output
    assert [path.name for path in Path().iterdir()] == ["curve.csv"]
