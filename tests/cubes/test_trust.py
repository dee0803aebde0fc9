"""Marks on what not to rely on: their rules, and where tables, find and figures show them."""

import io
import json

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from click.testing import CliRunner

import knitlab as kl
from knitlab.claims.claims import read_claims
from knitlab.cli import main
from knitlab.cubes.cube_file import write_cube
from knitlab.cubes.query import query_cubes
from knitlab.cubes.trust import MARKS, legend, marked, marks_of, marks_of_rows
from knitlab.figures.kinds.sensor import sensor
from tests.cubes.artificial_cubes import synthetic_cube

DIMS, ALONG = ("n_stripe", "n_subunit"), ("n_stripe", "n_subunit", "applied_strain")
STRAIN = [0.0, 0.1, 0.2, 0.3]
SIGNS = {name: mark.sign for name, mark in MARKS.items()}


def cube_of(lowest=((-0.2, -0.3), (-0.4, -0.5)), **curves):
    """Designs (2, 16), (2, 32), (4, 16), (4, 32), lowest at 0.2; curves are by strain."""
    lowest = np.array(lowest)
    ratio = lowest[..., None] * np.array([np.nan, 0.5, 1.0, 0.8])
    values = {
        "status": (DIMS, np.ones((2, 2), np.int8)),
        "case_id": (DIMS, [["a", "b"], ["c", "d"]]),
        "periods": (DIMS, [[4, 8], [2, 4]]),
        "poisson_ratio": (ALONG, ratio),
        "poisson_ratio_min": (DIMS, lowest),
        "applied_strain_at_min": (DIMS, np.full((2, 2), 0.2)),
        "reaction_force": (ALONG, np.broadcast_to([0.0, 1.0, 2.0, 3.0], (2, 2, 4))),
    }
    for name, curve in curves.items():
        values[name] = ALONG, np.broadcast_to(np.array(curve, float), (2, 2, 4)).copy()
    return xr.Dataset(values, {"n_stripe": [2, 4], "n_subunit": [16, 32], "applied_strain": STRAIN})


def has(cube, mark, names=("poisson_ratio_min",), **design):
    """Whether a design has a mark."""
    found = marked(cube, names).get(mark)
    return found is not None and bool(found.sel({"n_stripe": 4, "n_subunit": 16} | design))


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["poisson_ratio_min"], True),
        (["n_stripe", "knit_cell_x"], False),
        (["max(poisson_ratio, 0.05:0.15)"], True),  # interpolated up to 0.2
        (["2*mean(poisson_ratio, 0:0.1)"], False),
        (["mean(poisson_ratio, 0.22:0.28)"], True),
        (["mean(poisson_ratio, 0.3:0.3)"], False),
    ],
)
def test_the_states_count_that_values_are_of(names, expected):
    cube = cube_of(self_intersections=[0, 0, 5, 0])
    assert has(cube, "intersecting", names) == expected


def test_capacitors_count_over_the_range_of_sensing():
    cube = cube_of(self_intersections=[5, 0, 0, 5])
    ends = {"applied_strain_opened": 0.1, "sensing_end": [[0.2, 0.2], [0.2, 0.3]]}
    cube = cube.assign({name: end + 0.0 * cube["status"] for name, end in ends.items()})
    assert not has(cube, "intersecting", ["sensitivity"])
    assert has(cube, "intersecting", ["working_range"], n_subunit=32)


@pytest.mark.parametrize(
    ("selected", "expected"), [(0.1, False), (0.15, True), (0.2, True), (0.25, True), (0.3, False)]
)
def test_a_selected_strain_counts_alone(selected, expected):
    cube = cube_of(self_intersections=[0, 0, 5, 0])
    table = query_cubes([cube], {"applied_strain": selected}, columns=["n_stripe", "marks"])
    assert (SIGNS["intersecting"] in table["marks"].iloc[-1]) == expected
    under = {"reaction_force": 10 * selected}
    forced = query_cubes([cube], under, columns=["n_stripe", "marks"])
    assert forced["marks"].tolist() == table["marks"].tolist()


def test_a_snap_marks_all_that_follows():
    cube = cube_of(snapped=[0, 1, 0, 0])
    at = marks_of(cube, [], each_strain=True).sel(n_stripe=4, n_subunit=16)
    assert at.values.tolist() == ["", *[SIGNS["snapped"]] * 3]


