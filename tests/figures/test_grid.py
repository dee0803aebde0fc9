"""The grid: any variable over any two dimensions, on synthetic cubes."""

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner

import knitlab as kl
from knitlab.cli import main
from knitlab.figures.kinds.grid import with_periods
from knitlab.io.errors import InputError
from knitlab.observables.status import Status
from tests.cubes.artificial_cubes import STATUS, synthetic_cube

FACTORS = [0.5, 1.0, 2.0]


def swept_cube() -> xr.Dataset:
    """A synthetic cube along ``k_t_factor`` and ``pattern`` too, whose values differ along both."""
    cubes = []
    for pattern in ("checkerboard", "framed"):
        for factor in FACTORS:
            cube = synthetic_cube()
            scale = factor * (1 if pattern == "checkerboard" else 10)
            cube["poisson_ratio"] = cube["poisson_ratio"] * scale
            cubes.append(cube.expand_dims(k_t_factor=[factor], pattern=[pattern]))
    cube = xr.combine_by_coords(cubes, data_vars="all")
    return cube.transpose("n_stripe", "n_subunit", "k_t_factor", "pattern", ...)


def written(figure):
    """Numbers of the cells, by the place of the cell."""
    return {
        tuple(np.round(text.get_position(), 6)): float(text.get_text().replace("−", "-"))
        for text in figure.axes[0].texts
    }


def test_every_number_is_that_of_the_cube():
    cube = swept_cube()
    chosen = {"n_stripe": 4, "pattern": "framed", "applied_strain": 0.1}
    figure = kl.plot.grid(cube, x="k_t_factor", y="n_subunit", of="poisson_ratio", **chosen)
    values = cube["poisson_ratio"].sel(chosen)
    # n_stripe 4 has no design at n_subunit 64, so that its row is left out.
    assert written(figure) == {
        (float(column), float(row)): pytest.approx(
            float(values.sel(k_t_factor=factor, n_subunit=n_subunit)), abs=0.05
        )
        for column, factor in enumerate(FACTORS)
        for row, n_subunit in enumerate([16, 32])
    }
    assert [label.get_text() for label in figure.axes[0].get_xticklabels()] == ["0.5", "1", "2"]
    low, high = figure.axes[1].get_ylim()
    assert (low, high) == pytest.approx((-16.0, -2.0))


def test_no_cell_is_drawn_for_an_impossible_design_and_others_are_marked_by_status():
    figure = kl.plot.grid(synthetic_cube(), x="n_subunit", y="n_stripe")
    axes = figure.axes[0]
    planned = [status for status in STATUS.values() if status is not Status.excluded]
    assert len(axes.patches) == len(planned)
    hatches = sorted(patch.get_hatch() for patch in axes.patches if patch.get_hatch())
    assert hatches == ["....", "////", "xxxx"]
    notes = {text.get_text() for text in figure.legends[0].get_texts()}
    assert {"not yet run", "not converged", "failed"} < notes


def test_designs_lie_along_p_by_default():
    figure = kl.plot.grid(synthetic_cube())
    axes = figure.axes[0]
    assert axes.get_xlabel().endswith("periods of a stripe across a patch")
    # (2, 16) and (4, 32) both have P = 4, (4, 16) has 2.
    labels = [float(label.get_text()) for label in axes.get_xticklabels()]
    places = dict(zip(labels, axes.get_xticks(), strict=True))
    rows = dict(zip([2, 4, 8], axes.get_yticks(), strict=True))
    at = {(places[2.0], rows[4]): -0.8, (places[4.0], rows[2]): 0.05, (places[4.0], rows[4]): -0.4}
    assert written(figure) == pytest.approx(at)


def test_a_cube_by_p_has_the_same_designs():
    cube = synthetic_cube()
    moved = with_periods(cube)
    for (n_stripe, n_subunit), status in STATUS.items():
        if status is not Status.excluded:
            design = moved.sel(n_stripe=n_stripe, periods=n_subunit / (2 * n_stripe))
            assert int(design["n_subunit"]) == n_subunit
            assert int(design["status"]) == status
    kept = int((cube["status"] != Status.excluded).sum())
    assert int((moved["status"] != Status.excluded).sum()) == kept


@pytest.mark.parametrize(
    ("options", "chosen", "message"),
    [
        ({"of": "poisson_ration"}, {}, "poisson_ratio"),
        ({"of": "status"}, {}, "status"),
        ({"x": "theta_0", "of": "poisson_ratio"}, {}, "theta_0"),
        ({"of": "poisson_ratio"}, {}, "x and y"),
        ({"x": "n_subunit", "y": "n_subunit"}, {}, "y: .*n_subunit"),
        (
            {"x": "n_subunit", "y": "n_stripe", "of": "poisson_ratio"},
            {"k_t_factor": 1.0, "pattern": "framed"},
            "applied_strain of 0.0, 0.1, 0.2",
        ),
        ({"x": "n_subunit", "y": "k_t_factor"}, {"n_stripe": 3}, "n_stripe = 3"),
    ],
)
def test_what_cannot_be_shown_is_explained(options, chosen, message):
    with pytest.raises(InputError, match=message):
        kl.plot.grid(swept_cube(), **options, **chosen)


def test_the_command_draws_the_variable_that_it_is_given(tmp_path):
    synthetic_cube().to_netcdf(tmp_path / "cube.nc")
    words = ["map", "grid", str(tmp_path / "cube.nc"), "-o", str(tmp_path / "grid.svg")]
    words += ["--x", "periods", "--of", "poisson_ratio", "--select", "applied_strain=0.2"]
    for more in ([], ["--y", "n_stripe"]):
        result = CliRunner().invoke(main, [*words, *more])
        assert result.exit_code == 0, result.output
        assert "−0.4" in (tmp_path / "grid.svg").read_text(encoding="utf-8")
    refused = CliRunner().invoke(main, [*words, "--y", "nsubunit"])
    assert refused.exit_code == 2
    assert refused.output.startswith("knitlab: --y: there is no dimension of poisson_ratio")
