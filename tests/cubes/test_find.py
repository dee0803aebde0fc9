"""Finding: ranks against brute force, spreads, and refused targets."""

import numpy as np
import pytest
import xarray as xr

import knitlab as kl
from knitlab.cubes.cube_file import open_cube
from knitlab.cubes.find import find_designs
from knitlab.cubes.query import query_cubes
from knitlab.cubes.target import read_target
from knitlab.io.shipped import shipped
from knitlab.observables.status import Status

STRAIN = np.array([0.0, 0.1, 0.2, 0.3])
LEVELS = {(4, 16): -0.1, (4, 24): -0.25, (8, 32): -0.32, (8, 48): -0.6}
CURVE = "poisson_ratio = -0.3 @ 0.1:0.3"


def cube(**changes):
    """Designs with constant Poisson's ratio, a spread of ±0.02 and increasing size."""
    dims = ("n_stripe", "n_subunit")
    stripes, subunits = [4, 8], [16, 24, 32, 48]
    ratio = np.full((2, 4, 4), np.nan)
    size, status = np.full((2, 4), np.nan), np.full((2, 4), Status.excluded, np.int8)
    for (n, m), level in LEVELS.items():
        place = stripes.index(n), subunits.index(m)
        ratio[place] = level
        ratio[(*place, 0)] = np.nan
        size[place], status[place] = m / 2, Status.ok
    variables = {
        "status": (dims, status),
        "case_id": (dims, np.where(status == Status.ok, "a", "").astype(object)),
        "poisson_ratio": ((*dims, "applied_strain"), ratio),
        "poisson_ratio_low": ((*dims, "applied_strain"), ratio - 0.02),
        "poisson_ratio_high": ((*dims, "applied_strain"), ratio + 0.02),
        "knit_cell_x": (dims, size),
    }
    coordinates = {"n_stripe": stripes, "n_subunit": subunits, "applied_strain": STRAIN}
    return xr.Dataset(variables | changes, coordinates)


def designs(found):
    return list(map(tuple, found.table[["n_stripe", "n_subunit"]].to_numpy().tolist()))


def test_designs_are_ranked_by_their_distance():
    found = kl.find(cube(), targets=CURVE)
    assert designs(found) == sorted(LEVELS, key=lambda design: abs(LEVELS[design] + 0.3))
    off_by = found.table["off_by_1"]
    np.testing.assert_allclose(off_by, [0.02, 0.05, 0.2, 0.3], atol=1e-12)
    np.testing.assert_allclose(
        found.table["distance"], off_by / np.std(list(LEVELS.values())), rtol=1e-12
    )


def test_several_targets_are_weighed_by_their_tolerances():
    found = kl.find(
        cube(), targets=[f"{CURVE.split(' @')[0]} ± 0.1 @ 0.1:0.3", "knit_cell_x < 10 ± 2"]
    )
    expected = {
        (n, m): np.hypot(abs(level + 0.3) / 0.1, max(m / 2 - 10, 0) / 2) / np.sqrt(2)
        for (n, m), level in LEVELS.items()
    }
    assert designs(found) == sorted(expected, key=expected.get)
    np.testing.assert_allclose(found.table["distance"], sorted(expected.values()), rtol=1e-12)


def test_the_spread_contains_targets_within_its_band():
    found = kl.find(cube(), targets="poisson_ratio = -0.31 @ 0.1:0.3")
    covered = dict(zip(designs(found), found.table["in_spread_1"], strict=True))
    assert covered == {(8, 32): "yes", (4, 24): "no", (4, 16): "no", (8, 48): "no"}
    reduced = kl.find(cube(), targets="mean(poisson_ratio) < -0.58 @ 0.1:0.3")
    assert reduced.table.iloc[0]["in_spread_1"] == "yes"
    without = cube().drop_vars(["poisson_ratio_low", "poisson_ratio_high"])
    assert set(kl.find(without, targets=CURVE).table["in_spread_1"]) == {"unknown"}


def test_constraints_leave_designs_out_and_report_it():
    found = kl.find(cube(), targets=CURVE, subject_to=["knit_cell_x < 15"])
    assert designs(found) == [(4, 24), (4, 16)]
    assert found.excluded["do not meet a constraint"] == 2
    none = kl.find(cube(), targets=CURVE, subject_to=["knit_cell_x < 1"])
    assert none.table.empty


def test_a_design_without_a_value_in_the_window_is_skipped():
    found = kl.find(cube(), targets="poisson_ratio < 0 @ 0.1:0.4")
    assert found.table.empty
    assert found.excluded == {"have no value at the strains of a target": 4}


def test_cubes_on_other_strains_are_searched_together():
    coarser = cube().sel(applied_strain=[0.1, 0.3]).assign_attrs(workflow="coarser")
    found = kl.find(cube().assign_attrs(workflow="finer"), coarser, targets=CURVE, most=2)
    assert designs(found) == [(8, 32), (8, 32)]
    assert set(found.table["cube"]) == {"coarser", "finer"}
    np.testing.assert_allclose(found.table["off_by_1"], 0.02, atol=1e-12)