@pytest.mark.parametrize("lowest", [-0.1, 0.05])
def test_designs_are_marked_whose_claim_fails(lowest):
    cube = cube_of([[lowest, -0.3], [-0.4, -0.5]])
    cube["poisson_ratio"] = abs(cube["poisson_ratio"]) * np.sign(cube["poisson_ratio_min"])
    contrary = marked(cube, [])["contrary"]
    assert contrary.sel(n_stripe=2).values.tolist() == [lowest < 0, True]
    assert not contrary.sel(n_stripe=4).any()
    (claim,) = (each for each in read_claims() if each.name == "narrowest_is_slightly_positive")
    for n_subunit in (16, 32):
        one = cube.sel(n_stripe=[2], n_subunit=[n_subunit])
        result = claim.check([one])
        assert (result.margin < 0) == contrary.sel(n_stripe=2, n_subunit=n_subunit).item()


def test_a_test_that_ended_early_counts_as_far_as_it_went():
    cube = cube_of()
    cube["poisson_ratio_min"][:] = np.nan
    assert marked(cube, [])["contrary"].values.tolist() == [[True, True], [False, False]]


def test_a_claim_about_one_design_marks_it_alone():
    cube = cube_of().assign_coords(n_subunit=[40, 48])
    assert marked(cube, [])["contrary"].values.tolist() == [[True, True], [False, True]]


def moving_cube(left, **attributes):
    """Samples by dynamics whose energy grows by 1 with each strain, with some energy left."""
    curves = {
        "energy_stretch": [4.0, 5.0, 6.0, 7.0],
        "energy_fold": [1.0] * 4,
        "kinetic_energy_peak": [10.0, 0.1, 0.1, 0.1],
        "mean_strain_yy": [0.0, 0.09, 0.19, 0.29],
    }
    cube = cube_of(**curves).assign(kinetic_energy_left=(DIMS, np.full((2, 2), left / 10)))
    ending = json.dumps({"dynamics": {"ending": "time"}})
    return cube.assign_attrs({"method": "dynamics", "parameters": ending} | attributes)


@pytest.mark.parametrize(("left", "states"), [(2e-4, 0), (7e-4, 1), (1.2e-3, 2), (1.0, 3)])
def test_states_are_marked_until_the_pull_exceeds_what_relaxing_left(left, states):
    # 100 times the kinetic energy left is more than 5 % of the 1, 2 and 3 gained.
    at = marked(moving_cube(left), [], each_strain=True)["moving"].sel(n_stripe=4, n_subunit=16)
    assert at.values.tolist() == [False, *[True] * states, *[False] * (3 - states)]


def test_states_are_marked_until_the_pull_has_reached_the_middle():
    cube = moving_cube(0.0)
    cube["mean_strain_yy"].loc[{"n_stripe": 4, "n_subunit": 16}] = [0.0, 0.04, 0.12, 0.29]
    at = marked(cube, [], each_strain=True)["moving"]
    assert at.sel(n_stripe=4, n_subunit=16).values.tolist() == [False, True, False, False]
    assert not at.sel(n_stripe=2).any()


@pytest.mark.parametrize(
    "attributes",
    [{"method": "equilibrium"}, {"parameters": json.dumps({"dynamics": {"ending": "rest"}})}],
)
def test_states_at_rest_are_not_marked(attributes):
    assert "moving" not in marked(moving_cube(1.0, **attributes), [])


@pytest.mark.slow
@pytest.mark.nightly
def test_a_simulated_sample_is_marked_until_it_has_relaxed(tmp_path):
    settings = {"n_stripe": 4, "n_subunit": 8, "unit_cells": [2, 2], "strain_max": 0.06}
    cube = kl.run("preview", **settings, relax_steps=[300, 12000], results=tmp_path)
    marks = cube.knitlab.query(columns=["relax_steps", "marks"], applied_strain=0.06)
    assert [SIGNS["moving"] in each for each in marks["marks"]] == [True, False]


@pytest.fixture
def folder(tmp_path):
    cube = cube_of(self_intersections=[0, 0, 5, 0])
    cube["self_intersections"].loc[{"n_stripe": 4, "n_subunit": 32}] = 0
    write_cube(cube, tmp_path / "cube.nc")
    return tmp_path


def said(*words):
    result = CliRunner().invoke(main, [*map(str, words)])
    assert result.exit_code == 0, result.output
    return result.stdout


