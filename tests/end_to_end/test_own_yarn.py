"""The way of a new yarn: records of a known stripe give its numbers, and the fabric made of it."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from click.testing import CliRunner

import knitlab as kl
from knitlab.cli import main
from knitlab.model.pure_stripe import PureStripe, tension_across, tension_along
from knitlab.model.spring_curve import SpringCurve

WIDTH, LENGTH = 90.0, 120.0  # of every swatch [mm]
NOISE, OFFSET, PRELOAD = 0.002, 0.25, 0.3  # over the largest force; [N]; [N]
SCATTER = 0.02  # of the stiffness of specimens
CURVE = SpringCurve((0.0, 0.1, 0.2, 0.35, 0.5), (0.0, 1.0, 2.2, 5.0, 11.0))


def known(knit, n, period, **numbers):
    of = kl.Stripe(knit, n, period, **numbers, stretch_along=0.05, curve_along=CURVE)
    return replace(of, row_width=float(PureStripe.of(of).cell))


RIB = known("rib", 4, 10.0, k_s=2.6, theta_0=0.76, k_t=0.95)
GARTER = known("garter", 8, 7.0, k_s=3.4, theta_0=0.9, k_t=0.8)
across, along = jax.jit(tension_across), jax.jit(tension_along)


def record(path, of, direction, generator, *, largest, offset=0.0, preload=0.0):
    """Three specimens, as a testing machine writes them: extension from where it began."""
    lines = ["Probe;Weg [mm];Standardkraft [N]"]
    for specimen in range(1, 4):
        sheet = PureStripe.of(replace(of, k_t=of.k_t * np.exp(SCATTER * generator.normal())))
        tension, width = (across, sheet.cell) if direction == "across" else (along, None)
        strain = jnp.linspace(0.0, largest, 400)
        if width is None:
            width = sheet.cell * np.sin(of.theta_0 / 2)
        force = np.asarray(tension(sheet, strain)) / float(width) * WIDTH
        begin = float(np.interp(preload, force, strain))
        strain = np.linspace(begin, largest, 120)
        force = np.interp(strain, np.linspace(0.0, largest, 400), force) + offset
        force += NOISE * force.max() * generator.normal(size=len(force))
        # A machine reads some points before it moves.
        rest = preload + offset + NOISE * force.max() * generator.normal(size=5)
        extension = ((1 + strain) / (1 + begin) - 1) * LENGTH
        rows = zip(np.append(np.zeros(5), extension), np.append(rest, force), strict=True)
        lines += [f"{specimen};{x:.4f};{f:.4f}".replace(".", ",") for x, f in rows]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return str(path)


def calibrated(*arguments):
    said = CliRunner().invoke(main, ["calibrate", *arguments], catch_exceptions=False)
    assert said.exit_code == 0, said.output
    return said.output


@pytest.mark.slow
@pytest.mark.nightly
def test_a_known_yarn_comes_back_from_its_records(tmp_path):
    generator, material = np.random.default_rng(3), str(tmp_path / "yarn.toml")
    sizes = "--width", str(WIDTH), "--gauge-length", str(LENGTH)
    # The load cell of the first was not zeroed; the second was gripped under tension.
    for of, strain, given, told in (
        (RIB, 2.1, {"offset": OFFSET}, ("--zero", "start")),
        (GARTER, 1.5, {"preload": PRELOAD}, ("--preload", str(PRELOAD))),
    ):
        name = f"{of.knit}.csv"
        first = record(tmp_path / name, of, "across", generator, largest=strain, **given)
        second = record(tmp_path / f"along_{name}", of, "along", generator, largest=0.45)
        asked = "--stripe", of.knit, "-n", str(of.n), "--period", str(of.period)
        ridges = "--along", second, "-o", material
        output = calibrated(first, *asked, *sizes, *told, *ridges)
        assert "swatch" in output
    read = kl.Material.read(material)
    for of, fitted in zip((RIB, GARTER), read.stripes, strict=True):
        covariance = read.covariances[of.knit, of.n]
        for name in ("k_s", "k_t", "theta_0"):
            error = np.sqrt(covariance[name][name])
            off = getattr(fitted, name), getattr(of, name)
            difference = off[0] - off[1] if name == "theta_0" else np.log(off[0] / off[1])
            # Two degrees of freedom: Student's t of 95 % is 4.3.
            assert abs(difference) < 4.3 * error + 0.01
        assert fitted.row_width == pytest.approx(of.row_width, rel=0.02)
        springs = [each.stretch_along * each.curve_along.spline(0.3) for each in (fitted, of)]
        assert springs[0] == pytest.approx(springs[1], rel=0.05)
    design, strains = kl.Design(4, 8, boundary="periodic"), [0.0, 0.05, 0.1]
    lengths = {"z_max": 30.0, "thickness": 0.5}
    own = kl.simulate(design, strains, material=replace(read, **lengths))
    truth = kl.simulate(design, strains, material=kl.Material((RIB, GARTER), **lengths))
    np.testing.assert_allclose(own.poisson_ratio, truth.poisson_ratio, atol=0.02)
    np.testing.assert_allclose(own.force_per_width[1:], truth.force_per_width[1:], rtol=0.05)
    # The cloth is as large as the network.
    np.testing.assert_allclose(own.knit_cell_x, own.relaxed_cell_x, rtol=0.01)
