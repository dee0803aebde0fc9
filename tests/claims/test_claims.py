"""Claims on artificial cubes: one on which every claim holds, and one for each that fails."""

import numpy as np
import pytest
import xarray as xr

from knitlab.claims.claims import read_claims
from knitlab.claims.judgement import judged
from knitlab.claims.margin import Grade
from knitlab.cubes.cube_file import write_cube
from knitlab.lab.fit_statistics import common_slope_probability, linear_fit
from knitlab.observables.schema import described
from knitlab.observables.status import Status
from tests.refusals import refused

FAMILIES = {
    2: (0.05, 0.05, 0.05, 0.05, 0.05),
    4: (-0.7, -0.45, -0.35, -0.2, 0.02),
    6: (-0.6, -0.5, -0.4, -0.3, -0.2),
    8: (-0.65, -0.55, -0.45, -0.35, -0.25),
}
LOWEST = {
    (n, 2 * n * (place + (4 if n == 2 else 2))): ratio
    for n, ratios in FAMILIES.items()
    for place, ratio in enumerate(ratios)
}
SLOPES = {2: 0.5, 4: 0.75, 6: 0.74, 8: 0.76}
STRAINS = np.round(np.arange(46) * 0.01, 12)
ROWS, COLUMNS = 6, 3


def falling(begins, ends):
    """A capacitance that falls evenly between two strains."""
    return np.interp(STRAINS, [begins, ends], [3.0, 2.0])


def empty_cube(labels, strains, scalars, curves):
    """A cube whose designs are all excluded."""
    dims, grid = tuple(labels), tuple(map(len, labels.values()))
    along = np.full((*grid, len(strains)), np.nan)
    variables = {name: (dims, np.full(grid, np.nan)) for name in scalars}
    variables |= {name: ((*dims, "applied_strain"), along.copy()) for name in curves}
    variables["status"] = dims, np.full(grid, Status.excluded, np.int8)
    variables["case_id"] = dims, np.full(grid, "", dtype=object)
    return xr.Dataset(variables, labels | {"applied_strain": strains})


def good_checkerboards() -> xr.Dataset:
    """Twenty designs that meet all claims."""
    stripes, subunits = (sorted({design[k] for design in LOWEST}) for k in (0, 1))
    scalars = ("knit_wavelength_x", "knit_wavelength_y", "wave_amplitude_x", "wave_amplitude_y")
    scalars += ("rib_width_centre", "rib_width_edge", "garter_height_centre", "garter_height_edge")
    scalars += ("poisson_ratio_min", "applied_strain_at_min", "kinetic_energy_left")
    scalars += ("sensitivity", "working_range", "gauge_factor")
    curves = ("mean_strain_xx", "mean_strain_yy", "poisson_ratio", "capacitance")
    cube = empty_cube({"n_stripe": stripes, "n_subunit": subunits}, STRAINS, scalars, curves)
    cells = xr.DataArray(np.full((ROWS, COLUMNS), np.nan), dims=("cell_y", "cell_x"))
    cube["strain_xx"] = cube["mean_strain_xx"] + cells
    profile = np.array([0.2, 0.6, 1.0, 1.0, 0.6, 0.2])[:, None] * np.ones(COLUMNS)
    for (n, m), lowest in LOWEST.items():
        place = sum(other[0] == n and other[1] < m for other in LOWEST)
        bump = np.exp(-(((STRAINS - 0.17 + 0.015 * place) / 0.08) ** 2))
        ratio = np.full(46, lowest) if n == 2 else lowest * bump
        at = {"n_stripe": n, "n_subunit": m}
        transverse = -ratio * STRAINS
        ratio[0] = np.nan
        values = {
            "knit_wavelength_x": SLOPES[n] * m + 1,
            "knit_wavelength_y": SLOPES[n] * m + 2,
            "wave_amplitude_x": 0.02 * m,
            "wave_amplitude_y": 0.03 * m,
            "rib_width_centre": 4.0,
            "rib_width_edge": 5.0,
            "garter_height_centre": 4.0,
            "garter_height_edge": 5.0,
            "kinetic_energy_left": 1e-6,
            "poisson_ratio_min": np.nanmin(ratio),
            "applied_strain_at_min": STRAINS[np.nanargmin(ratio)],
            "mean_strain_xx": transverse,
            "mean_strain_yy": STRAINS,
            "poisson_ratio": ratio,
            "strain_xx": transverse[:, None, None] * profile,
            "sensitivity": 2 + 0.01 * m,
            "working_range": 0.5 - 0.003 * m,
            "capacitance": falling(0.075, 0.325),
            "gauge_factor": -2.0,
            "status": np.int8(Status.ok),
            "case_id": f"{n}-{m}",
        }
        for name, value in values.items():
            cube[name].loc[at] = value
    return described(cube)


