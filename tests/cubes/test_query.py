import contextlib
import json

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from hypothesis import assume, given
from hypothesis import strategies as st

from knitlab.cubes.condition import holds
from knitlab.cubes.query import designs_of_all, designs_table, formatted, queried, query_cubes
from knitlab.io.errors import InputError
from tests.cubes.artificial_cubes import synthetic_cube
from tests.refusals import refused

TABLE = designs_table(synthetic_cube())


def pairs(table):
    return list(zip(table["n_stripe"], table["n_subunit"], strict=True))


def test_excluded_combinations_are_no_designs_but_failures_are():
    assert len(TABLE) == 6
    assert set(TABLE["status"]) == {"ok", "failed", "pending", "not_converged"}


def test_where_sort_and_columns():
    found = queried(
        TABLE, "poisson_ratio_min < -0.3", ["-poisson_ratio_min"], ["n_subunit", "n_stripe"]
    )
    assert pairs(found) == [(4, 32), (4, 16)]
    assert list(found.columns) == ["n_subunit", "n_stripe"]


@pytest.mark.parametrize(
    ("expression", "expected"),
    [
        ('status == "failed" or status == "pending"', [(2, 32), (2, 64)]),
        ("-0.5 < poisson_ratio_min <= -0.4", [(4, 32)]),
        ("not poisson_ratio_min < 0 and n_stripe == 2 and n_subunit < 32", [(2, 16)]),
        ("n_subunit / (2 * n_stripe) == 2", [(4, 16), (8, 32)]),
        ("periods > 4 and not n_stripe == 4", [(2, 32), (2, 64)]),
        # Flags are compared by name, and a division by zero is missing.
        ("status == 'OK'", [(2, 16), (4, 16), (4, 32)]),
        ("1 / (n_stripe - 4) > 0", [(8, 32)]),
        ("not 1 / (n_stripe - 4) > 0", [(2, 16), (2, 32), (2, 64)]),
    ],
)
def test_expressions_are_evaluated(expression, expected):
    assert pairs(queried(TABLE, expression)) == expected


@pytest.mark.parametrize(
    ("expression", "message"),
    [
        ("poison_ratio_min < 0", "'poisson_ratio_min'"),
        ("poisson_ratio < 0", "applied_strain=VALUE"),
        ("poisson_ratio_min <", "parsed"),
        ("3 < 4", "not a condition"),
        ("n_stripe > 1" + " + 1" * 3000, "too long"),
        ("n_stripe and n_subunit", "'n_stripe' is not a condition"),
        ("status == 0", "word with a number"),
        ("status == 'fialed'", "'failed'"),
        ("-status == 'ok'", "cannot be computed"),
        ("1 / 0 < n_stripe", "divides by zero"),
        ("poisson_ratio_min != nan", r"isnan\(NAME\)"),
        ("capacitor_status == 'touching'", "no capacitor_status"),
        ("__import__('os').system('true')", "not allowed"),
        ("n_stripe in n_subunit", "not allowed"),
        ("n_stripe ** 9 ** 9 > 1", "not allowed"),
    ],
)
def test_anything_else_is_refused(expression, message):
    with pytest.raises(InputError, match=message):
        queried(TABLE, expression)


@given(
    st.lists(st.one_of(st.none(), st.integers(-3, 3)), min_size=1, max_size=6),
    st.sampled_from(["<", "<=", ">", ">=", "==", "!="]),
    st.integers(-3, 3),
)
def test_what_is_missing_fulfils_neither_a_condition_nor_its_negation(values, sign, limit):
    table = pd.DataFrame({"a": pd.array(values, dtype="Float64").to_numpy(float, na_value=np.nan)})
    said = f"a {sign} {limit}"
    true = [value is not None and eval(f"{value} {sign} {limit}") for value in values]
    false = [value is not None and not each for value, each in zip(values, true, strict=True)]
    assert holds(said, table).tolist() == true
    assert holds(f"not {said}", table).tolist() == false


def test_columns_may_be_one_text():
    cube = synthetic_cube()
    listed = ["n_stripe", "mean(poisson_ratio, 0.1:0.2)"]
    assert list(query_cubes([cube], columns=", ".join(listed)).columns) == listed
    with refused("nu"):
        query_cubes([cube], columns="nu")


@given(st.permutations([0, 1, 1, 2]), st.permutations([5, 5, 6, 7]))
def test_sorted_by_two_columns_the_second_decides_where_the_first_is_equal(first, second):
    table = pd.DataFrame({"a": first, "b": second})
    found = queried(table, sort=["-a", "b"])
    rows = sorted(zip(first, second, strict=True), key=lambda row: (-row[0], row[1]))
    assert list(zip(found["a"], found["b"], strict=True)) == rows


def test_rows_of_two_cubes_have_their_cube_boundary_and_options():
    cubes = []
    for name, boundary, cells in (("one", "periodic", "flat"), ("two", "clamped", "relaxed")):
        cube = synthetic_cube().assign_attrs(
            workflow=name, model_boundary=boundary, model_cell_size=cells, model_hinges="all"
        )
        cubes.append(cube)
    table = designs_of_all(cubes)
    shown = table[["cube", "boundary", "cell_size"]].drop_duplicates().values.tolist()
    assert shown == [["one", "periodic", "flat"], ["two", "clamped", "relaxed"]]
    assert "hinges" not in table


def test_cubes_of_one_name_are_told_apart_by_their_folders(tmp_path):
    paths = [tmp_path / f"{place}/periodic/cube.nc" for place in ("a/x", "b/x", "b/x")]
    cubes = [synthetic_cube().assign_attrs(workflow="periodic") for _ in range(4)]
    for cube, path in zip(cubes, paths, strict=False):
        cube.encoding["source"] = str(path)
    cubes[3] = cubes[3].assign_attrs(workflow="other")
    found = designs_of_all(cubes)["cube"].unique().tolist()
    assert found == ["a/x/periodic", "b/x/periodic (1)", "b/x/periodic (2)", "other"]


