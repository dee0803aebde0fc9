"""Model options ranked by claims, on artificial cubes with known verdicts."""

import json
import re

import numpy as np
import pytest
import xarray as xr

from knitlab.claims.claims import read_claims
from knitlab.claims.margin import Grade
from knitlab.claims.option_ranking import differing, ranked_options, ranking_options
from knitlab.cubes.cube_file import open_cube, write_cube
from knitlab.figures.drawing import draw_figure, draw_figures
from tests.claims.test_claims import good_checkerboards, good_stripes
from tests.refusals import refused

DIMS = ("n_stripe", "n_subunit", "fold_phase")


def along_fold_phase(border, centre):
    """A cube along fold_phase, of the cubes at its two values."""
    cube = xr.concat([border, centre], dim="fold_phase").assign_coords(
        fold_phase=["stripe_border", "stripe_centre"]
    )
    for name in cube.data_vars:
        cube[name] = cube[name].transpose(*DIMS, ...)
    return cube


def with_ratio(value, n_stripe=4, n_subunit=16):
    cube = good_checkerboards()
    cube["poisson_ratio_min"].loc[{"n_stripe": n_stripe, "n_subunit": n_subunit}] = value
    return cube


def ranked(*cubes):
    return ranked_options(cubes, read_claims())


@pytest.mark.slow
def test_the_options_under_which_more_claims_hold_come_first():
    best, other = ranked(along_fold_phase(with_ratio(0.1), good_checkerboards()))
    assert best.options["fold_phase"] == "stripe_centre"
    assert best.count(Grade.holds) > other.count(Grade.holds)
    assert best.results["design_4_16_is_the_lowest"].verdict is Grade.holds
    assert other.results["design_4_16_is_the_lowest"].verdict is Grade.fails
    assert best.results["stripes_are_j_shaped"].verdict is Grade.not_measured
    assert differing([best, other]) == ["fold_phase"]


@pytest.mark.slow
def test_of_equally_many_claims_the_nearer_miss_comes_first():
    far, near = with_ratio(0.5, 4, 24), with_ratio(0.2, 4, 24)
    for order in ((far, near), (near, far)):
        best, other = ranked(along_fold_phase(*order))
        assert best.count(Grade.holds) == other.count(Grade.holds)
        assert best.results["n_stripe_4_is_auxetic_up_to_40"].margin == pytest.approx(-0.2)


def stated(cube, **options):
    return cube.assign_attrs({f"model_{name}": value for name, value in options.items()})


@pytest.mark.slow
def test_pure_stripes_serve_all_options_of_their_cells():
    flat, relaxed = (
        stated(good_checkerboards(), cell_size=size, fold_phase="stripe_border")
        for size in ("flat", "relaxed")
    )
    # Pure stripes have another fold phase, which does not affect them.
    stripes = stated(good_stripes(), cell_size="flat", fold_phase="stripe_centre")
    best, other = ranked(relaxed, flat, stripes)
    assert best.options["cell_size"] == "flat"
    assert best.results["stripes_are_j_shaped"].verdict is Grade.holds
    assert other.results["stripes_are_j_shaped"].verdict is Grade.not_measured
    assert best.decided - other.decided >= 5


@pytest.mark.slow
def test_cubes_of_the_same_options_are_judged_together():
    wide, narrow = good_checkerboards(), good_checkerboards()
    wide = wide.sel(n_stripe=[6, 8])
    narrow = narrow.sel(n_stripe=[2, 4])
    (one,) = ranked(stated(wide, z_max=1.0), stated(narrow, z_max=1.0))
    assert one.designs == 20
    assert one.results["n_stripe_4_is_auxetic_up_to_40"].verdict is Grade.holds
    assert one.results["longer_cells_are_less_auxetic"].judged == 10


def test_options_of_stripes_alone_are_ranked_by_their_claims():
    bent = good_stripes()
    bent["row_force"].loc[{"knit": "rib", "n": 4}] = np.linspace(0, 1, 41)
    stripes = stated(good_stripes(), cell_size="flat")
    best, other = ranked(stated(bent, cell_size="relaxed"), stripes)
    assert (best.options, other.options) == ({"cell_size": "flat"}, {"cell_size": "relaxed"})


def test_the_motion_is_an_option_of_what_moves():
    cube = good_checkerboards()
    assert ranking_options(cube) == {}
    motion = {"ending": "time", "damping_ratio": 0.05}
    moved = cube.assign_attrs(parameters=json.dumps({"dynamics": motion | {"snapshots": 0}}))
    assert ranking_options(moved) == motion
    swept = moved.assign_coords(damping_ratio=0.015)
    assert ranking_options(swept) == motion | {"damping_ratio": 0.015}


@pytest.mark.slow
@pytest.mark.nightly
def test_options_are_drawn_side_by_side_without_a_selection(tmp_path):
    write_cube(along_fold_phase(with_ratio(0.1), good_checkerboards()), tmp_path / "cube.nc")
    assert open_cube(tmp_path).sizes["fold_phase"] == 2
    with refused("fold_phase of stripe_border, stripe_centre"):
        draw_figure("auxetic", [tmp_path], tmp_path / "map.png")
    assert draw_figure("options", [tmp_path], tmp_path / "options.svg").stat().st_size > 0
    text = (tmp_path / "options.svg").read_text()
    best, other = ranked(open_cube(tmp_path))
    counts = [f"{each.count(Grade.holds)}/{each.decided}" for each in (best, other)]
    assert [found for found in re.findall(r"\d+/\d+", text) if found in counts] == counts
    files, mistakes = draw_figures(["options", "auxetic"], tmp_path)
    assert not mistakes
    assert {path.stem for path in files} == {
        "options",
        "auxetic_fold_phase-stripe_border",
        "auxetic_fold_phase-stripe_centre",
    }
