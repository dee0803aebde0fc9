"""The page of measured swatches: its measure, its tables, and the stripes of its samples."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

import knitlab as kl
from knitlab.lab.calibration import calibrate
from knitlab.lab.tension_record import read_tension_record
from knitlab.observables.status import Status
from knitlab.runs.material import Material

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "explanation" / "against_measurements.md"
SWATCHES = ROOT / "docs" / "examples" / "swatches"


@pytest.fixture(scope="module")
def script():
    path = ROOT / "docs" / "examples" / "against_measurements.py"
    specification = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def cases(script, tmp_path_factory):
    """The cases of both workflows, run as the page says."""
    results = tmp_path_factory.mktemp("results")
    for workflow in ("swatches_across", "swatches_along"):
        cube = kl.run(workflow, results=results)
        assert (cube.status == Status.ok).all()
        assert (cube.energy_wall == 0).all()
        assert (cube.snapped == 0).all()
    return script.read_cases(sorted(results.iterdir()))


def sheet(rows, columns):
    x, y = np.meshgrid(np.linspace(0, 3, columns), np.linspace(0, 2, rows))
    return np.stack([x, y, np.cos(9 * y)], axis=-1)


@pytest.mark.parametrize("rows", [8, 9])
def test_the_ratio_of_an_affine_stretch_is_that_of_its_strains(script, rows):
    relaxed = sheet(rows, 5)
    stretched = [relaxed * (1 - 0.3 * strain, 1 + strain, 0.5) for strain in (0.1, 1.5)]
    ratio = script.poisson_ratio(np.stack([relaxed, *stretched]))
    np.testing.assert_allclose(ratio, 0.3, rtol=1e-12)


def test_the_width_is_that_at_mid_height_whatever_the_clamps_hold(script):
    relaxed = sheet(9, 5)
    waist = relaxed.copy()
    height = relaxed[..., 1]
    # A parabola between held clamps, narrowest in the middle by a fifth.
    waist[..., 0] = 1.5 + (relaxed[..., 0] - 1.5) * (1 - 0.2 * height * (2 - height))
    waist[..., 1] *= 1.5
    np.testing.assert_allclose(script.width_at_mid_height(waist), 3 * 0.8, rtol=1e-12)
    np.testing.assert_allclose(
        script.poisson_ratio(np.stack([relaxed, waist])), 0.2 / 0.5, rtol=1e-12
    )


@pytest.mark.slow
@pytest.mark.nightly
def test_the_tables_of_the_page_are_those_of_its_runs(script, cases):
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    printed = [line for line in lines if line.startswith("|")]
    assert printed == [line for table in script.tables(cases) for line in table]


@pytest.mark.slow
def test_the_numbers_in_the_text_are_those_of_its_runs(script, cases):
    def of(swatch, sample="10mm"):
        found = script.computed(cases, swatch, sample)
        return found[found.index <= script.measured(swatch).index.max()].to_numpy()

    for swatch in script.NAMES:
        assert of(swatch).min() > 0
        assert of(swatch).max() < 0.02
    # Off over the middle half of the strains, as the text says.
    for swatch, strains, errors in (
        ("rib_across", (0.5, 1.5), (0.07, 0.17)),
        ("garter_across", (0.2, 0.5), (0.09, 0.13)),
    ):
        own = script.measured(swatch)["poisson_ratio [1]"]
        found = script.computed(cases, swatch, "10mm")
        off = [own[strain] - found[strain] for strain in strains]
        assert off == pytest.approx(errors, abs=0.01)
    for knit in ("rib", "garter"):
        positions = script.positions_of(cases[f"{knit}_along_long"])[0]
        aspect = script.width_at_mid_height(positions) / script.clamp_distance(positions)
        assert aspect == pytest.approx(0.11, abs=0.005)


@pytest.mark.slow
def test_forces_are_off_as_the_text_says(script, cases):
    for swatch in script.NAMES:
        case, width = cases[f"{swatch}_10mm"], script.size_of(swatch)["pin_width [mm]"]
        own = script.width_at_mid_height(script.positions_of(case))[0]
        strains = [*script.FORCE_STRAINS]
        found = case.reaction_force.sel(applied_strain=strains, method="nearest").values
        measured = np.array([mean for mean, _ in script.measured_force(swatch)])
        off = np.abs(found * width / own / measured - 1)
        assert off[-1] < 0.07
        if swatch.endswith("along"):
            assert off.max() < 0.05


@pytest.mark.slow
@pytest.mark.nightly
@pytest.mark.parametrize(
    ("knit", "widths", "rows"),
    [
        ("rib", (95.5, 73.6), (("rib", 5), ("garter", 10))),
        ("garter", (113.2, 49.9), (("rib", 3), ("garter", 6))),
    ],
)
def test_the_stripes_are_those_of_the_measured_forces(knit, widths, rows):
    across, along = (
        read_tension_record(SWATCHES / "records" / f"{name}.csv", width=width, zero="none")
        for name, width in zip((knit, f"{knit}_along"), widths, strict=True)
    )
    fitted = calibrate(10.0, across, along=along)
    material = Material.read(ROOT / "workflows" / "swatches" / "acrylic.toml")
    for name, n in rows:
        own = fitted.stripe(name, n, "relaxed")
        (kept,) = (each for each in material.stripes if (each.knit, each.n) == (name, n))
        for quantity in ("period", "k_s", "k_t", "theta_0", "row_width", "stretch_along"):
            assert getattr(kept, quantity) == pytest.approx(getattr(own, quantity), rel=1e-4)
        assert kept.curve_along.force == pytest.approx(own.curve_along.force, rel=1e-4)