@pytest.mark.parametrize(
    ("targets", "message"),
    [
        ([], "give a target"),
        ("poisson_ratio", "NAME = VALUE"),
        ("poisson_ratio = -0.3", "@ STRAIN"),
        ("poison_ratio = -0.3 @ 0.1", "'poisson_ratio'"),
        ("knit_cell_x < 20 @ 0.1", "window"),
        ("median(poisson_ratio) = 1 @ 0.1:0.2", "reduction 'median'.*mean"),
        ("slope(poisson_ratio) = 1 @ 0.1", "needs a window"),
        ("1 < knit_cell_x < 0", "exchange them"),
        ("knit_cell_x = 3 ± 0", "tolerance"),
        ([CURVE] * 31, "31.*30"),
        (["a ~ 3", "b"], r"(?s)a ~ 3.*target b"),
    ],
)
def test_an_invalid_target_is_refused(targets, message):
    with pytest.raises(kl.InputError, match=message):
        kl.find(cube(), targets=targets)


@pytest.mark.parametrize(
    ("text", "low", "high"),
    [
        ("a = 1e-3", 1e-3, 1e-3),
        ("a<=-.5 +/- 0.1 @0.2", -np.inf, -0.5),
        ("max(a) >= 2 @ 0:1", 2, np.inf),
        ("-0.4 < a < -0.2 @ 0.1 : 0.2", -0.4, -0.2),
    ],
)
def test_a_target_is_read(text, low, high):
    target = read_target(text)
    assert (target.name, target.low, target.high) == ("a", low, high)


def test_curves_can_be_reduced_in_queries():
    table = kl.query(
        cube(),
        where="mean(poisson_ratio,0.1:0.3) < -0.2 and n_stripe in (8, 9) and abs(knit_cell_x) < 20",
        columns=["n_subunit", "spread(poisson_ratio, 0.1:0.2)"],
    )
    assert table["n_subunit"].tolist() == [32]
    assert table.iloc[0, 1] == pytest.approx(0, abs=1e-12)
    missing = kl.query(cube(), where="isnan(mean(poisson_ratio, 0.1:0.4))")
    assert len(missing) == len(LEVELS)
    with pytest.raises(kl.InputError, match="applied_strain"):
        kl.query(cube(), where="mean(knit_cell_x, 0:0.1) > 0")


@pytest.mark.parametrize("window", ["0", "0.05", "0:0.2", "0.06:0.2"])
def test_poisson_ratio_below_its_first_strain_is_refused(window):
    """Wherever a window is asked for: it names the variable, the window and the first strain."""
    target = f"poisson_ratio = -0.5 ± 0.1 @ {window}"
    for ask in (
        lambda: kl.find(cube(), targets=target),
        lambda: kl.find(cube(), targets=CURVE, subject_to=[target]),
        lambda: kl.query(cube(), where=f"mean(poisson_ratio, {window}) < 0"),
        lambda: kl.find(cube(), targets=f"max(poisson_ratio, {window}) < 0"),
    ):
        with pytest.raises(kl.InputError, match=rf"{window}.*0\.1\b.*poisson_ratio"):
            ask()


def test_poisson_ratio_is_missing_below_its_first_strain():
    strains = [0.0, 0.05, 0.1, 0.15]
    with_size = cube().assign(reaction_force=("applied_strain", 2 * STRAIN))
    table = kl.query(with_size, applied_strain=strains).sort_values("applied_strain")
    (one, *_) = (rows for _, rows in table[table["status"] == "ok"].groupby("n_subunit"))
    np.testing.assert_allclose(one["poisson_ratio"], [np.nan, np.nan, -0.1, -0.1])
    np.testing.assert_allclose(one["reaction_force"], np.multiply(2, strains))


def test_a_figure_shows_targets_and_designs():
    from knitlab.figures.nearest_designs import nearest_figure

    found = kl.find(cube(), targets=[CURVE, "knit_cell_x < 10"], most=3)
    curves, sizes = nearest_figure(found).axes
    assert len(curves.get_lines()) == 3 + 1
    assert sizes.collections[0].get_offsets()[:, 1].tolist() == found.table["value_2"].tolist()
    sensor = shipped("params").parent / "results" / "reference" / "sensor"
    straight = kl.find(sensor, targets="linearity(capacitance) > 0.9 @ 0.05:0.25")
    assert nearest_figure(straight).axes[0].get_ylabel().endswith("[1]")


def test_a_target_may_be_an_expression_over_columns():
    cube = open_cube("results/reference/periodic")
    text = "2 * poisson_ratio_min - mean(poisson_ratio, 0.05:0.25)"
    found = find_designs([cube], [read_target(f"{text} < -0.65")])
    table = query_cubes([cube], where=f"{text} < -0.65", columns=["n_stripe", "n_subunit"])
    met = found.table[found.table["off_by_1"] == 0]
    chosen = met[["n_stripe", "n_subunit"]].sort_values(["n_stripe", "n_subunit"])
    assert len(chosen)
    assert chosen.to_numpy().tolist() == table.to_numpy().tolist()


def test_a_curve_in_an_expression_must_be_reduced():
    cube = open_cube("results/reference/periodic")
    with pytest.raises(kl.InputError, match=r"or reduce it, as mean\(force_per_width"):
        find_designs([cube], [read_target("force_per_width / 2 = 0.1")])
