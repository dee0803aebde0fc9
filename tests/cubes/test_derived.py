"""Variables that follow from others: force over width, stiffness, energy, and validity."""

import re

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner

import knitlab as kl
from knitlab.cli import main
from knitlab.cubes.cube_file import open_cube, read_cube, write_cube
from knitlab.cubes.derived import RELIABLE_WAVES, TRACED_PERIODS, with_derived
from knitlab.cubes.trust import MARKS
from knitlab.figures.design_map import LAST
from knitlab.figures.kinds.auxetic import auxetic
from knitlab.io.shipped import shipped
from knitlab.observables.wavelength import PERIODIC_CELLS, wave_of

REFERENCE = shipped("params").parent / "results" / "reference"
STRAIN = np.linspace(0, 0.4, 9)
STIFFNESS, CELL, CELLS = 3.0, 12.0, 5


def linear_cube(crossing_at=None):
    """A cube of one design whose force grows linearly, with its lowest ratio at 0.1."""
    dims, along = ("n_stripe", "n_subunit"), ("n_stripe", "n_subunit", "applied_strain")
    crossings = np.zeros((1, 1, len(STRAIN)))
    if crossing_at is not None:
        crossings[0, 0, crossing_at] = 7
    return xr.Dataset(
        {
            "status": (dims, [[1]]),
            "case_id": (dims, [["a"]]),
            "periods": (dims, [[2]]),
            "knit_cell_x": (dims, [[CELL]]),
            "unit_cells_x": (dims, [[CELLS]]),
            "reaction_force": (along, (STIFFNESS * CELL * CELLS * STRAIN)[None, None]),
            "self_intersections": (along, crossings),
            "poisson_ratio_min": (dims, [[-0.4]]),
            "applied_strain_at_min": (dims, [[0.1]]),
        },
        {"n_stripe": [4], "n_subunit": [16], "applied_strain": STRAIN},
    )


def test_force_stiffness_and_energy_of_a_linear_fabric_are_in_closed_form():
    one = with_derived(linear_cube()).squeeze()
    np.testing.assert_allclose(one["force_per_width"], STIFFNESS * STRAIN)
    np.testing.assert_allclose(one["tangent_stiffness"], STIFFNESS)
    np.testing.assert_allclose(one["stretch_energy"], STIFFNESS * STRAIN**2 / 2)
    assert one["stretch_energy"].attrs["units"] == "N/mm"


@pytest.mark.parametrize(("crossing_at", "expected"), [(None, 0), (2, 7), (3, 0)])
def test_intersections_count_where_the_ratio_is_lowest(crossing_at, expected):
    assert STRAIN[2] == pytest.approx(0.1)
    cube = with_derived(linear_cube(crossing_at))
    assert cube["intersections_at_min"].item() == expected
    texts = [text.get_text() for text in auxetic([cube]).axes[0].texts]
    assert any(MARKS["intersecting"].sign in text for text in texts) == (expected > 0)


def test_a_wavelength_comes_with_the_number_of_its_waves():
    """Known sinusoids: 3 waves give their length to 4 %, 2 do not."""
    assert TRACED_PERIODS == PERIODIC_CELLS
    worst = {}
    for waves in (2, 3):
        along = np.linspace(0, waves, 200)
        lines = [(along, np.sin(2 * np.pi * along + phase)) for phase in np.linspace(0, 6, 13)]
        found = [wave_of(np.transpose(line), waves).wavelength for line in lines]
        worst[waves] = np.abs(np.array(found) - 1).max()
    assert worst[RELIABLE_WAVES] < 0.04 < worst[RELIABLE_WAVES - 1]
    # As many waves as unit cells; periodic fabric is traced over several of its periods.
    cube = linear_cube().assign(wavelength_x=(("n_stripe", "n_subunit"), [[11.0]]))
    assert "waves_x" not in with_derived(cube), "nothing says whether it is periodic"
    assert with_derived(cube.assign_attrs(model_boundary="clamped"))["waves_x"].item() == CELLS
    periodic = with_derived(cube.assign_attrs(model_boundary="periodic"))
    assert periodic["waves_x"].item() == TRACED_PERIODS * CELLS
    swept = cube.expand_dims(boundary=["clamped", "periodic"])
    np.testing.assert_array_equal(
        with_derived(swept)["waves_x"].squeeze(), [CELLS, TRACED_PERIODS * CELLS]
    )


def test_wavelengths_from_two_waves_are_hollow():
    cube = open_cube(REFERENCE / "paper")
    axes = kl.plot.wavelength(cube).axes
    for direction, lines in (("x", axes[2]), ("y", axes[5])):
        hollow = [line for line in lines.get_lines() if line.get_markerfacecolor() == "white"]
        marked = {(x, y) for line in hollow for x, y in zip(*line.get_data(), strict=True)}
        wavelength = cube[f"knit_wavelength_{direction}"].where(cube[f"unit_cells_{direction}"] < 3)
        few = wavelength.to_series().dropna()
        assert marked == {(n, length) for (_, n), length in few.items()} != set()


