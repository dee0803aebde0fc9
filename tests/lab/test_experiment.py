import json
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner

from knitlab.cli import main
from knitlab.cubes.cube_file import open_cube
from knitlab.lab.experiment import import_records
from knitlab.observables.capacitance.sensor import mean_slope
from knitlab.observables.schema import COORDINATES, VARIABLES
from tests.figures.test_sensor import with_electrodes
from tests.lab.recorded import LENGTH, NU, PEAK, STIFFNESS, TEST, WIDTH, Laboratory, positions
from tests.refusals import refused
from workflows.laboratory.make_synthetic import tracked

KINDS = ("markers", "tensile", "capacitance")


@pytest.fixture(scope="module")
def cube(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sheet")
    path = Laboratory(folder).write()
    for kind in KINDS:
        imported = import_records(kind, path, folder)
    return open_cube(imported.path)


def test_an_experiment_has_the_names_dims_and_units_of_a_simulation(cube):
    assert cube["source"].item() == "experiment"
    for name in cube.data_vars:
        assert cube[name].dims == ("n_stripe", "n_subunit", *VARIABLES[name].dims)
        assert cube[name].attrs["units"] == VARIABLES[name].units
    for name in cube.coords:
        assert cube[name].attrs["units"] == COORDINATES[name].units
    np.testing.assert_allclose(cube["applied_strain"], np.arange(7) * 0.05)


def test_measured_values_are_in_the_units_of_the_cube(cube):
    only = cube.squeeze()
    strain = only["applied_strain"].values
    np.testing.assert_allclose(only["mean_strain_yy"], strain, atol=1e-9)
    np.testing.assert_allclose(only["mean_strain_xx"], -NU * strain, atol=1e-9)
    np.testing.assert_allclose(only["poisson_ratio"][1:], NU, atol=1e-8)
    np.testing.assert_allclose(only["reaction_force"], STIFFNESS * strain, atol=1e-9)
    np.testing.assert_allclose(only["force_per_width"], STIFFNESS * strain / WIDTH, atol=1e-9)
    np.testing.assert_allclose(only["capacitance"], 5 - 4 * strain, atol=1e-9)
    np.testing.assert_allclose(only["capacitance_ratio"], 1 - 0.8 * strain, atol=1e-9)
    np.testing.assert_allclose(only["capacitance_unloading"], 5 - 4 * strain, atol=1e-9)
    assert only["sensitivity"] == pytest.approx(4.0)
    assert only["sensitivity"] == pytest.approx(mean_slope(strain, 5 - 4 * strain))
    assert only["linearity"] == pytest.approx(1.0)
    assert only["gauge_factor"] == pytest.approx(-0.8)
    assert only["hysteresis"] == pytest.approx(0.0, abs=1e-9)
    assert only["relaxed_cell_y"] == pytest.approx(LENGTH / 4)


def test_imports_in_any_order_and_twice_make_one_cube(tmp_path, cube):
    path = Laboratory(tmp_path).write()
    for kind in (*reversed(KINDS), "tensile"):
        last = import_records(kind, path, tmp_path)
    other = open_cube(last.path)
    xr.testing.assert_allclose(other[list(cube.data_vars)], cube)
    imports = json.loads(other.attrs["imports"])
    assert set(imports) == set(KINDS)
    assert set(imports["markers"]["files"]) == {"markers.npy", "tensile.csv"}


@pytest.mark.parametrize(
    "imports", [5, "", '{"tensile": null}', '{"tensile": {"variables": ["of_no_import"]}}']
)
def test_a_damaged_list_of_imports_is_refused(tmp_path, imports):
    path = Laboratory(tmp_path).write()
    file = import_records("tensile", path, tmp_path).path
    xr.load_dataset(file).assign_attrs(imports=imports).to_netcdf(file)
    with refused("import all records again"):
        import_records("markers", path, tmp_path)


@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_a_trigger_synchronises_as_well_as_a_given_offset(tmp_path, cube, noise):
    """It rises where it passes the middle of its range."""
    laboratory = Laboratory(tmp_path, delay=-7.25)
    description = laboratory.description()
    description["tensile"]["trigger"] = {"column": "trigger"}
    del description["capacitance"]["starts"]
    description["capacitance"]["trigger"] = {"column": "TRIG"}
    path = laboratory.write(description)
    log = laboratory.meter()
    log["TRIG"] += np.random.default_rng(0).uniform(-noise, noise, len(log))
    log.to_csv(tmp_path / "meter.csv", index=False)
    imported = import_records("capacitance", path, tmp_path)
    assert "-7.25 s" in imported.summary[1]
    # To within one record of either clock, 0.1 s at 1 % strain a second.
    np.testing.assert_allclose(imported.cube["capacitance"], cube["capacitance"], atol=4 * 0.0015)


def test_the_first_cycles_may_be_left_out(tmp_path):
    laboratory = Laboratory(tmp_path, test=replace(TEST, cycles=3))
    description = laboratory.description()
    description["protocol"]["skip_cycles"] = 2
    cube = import_records("tensile", laboratory.write(description), tmp_path).cube
    assert "cycle" not in cube.dims


@pytest.mark.slow
@pytest.mark.parametrize(("drift", "still"), [((5.0, 2.0), 0.0), ((0.4, 0.5), 0.5)])
def test_a_drifting_camera_changes_no_strain(tmp_path, drift, still):
    laboratory = Laboratory(tmp_path)
    path = laboratory.write()
    strain = TEST.strain(np.arange(len(laboratory.tracks())) / laboratory.frame_rate, PEAK)
    corners = positions(strain, still) + (strain / PEAK)[:, None, None, None] * np.array(drift)
    tracks = tracked(corners, laboratory.camera, np.arange(20), laboratory.random)
    # A marker that was lost and is written as the corner of the picture.
    tracks[50:55, 3] = 0.0
    np.save(tmp_path / "markers.npy", tracks)
    imported = import_records("markers", path, tmp_path)
    assert "turned by 0.0°" in imported.summary[0]
    np.testing.assert_allclose(imported.cube["poisson_ratio"].squeeze()[1:], NU, atol=1e-3)


@pytest.mark.slow
def test_cycles_are_separated_along_a_dimension(tmp_path):
    path = Laboratory(tmp_path, test=replace(TEST, cycles=3)).write()
    for kind in KINDS:
        imported = import_records(kind, path, tmp_path)
    assert "3 cycles of the machine" in imported.summary
    cube = open_cube(imported.path)
    assert cube["status"].dims == ("n_stripe", "n_subunit", "cycle")
    np.testing.assert_array_equal(cube["cycle"], [1, 2, 3])
    strain = cube["applied_strain"].values
    for name, values in (("mean_strain_yy", strain), ("capacitance", 5 - 4 * strain)):
        np.testing.assert_allclose(cube[name].squeeze(), np.tile(values, (3, 1)), atol=1e-8)
    words = ["query", str(imported.path), "--columns", "cycle,source,sensitivity"]
    said = CliRunner().invoke(main, words)
    assert [line.split() for line in said.stdout.splitlines()[1:]] == [
        [str(cycle), "experiment", "4"] for cycle in (1, 2, 3)
    ]


def test_markers_alone_need_no_machine(tmp_path):
    laboratory = Laboratory(tmp_path, test=replace(TEST, rest=0.0))
    description = laboratory.description()
    del description["tensile"], description["capacitance"]
    table = description["markers"]
    del table["frame_rate"], table["starts"]
    table["strain_per_frame"] = TEST.strain_rate / laboratory.frame_rate
    path = laboratory.write(description)
    tracks = np.load(tmp_path / "markers.npy")
    np.save(tmp_path / "markers.npy", tracks[: (round(PEAK / table["strain_per_frame"]) + 1)])
    imported = import_records("markers", path, tmp_path).cube.squeeze()
    np.testing.assert_allclose(imported["mean_strain_yy"], imported["applied_strain"], atol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_frames_without_markers_change_no_strain(tmp_path, seed):
    laboratory = Laboratory(tmp_path)
    path = laboratory.write()
    tracks = laboratory.tracks()
    peak = tracks[170].copy()
    lost = np.random.default_rng(seed).choice(np.arange(21, len(tracks)), 100, replace=False)
    tracks[lost] = np.nan
    tracks[170] = peak
    # From strain 0.07 to 0.23, too far to resample across.
    tracks[20 + 35 : 20 + 115] = np.nan
    np.save(tmp_path / "markers.npy", tracks)
    imported = import_records("markers", path, tmp_path)
    gone = np.isnan(tracks).all(axis=(1, 2)).sum()
    assert f"{gone} of {len(tracks)} frames show no marker" in imported.summary
    cube = imported.cube.squeeze()
    found, seen = cube["mean_strain_yy"].values, [0, 1, 5, 6]
    np.testing.assert_allclose(found[seen], cube["applied_strain"].values[seen], atol=1e-9)
    assert np.isnan(found[3])
    assert cube["markers_lost"].values[3] == 20


def test_an_experiment_of_markers_alone_is_queried_at_strains(tmp_path):
    laboratory = Laboratory(tmp_path)
    path = import_records("markers", laboratory.write(), tmp_path).path
    words = ["query", str(path), "--select", "applied_strain=0.1,0.2", "--format", "json"]
    rows = json.loads(CliRunner().invoke(main, words).stdout)
    assert [row["mean_strain_yy"] for row in rows] == pytest.approx([0.1, 0.2])


@pytest.fixture(scope="module")
def both(tmp_path_factory, cube):
    folder = tmp_path_factory.mktemp("both")
    with_electrodes().to_netcdf(folder / "simulated.nc")
    cube.to_netcdf(folder / "measured.nc")
    return folder / "simulated.nc", folder / "measured.nc"


def test_two_sources_are_queried_together(both):
    words = ["query", *map(str, both), "--select", "applied_strain=0.1", "--format", "json"]
    rows = json.loads(CliRunner().invoke(main, words).stdout)
    assert {row["source"] for row in rows} == {"simulation", "experiment"}
    (measured,) = [row for row in rows if row["source"] == "experiment"]
    assert measured["poisson_ratio"] == pytest.approx(NU)


def test_claims_are_judged_by_experiments_too(both):
    said = CliRunner().invoke(main, ["claims", str(both[1])])
    assert said.exit_code == 0, said.output
    assert "(4, 16)" in said.output
