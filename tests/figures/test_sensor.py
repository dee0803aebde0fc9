"""Maps of sensors on artificial cubes: the Pareto front, missing values, and refused cubes."""

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from knitlab.cli import main
from knitlab.figures.kinds.capacitors import capacitors
from knitlab.figures.kinds.sensor import PAPER, sensor, values_of_designs
from knitlab.figures.nearest_designs import non_dominated
from knitlab.io.errors import InputError
from tests.cubes.artificial_cubes import synthetic_cube
from tests.figures.test_drawing import values_written

FIGURE = st.floats(0, 10, width=16)


def with_electrodes() -> xr.Dataset:
    cube = synthetic_cube()
    designs, states = cube["status"].dims, cube["poisson_ratio"].dims
    steep = np.array([[0.5, np.nan, np.nan], [2.0, 1.0, np.nan], [np.nan, 3.0, np.nan]])
    wide = np.array([[0.3, np.nan, np.nan], [0.1, 0.05, np.nan], [np.nan, 0.2, np.nan]])
    curve = np.broadcast_to([4.0, 3.0, 2.5], (*steep.shape, 3))
    for name, values in {
        "sensitivity": steep,
        "working_range": wide,
        "applied_strain_opened": np.zeros_like(steep),
        "sensing_end": np.full_like(steep, 0.2),
        "electrode_length": np.full_like(steep, 100.0),
    }.items():
        cube[name] = designs, values
    for name, values in {
        "capacitance": curve,
        "capacitance_ratio": curve / 4,
        "capacitance_wedge": 1.1 * curve,
        "capacitor_status": np.zeros_like(curve),
        "fold_between": np.broadcast_to([2.0, 1.0, 0.5], curve.shape),
    }.items():
        cube[name] = states, values
    return cube


def test_values_are_of_designs_that_are_ok():
    table = values_of_designs([with_electrodes()], PAPER)
    designs = list(zip(table["n_stripe"], table["n_subunit"], strict=True))
    assert designs == [(2, 16), (4, 16), (4, 32)]


@given(st.lists(st.tuples(FIGURE, FIGURE), min_size=1, max_size=12))
def test_the_front_is_the_set_of_points_that_none_dominates(points):
    front = non_dominated(-np.array(points))

    def beats(one, other):
        return one != other and one[0] >= other[0] and one[1] >= other[1]

    assert front.any()
    for point, on_front in zip(points, front, strict=True):
        assert on_front != any(beats(other, point) for other in points)


@pytest.mark.slow
def test_the_map_writes_both_figures_and_lists_the_front():
    steep, wide, trade_off = sensor([with_electrodes()]).axes[:3]
    assert values_written(steep) == ["−0.50", "−2.00", "−1.00"]
    assert values_written(wide) == ["30%", "10%", "5%"]
    hatched = [patch for patch in steep.patches if patch.get_hatch()]
    assert len(hatched) == 3, "failed, pending and not converged are not marked"
    assert trade_off.get_title(loc="left").endswith(
        "a (4, 16) 2.00 pF, 10%; b (2, 16) 0.50 pF, 30%"
    )


def test_the_papers_checkerboards_are_drawn_with_their_slopes():
    curves, absolute, slopes = capacitors([with_electrodes()]).axes
    assert absolute.get_ylabel() == "$C$ [pF]\nelectrodes of 100 mm"
    names = [line.get_label() for line in curves.lines if line.get_label().startswith("(")]
    assert names == ["(4, 16)", "(4, 32)"]
    assert [patch.get_height() for patch in slopes.patches] == [2.0, 1.0]


@pytest.mark.parametrize("draw", [sensor, lambda cube: capacitors([cube])])
def test_a_cube_without_electrodes_is_refused(draw):
    with pytest.raises(InputError, match="electrodes"):
        draw(synthetic_cube())


def test_a_map_of_one_cube_refuses_two(tmp_path):
    with_electrodes().to_netcdf(tmp_path / "cube.nc")
    cube = str(tmp_path / "cube.nc")
    output = str(tmp_path / "map.png")
    for kind, problem in (
        ("sensor", "shows one simulation, and experiments beside it"),
        ("wavelength", "shows one cube, not 2"),
    ):
        result = CliRunner().invoke(main, ["map", kind, cube, cube, "-o", output])
        assert result.exit_code == 2
        assert problem in result.output
    drawn = CliRunner().invoke(main, ["map", "capacitors", cube, cube, "-o", output])
    assert drawn.exit_code == 0, drawn.output


def test_a_window_shows_slope_and_linearity_within_it():
    """From 4 through 3 to 2.5: the mean slope of 0 to 0.2 is −7.5, that of 0 to 0.1 is −10."""
    figure = sensor([with_electrodes()], window="0:0.1")
    assert values_written(figure.axes[0]) == ["−10.00"] * 3
    assert values_written(figure.axes[1]) == ["1.00"] * 3
    assert "0:0.1" in figure.axes[2].get_ylabel()
    wider = sensor([with_electrodes()], window="0:0.2")
    assert values_written(wider.axes[0]) == ["−7.50"] * 3
    # R² of a line through two straight parts, one of half the slope of the other.
    parts = np.concatenate([np.linspace(4, 3, 1001), np.linspace(3, 2.5, 1001)[1:]])
    straight = np.corrcoef(np.linspace(0, 1, 2001), parts)[0, 1] ** 2
    assert values_written(wider.axes[1]) == [f"{straight:.2f}"] * 3


@pytest.mark.parametrize(
    ("kind", "window", "message"),
    [
        ("sensor", "0.3:0.1", "does not ascend"),
        ("sensor", "wide", "is not a window of strain"),
        ("auxetic", "0:0.1", "is not an option of auxetic"),
    ],
)
def test_a_bad_window_is_refused(tmp_path, kind, window, message):
    with_electrodes().to_netcdf(tmp_path / "cube.nc")
    command = ["map", kind, str(tmp_path / "cube.nc"), "--window", window]
    result = CliRunner().invoke(main, [*command, "-o", str(tmp_path / "map.png")])
    assert result.exit_code == 2
    assert message in result.output