@pytest.mark.slow
@given(st.text(max_size=30))
def test_any_text_filters_or_is_refused(expression):
    with contextlib.suppress(InputError):
        assert holds(expression, TABLE).dtype == bool


def test_a_selected_strain_brings_its_variables():
    table = designs_table(synthetic_cube(), {"applied_strain": [0.1, 0.2], "n_stripe": 4})
    assert list(table["poisson_ratio"]) == [-0.8, -0.4, -0.4, -0.2]
    assert "poisson_ratio" not in TABLE


def test_a_selected_word_may_hold_commas():
    cube = synthetic_cube().assign_coords(n_stripe=["a,b", "04", "4"])
    assert designs_table(cube, {"n_stripe": "a,b"})["n_stripe"].unique() == ["a,b"]
    assert designs_table(cube, {"n_stripe": [4]})["n_stripe"].unique() == ["4"]


def test_a_column_named_twice_appears_once():
    assert list(queried(TABLE, columns=["n_stripe", "n_stripe"]).columns) == ["n_stripe"]
    table = designs_table(synthetic_cube(), {"n_stripe": [4, 4]})
    assert pairs(table) == [(4, 16), (4, 32)]


@pytest.mark.parametrize(
    ("selection", "message"),
    [
        ({"n_stripe": 3}, "n_stripe = 3.*2, 4, 8"),
        ({"n_stripes": 4}, "did you mean 'n_stripe'"),
        ({"n_stripe": "four"}, "'four' is not a number"),
        ({"n_stripe": [4, None]}, "None"),
        ({"n_stripe": 10**400}, "is not a number"),
        ({"n_stripe": []}, "n_stripe=.*no value"),
        ({"applied_strain": 9.0}, "applied_strain"),
        ({"status": 1}, "'status'.*applied_strain, n_stripe, n_subunit"),
    ],
)
def test_a_bad_selection_is_named(selection, message):
    with pytest.raises(InputError, match=message):
        designs_table(synthetic_cube(), selection)


SUMS = [
    " + ".join(f"mean(poisson_ratio, 0.0{number}:0.{place})" for number in range(1, 10))
    for place in range(11, 23)
]


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"columns": [f"n_stripe + {number}" for number in range(101)]}, "101"),
        ({"columns": SUMS}, "108.*100"),
        ({"applied_strain": [0.1] * 10_001}, "applied_strain.*10,001"),
    ],
)
def test_too_much_at_once_is_refused_by_its_number(asked, message):
    with pytest.raises(InputError, match=message):
        synthetic_cube().knitlab.query(**asked)


def test_formats_hold_the_same_rows():
    as_csv = pd.read_csv(pd.io.common.StringIO(formatted(TABLE, "csv")))
    as_json = pd.DataFrame(json.loads(formatted(TABLE, "json")))
    assert pairs(as_csv) == pairs(as_json) == pairs(TABLE)
    assert as_json["poisson_ratio_min"][0] == TABLE["poisson_ratio_min"][0]
    assert formatted(TABLE, "table").count("\n") == len(TABLE)
    assert formatted(TABLE[:0], "table") == "no design matches"


def test_headings_for_people_have_units_and_names_for_programs_do_not():
    cube = synthetic_cube()
    cube["period"] = ("n_stripe", [1.0, 2.0, 3.0], {"units": "mm"})
    cube["poisson_ratio"].attrs["units"] = "1"
    cube["pull"] = cube["poisson_ratio"].assign_attrs(units="N")
    asked = ["n_stripe", "period", "poisson_ratio", "slope(pull, 0.1:0.2)", "2 * period"]
    table = query_cubes([cube, cube], {"applied_strain": 0.1}, columns=asked)
    heading = formatted(table, "table").splitlines()[0]
    for name in ("period [mm]", "slope(pull, 0.1:0.2) [N]"):
        assert name in heading
    assert heading.count("[") == 2
    assert "period," in formatted(table, "csv").splitlines()[0]
    assert json.loads(formatted(table, "json"))[0].keys() == set(table.columns)


@given(st.floats(0.0, 1.0), st.integers(0, 3))
def test_strains_between_those_of_the_cube_are_interpolated_as_in_windows(share, number):
    cube = synthetic_cube()
    strains = cube["applied_strain"].values
    at = float(strains[1] + share * (strains[-1] - strains[1]))
    # A strain that is nearer to one of the cube is that one to a query.
    assume(not 0 < abs(strains - at).min() < 1e-6)
    table = query_cubes([cube], {"applied_strain": at}, columns=["poisson_ratio", "n_stripe"])
    reduced = query_cubes([cube], columns=[f"mean(poisson_ratio, {at}:{at})"])
    np.testing.assert_allclose(
        table["poisson_ratio"].to_numpy(float), reduced.iloc[:, 0].to_numpy(float), atol=1e-12
    )


def test_counts_between_two_strains_are_known_only_if_both_agree():
    cube = synthetic_cube()
    strains = cube["applied_strain"].values
    counts = xr.zeros_like(cube["poisson_ratio"], dtype=np.int32)
    counts[..., 2] = 5
    cube["self_intersections"] = counts
    middles = [float(strains[k : k + 2].mean()) for k in (0, 1)]
    read = cube.knitlab.select(applied_strain=middles)["self_intersections"]
    assert read.sizes["applied_strain"] == 2
    assert (read.isel(applied_strain=0) == 0).all()
    assert read.isel(applied_strain=1).isnull().all()
