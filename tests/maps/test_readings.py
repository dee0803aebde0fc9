import itertools
from pathlib import Path

import xarray as xr

from knitlab.maps.figures import draw_figure, draw_figures
from knitlab.maps.margin import Verdict
from knitlab.maps.readings import verdicts_of
from knitlab.sweep.cube_file import open_cube, swept_dims, write_cube
from tests.maps.test_claims import good_checkerboards

REFERENCE = Path(__file__).parents[2] / "results" / "reference" / "readings"


def two_readings(folder):
    """A cube along fold_phase: as the paper says, and the same but for a (4, 16) that shrinks."""
    good, bad = good_checkerboards(), good_checkerboards()
    bad["poisson_ratio_min"].loc[{"n_stripe": 4, "n_subunit": 16}] = 0.1
    cube = xr.concat([bad, good], dim="fold_phase").assign_coords(
        fold_phase=["stripe_border", "stripe_centre"]
    )
    dims = ("n_stripe", "n_subunit", "fold_phase")
    for name in cube.data_vars:
        cube[name] = cube[name].transpose(*dims, ...)
    write_cube(cube, folder / "cube.nc")
    return folder


def test_verdicts_are_those_of_each_reading(tmp_path):
    cube = open_cube(two_readings(tmp_path))
    readings = {(phase,): cube.sel(fold_phase=phase) for phase in cube["fold_phase"].values}
    claims, verdicts = verdicts_of(readings)
    by_name = {claim.name: list(line) for claim, line in zip(claims, verdicts, strict=True)}
    assert by_name["design_4_16_is_the_lowest"] == [Verdict.fails, Verdict.holds]
    assert by_name["three_samples_are_auxetic"] == [Verdict.fails, Verdict.holds]
    assert by_name["rib_centre_contracts_more"] == [Verdict.holds, Verdict.holds]
    assert "stripes_are_j_shaped" not in by_name


def test_readings_are_drawn_side_by_side_without_a_selection(tmp_path):
    folder = two_readings(tmp_path)
    assert draw_figure("readings", [folder], tmp_path / "readings.svg").stat().st_size > 0
    text = (tmp_path / "readings.svg").read_text()
    assert "30 hold" in text
    assert "24 hold" in text
    files, faults = draw_figures(["readings", "auxetic"], folder)
    assert not faults
    assert {path.stem for path in files} == {
        "readings",
        "auxetic_fold_phase-stripe_border",
        "auxetic_fold_phase-stripe_centre",
    }


def test_the_kept_readings_say_what_the_readme_says(tmp_path):
    cube = open_cube(REFERENCE)
    dims = swept_dims(cube)
    readings = {
        labels: cube.sel(dict(zip(dims, labels, strict=True)))
        for labels in itertools.product(*(cube[dim].values for dim in dims))
    }
    claims, verdicts = verdicts_of(readings)
    assert (len(claims), len(readings)) == (21, 16)
    assert set((verdicts == Verdict.holds).sum(axis=0)) == {8, 10, 11, 12}
    never = {
        claim.name
        for claim, line in zip(claims, verdicts, strict=True)
        if Verdict.holds not in line and Verdict.fails in line
    }
    assert {
        "lowest_ratio_between_10_and_20_percent",
        "transverse_strain_peaks",
        "narrowest_is_slightly_positive",
        "longer_cells_are_less_auxetic",
        "n_stripe_4_n_subunit_48_is_not",
    } <= never
    assert draw_figure("readings", [REFERENCE], tmp_path / "readings.png").is_file()