def good_stripes() -> xr.Dataset:
    """Nine stripes whose tension curves meet all claims."""
    sizes = {"rib": (2, 4, 6, 8), "garter": (4, 6, 8, 12, 16)}
    numbers = sorted({n for line in sizes.values() for n in line})
    strains = np.arange(41) * 0.05
    labels = {"knit": ["rib", "garter"], "n": numbers, "boundary": ["periodic"]}
    scalars, curves = ("sensitivity", "working_range"), ("row_force", "zigzag_force")
    cube = empty_cube(labels, strains, scalars, curves)
    for knit, line in sizes.items():
        for place, n in enumerate(line):
            soft, stiff = 0.4 / 4**place, 1.0
            force = soft * strains + (stiff - soft) * np.maximum(strains - (0.5 + 0.3 * place), 0)
            at = {"knit": knit, "n": n, "boundary": "periodic"}
            for name, value in {
                "row_force": force,
                "zigzag_force": 1.01 * force,
                "sensitivity": 0.2 if knit == "rib" else 0.4,
                "working_range": 1.5,
                "status": np.int8(Status.ok),
                "case_id": f"{knit}-{n}",
            }.items():
                cube[name].loc[at] = value
    return described(cube)


@pytest.fixture
def verdicts(tmp_path):
    def judge(checkerboards, stripes, *names):
        claims = [claim for claim in read_claims() if not names or claim.name in names]
        paths = []
        for name, cube in {"checkerboards": checkerboards, "stripes": stripes}.items():
            paths.append(tmp_path / name / "cube.nc")
            paths[-1].parent.mkdir(exist_ok=True)
            write_cube(cube, paths[-1])
        return {each.claim.name: each.result.verdict for each in judged(claims, paths)}

    return judge


LABORATORY = [each.name for each in read_claims() if each.test == "laboratory"]


@pytest.mark.slow
def test_every_claim_holds_on_a_cube_made_to_meet_it(verdicts):
    found = verdicts(good_checkerboards(), good_stripes())
    others = {name: verdict for name, verdict in found.items() if verdict != Grade.holds}
    assert others == dict.fromkeys(LABORATORY, Grade.not_measured)


def put(name, value, n=4, m=16, **at):
    def spoil(boards, stripes):
        boards[name].loc[{"n_stripe": n, "n_subunit": m, **at}] = value

    return spoil


def scaled(name, factor, n=None):
    def spoil(boards, stripes):
        boards[name].loc[{} if n is None else {"n_stripe": n}] *= factor

    return spoil


def force(values, knit="rib", n=4, name="row_force"):
    def spoil(boards, stripes):
        stripes[name].loc[{"knit": knit, "n": n}] = values

    return spoil


def same(name, value):
    def spoil(boards, stripes):
        boards[name] = boards[name].where(boards[name].isnull(), value)

    return spoil


LINE = np.arange(41) * 0.05
KNEE = 0.01 * LINE + np.maximum(LINE - 0.1, 0)
SPOILT = {
    "stripes_are_j_shaped": force(LINE),
    "narrowest_stripes_show_no_j": force(0.1 * LINE + np.maximum(LINE - 0.5, 0), n=2),
    "narrow_stripes_are_stiffer_at_first": force(0.5 * LINE, n=8),
    "narrow_stripes_stiffen_earlier": force(KNEE, n=8),
    "sheet_is_zigzag": force(1.5 * LINE, name="zigzag_force"),
    "kinetic_energy_vanishes": put("kinetic_energy_left", 0.01, m=32),
    "rib_centre_contracts_more": put("rib_width_centre", 5.1, n=8, m=96),
    "garter_centre_contracts_more": put("garter_height_centre", 5.1, n=2),
    "amplitude_along_weft_varies": same("wave_amplitude_x", 1.0),
    "amplitude_along_warp_varies": same("wave_amplitude_y", 1.0),
    "wavelength_along_weft_is_linear": put("knit_wavelength_x", 40.0, m=32),
    "wavelength_along_warp_is_linear": put("knit_wavelength_y", 40.0, m=32),
    "slopes_along_weft_are_common": scaled("knit_wavelength_x", 1.2, n=8),
    "slopes_along_warp_are_common": scaled("knit_wavelength_y", 1.2, n=8),
    "narrowest_departs_most_along_weft": scaled("knit_wavelength_x", 1.5, n=2),
    "narrowest_departs_most_along_warp": scaled("knit_wavelength_y", 1.5, n=2),
    "centre_widens_most": put("strain_xx", 0.5, n=8, m=48, applied_strain=0.23, cell_y=0),
    "transverse_strain_peaks": put("mean_strain_xx", STRAINS, m=32),
    "axial_strain_follows": put("mean_strain_yy", 1.2 * STRAINS, m=32),
    "lowest_ratio_between_10_and_20_percent": put("applied_strain_at_min", 0.21, m=32),
    "three_samples_are_auxetic": put("poisson_ratio_min", 0.0, m=32),
    "wide_stripes_reach_minus_02_to_minus_07": put("poisson_ratio_min", -0.8, n=6, m=24),
    "narrowest_is_slightly_positive": put("poisson_ratio", -0.01, n=2, applied_strain=0.2),
    "longer_cells_widen_less": put("mean_strain_xx", STRAINS, n=8, m=96),
    "longer_cells_are_less_auxetic": put("poisson_ratio_min", -0.5, n=8, m=96),
    "n_stripe_4_is_auxetic_up_to_40": put("poisson_ratio_min", 0.01, m=40),
    "n_stripe_4_n_subunit_48_is_not": put("poisson_ratio_min", -0.01, m=48),
    "wider_stripes_are_more_auxetic": put("poisson_ratio_min", -0.3, n=8, m=48),
    "design_4_16_is_the_lowest": put("poisson_ratio_min", -0.71, n=8, m=32),
    "strain_of_the_lowest_ratio_varies": same("applied_strain_at_min", 0.15),
    "rib_capacitor_is_the_least_sensitive": force(2.2, name="sensitivity"),
    "capacitor_4_32_is_the_steepest": put("sensitivity", 2.1, m=32),
    "auxetic_capacitors_are_narrower": put("working_range", 1.5, m=32),
    "capacitor_4_32_begins_at_a_tenth": put("capacitance", falling(0.2, 0.325), m=32),
    "capacitor_4_32_is_unfolded_at_three_tenths": put("capacitance", falling(0.075, 0.2), m=32),
    "capacitance_falls_with_strain": put("gauge_factor", 0.1, m=32),
    "steeper_capacitors_are_narrower": scaled("working_range", -1),
}