def test_a_lowest_ratio_at_the_last_strain_is_marked():
    cube = linear_cube()
    cube["applied_strain_at_min"][:] = STRAIN[-1]
    (axes, *_) = auxetic([with_derived(cube)]).axes
    assert any(LAST[0] in text.get_text() for text in axes.texts)


def test_energy_and_force_of_a_kept_cube_agree_with_its_elastic_energy():
    # What the force does is stored in springs, folds and walls, but for round-off of the strains.
    cube = open_cube(REFERENCE / "periodic").sel(n_stripe=4, n_subunit=16)
    stored = sum(cube[f"energy_{name}"] for name in ("stretch", "fold", "wall"))
    length = cube["relaxed_cell_y"] * cube["unit_cells_y"]
    width = cube["knit_cell_x"] * cube["unit_cells_x"]
    work = cube["stretch_energy"] * width * length
    np.testing.assert_allclose(work, stored - stored[0], rtol=0.02, atol=0.01 * float(stored.max()))


def test_no_file_has_them(tmp_path):
    cube = read_cube(REFERENCE / "periodic")
    assert "force_per_width" not in cube
    write_cube(cube, tmp_path / "cube.nc")
    assert "force_per_width" in open_cube(tmp_path)
    assert "force_per_width" not in read_cube(tmp_path)
    np.testing.assert_array_equal(
        kl.query(tmp_path, applied_strain=0.15)["force_per_width"],
        xr.load_dataset(tmp_path / "cube.nc").knitlab.query(applied_strain=0.15)["force_per_width"],
    )


def test_a_default_table_has_at_most_eight_columns_and_those_of_its_condition():
    def columns(*words):
        done = CliRunner().invoke(main, ["query", *words])
        assert done.exit_code == 0, done.output
        return re.sub(r" \[[^]]*\]", "", done.stdout.splitlines()[0]).split()

    for name in ("periodic", "preview", "paper", "sensor", "stripes", "relaxation"):
        assert len(set(columns(str(REFERENCE / name))) - {"marks"}) <= 8
    path = str(REFERENCE / "periodic")
    assert "knit_wavelength_x" in columns(path, "--where", "knit_wavelength_x > 1")
    assert len(columns(path, "--columns", "all")) > 20
    names = columns(path, str(REFERENCE / "preview"), "--columns", "n_stripe,poisson_ratio_min")
    assert names == ["cube", "n_stripe", "poisson_ratio_min", "marks"]


def test_columns_and_sorting_take_expressions():
    cube = open_cube(REFERENCE / "periodic")
    asked = ["n_stripe", "10*force_per_width", "mean(poisson_ratio, 0.05:0.25) - poisson_ratio"]
    table = cube.knitlab.query(sort="-10*force_per_width", columns=asked, applied_strain=0.15)
    plain = cube.knitlab.query(sort="-force_per_width", applied_strain=0.15)
    np.testing.assert_allclose(table["10*force_per_width"], 10 * plain["force_per_width"])
    assert list(table.columns) == asked
    for wrong, problem in (("2*3", "one value for all"), ("foo/2", "no column 'foo'")):
        with pytest.raises(kl.InputError, match=problem):
            cube.knitlab.query(columns=[wrong])


@pytest.mark.parametrize("words", ["find --target", "query --columns"])
def test_strains_in_percent_are_refused(words):
    command, option = words.split()
    asked = "poisson_ratio = -0.3 @ 5:25" if command == "find" else "mean(poisson_ratio, 5:25)"
    done = CliRunner().invoke(main, [command, str(REFERENCE / "periodic"), option, asked])
    assert done.exit_code == 2
    assert "5:25 is beyond 0.45, the last of all cubes; strains are fractions" in done.output


def test_find_shows_which_designs_pass_through_themselves():
    asked = {"targets": "poisson_ratio_min < 0"}
    cube = xr.load_dataset(REFERENCE / "periodic" / "cube.nc")
    assert "intersections_at_min" not in kl.find(cube, **asked).table
    passing = cube.assign(self_intersections=cube["self_intersections"] + 1)
    assert (kl.find(passing, **asked).table["intersections_at_min"] == 1).all()


@pytest.mark.parametrize(("snaps_at", "marked"), [(1, True), (2, True), (3, False)])
def test_a_snap_up_to_the_lowest_ratio_is_marked(snaps_at, marked):
    cube = linear_cube(2)
    snapped = xr.zeros_like(cube["reaction_force"])
    snapped[..., snaps_at] = 1
    (axes, *_) = auxetic([with_derived(cube.assign(snapped=snapped))]).axes
    assert any(MARKS["snapped"].sign in text.get_text() for text in axes.texts) == marked