def test_a_table_has_marks_and_their_reasons_where_there_are_any(folder):
    shown = ("--columns", "n_subunit,poisson_ratio_min", "--sort", "poisson_ratio_min")
    lines = said("query", folder, *shown).splitlines()
    both = SIGNS["intersecting"] + SIGNS["contrary"]
    assert lines[0].split() == ["n_subunit", "poisson_ratio_min", "marks"]
    assert [line.split()[2:] for line in lines[1:5]] == [[], ["†"], [both], [both]]
    assert lines[5:] == legend([both])
    where = ("--where", "n_stripe == 4 and n_subunit == 32")
    assert "marks" not in said("query", folder, *shown, *where)


def test_a_measured_capacitance_is_shown_at_several_strains(tmp_path):
    cube = synthetic_cube()[["status", "case_id", "periods", "poisson_ratio"]]
    cube = cube.rename(poisson_ratio="capacitance").assign_coords(source="measured")
    write_cube(cube, tmp_path / "cube.nc")
    shown = ("--columns", "applied_strain,capacitance", "--select", "applied_strain=0.1,0.2")
    one = ("--select", "n_stripe=4", "--select", "n_subunit=16")
    lines = said("query", tmp_path, *shown, *one).splitlines()
    assert [line.split() for line in lines[1:]] == [["0.1", "-0.8"], ["0.2", "-0.4"]]


def test_programs_get_marks_only_if_they_ask(folder):
    for style in ("csv", "json"):
        assert "marks" not in said("query", folder, "--format", style)
        assert "marks" not in said(
            "find", folder, "--target", "poisson_ratio_min = -0.4", "--format", style
        )
    asked = ("--columns", "n_stripe,poisson_ratio_min,marks", "--format", "csv")
    table = pd.read_csv(io.StringIO(said("query", folder, *asked)), keep_default_na=False)
    assert table["marks"].tolist() == ["†*", "†*", "†", ""]
    assert table["poisson_ratio_min"].dtype == float


def test_designs_that_are_found_have_their_own_marks(folder):
    nearest = kl.find(folder, targets="poisson_ratio = -0.4 @ 0.15:0.25")
    labels = nearest.table[["n_stripe", "n_subunit"]].itertuples(index=False)
    signs = dict(zip(map(tuple, labels), nearest.marks, strict=True))
    assert signs == {(2, 16): "†*", (2, 32): "†*", (4, 16): "†", (4, 32): ""}
    early = kl.find(folder, targets="poisson_ratio = -0.4 @ 0.1", subject_to="n_stripe > 3")
    assert early.marks == ("", "")
    assert "†" in said("find", folder, "--target", "poisson_ratio = -0.4 @ 0.2").splitlines()[-2]


def test_rows_of_several_cubes_have_the_marks_of_their_own(folder):
    plain = cube_of([[0.1, 0.1], [-0.4, -0.4]])
    table = query_cubes(
        [kl.open_cube(folder), plain],
        sort="-poisson_ratio_min",
        columns=["poisson_ratio_min", "marks"],
    )
    assert table["marks"].tolist() == ["", "", "†*", "†*", "†", "", "", ""]


def test_rows_of_another_table_have_the_marks_of_their_states():
    cube = cube_of(self_intersections=[0, 0, 5, 0])
    rows = pd.DataFrame({"applied_strain": [0.2, 0.1], "n_stripe": [4, 2], "n_subunit": [32, 16]})
    assert marks_of_rows(cube, rows) == ["†", "*"]


def test_the_sensor_marks_its_cells_and_its_front():
    cube = cube_of(self_intersections=[0, 0, 5, 0], capacitance=[4.0, 3.0, 2.0, 1.0])
    cube["self_intersections"].loc[{"n_stripe": 4, "n_subunit": 32}] = 0
    cube["capacitance"] = cube["capacitance"] * xr.DataArray([1.0, 2.0], dims="n_subunit")
    figure = sensor([cube], "0.1:0.3")
    cells = [text.get_text() for text in figure.axes[0].texts]
    assert sum("†" in text for text in cells) == 3
    assert sum("*" in text for text in cells) == 2
    (listed,) = (ax.get_title(loc="left") for ax in figure.axes if ax.get_title(loc="left"))
    assert "(2, 32)†*" in listed
    entries = [text.get_text() for each in figure.legends for text in each.get_texts()]
    assert set(legend(["†*"])) <= set(entries)