def test_each_measurable_claim_has_a_cube_that_breaks_it():
    assert set(SPOILT) == {claim.name for claim in read_claims()} - set(LABORATORY)


@pytest.mark.slow
@pytest.mark.parametrize("name", SPOILT)
def test_a_claim_fails_on_a_cube_made_to_break_it(verdicts, name):
    boards, stripes = good_checkerboards(), good_stripes()
    boards = boards.assign_coords(cell_y=np.arange(ROWS), cell_x=np.arange(COLUMNS))
    SPOILT[name](boards, stripes)
    assert verdicts(boards, stripes, name)[name] is Grade.fails


@pytest.mark.slow
@pytest.mark.parametrize("status", [Status.pending, Status.not_converged, Status.failed])
def test_a_claim_is_not_measured_if_its_one_design_has_no_results(verdicts, status):
    boards = good_checkerboards()
    boards["status"].loc[{"n_stripe": 4, "n_subunit": 48}] = status
    found = verdicts(boards, good_stripes())
    assert found["n_stripe_4_n_subunit_48_is_not"] is Grade.not_measured
    assert found["longer_cells_are_less_auxetic"] is Grade.holds
    assert found["transverse_strain_peaks"] is Grade.holds


@pytest.mark.slow
def test_a_claim_that_fails_for_one_design_fails_though_others_are_missing(verdicts):
    boards = good_checkerboards()
    boards["status"].loc[{"n_stripe": 8}] = Status.pending
    boards["poisson_ratio_min"].loc[{"n_stripe": 6, "n_subunit": 24}] = -0.9
    found = verdicts(boards, good_stripes())
    assert found["wide_stripes_reach_minus_02_to_minus_07"] is Grade.fails


def test_a_line_is_fitted_with_its_confidence_interval():
    """Against the textbook: s² = SSR / (n − 2), halfwidth t · s / √Sxx."""
    x = np.array([16.0, 24, 32, 40, 48])
    y = 0.75 * x + np.array([0.1, -0.2, 0.05, 0.1, -0.05])
    fit = linear_fit(x, y)
    slope, intercept = np.polyfit(x, y, 1)
    scatter = np.sqrt(((y - slope * x - intercept) ** 2).sum() / 3)
    assert fit.slope == pytest.approx(slope)
    halfwidth = 3.18245 * scatter / np.sqrt(((x - x.mean()) ** 2).sum())
    assert fit.slope_halfwidth == pytest.approx(halfwidth, rel=1e-5)


def test_slopes_of_one_line_and_of_several_are_distinguished():
    random = np.random.default_rng(0)
    x = np.arange(8.0)

    def probability(*slopes):
        return common_slope_probability(
            [linear_fit(x, slope * x + 0.3 * random.normal(size=8)) for slope in slopes]
        )

    same_slopes = [probability(1, 1, 1) for _ in range(200)]
    assert np.mean(np.array(same_slopes) < 0.1) == pytest.approx(0.1, abs=0.06)
    assert probability(1, 1, 2) < 1e-3


def test_a_selection_that_would_change_nothing_is_refused(tmp_path):
    write_cube(good_checkerboards(), tmp_path / "cube.nc")
    with refused("n_stripe=4", "swept"):
        judged(read_claims(), [tmp_path], {"n_stripe": 4})
