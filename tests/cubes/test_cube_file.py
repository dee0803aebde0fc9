"""Files of cubes: attributes by the rules of CF, and dimensions in another order."""

from io import BytesIO

import netCDF4
import numpy as np
import pandas as pd
import pint
import pytest
import xarray as xr

import knitlab as kl
from knitlab.cubes.case_file import case_path, write_case_file
from knitlab.cubes.cube_file import read_cube, write_cube
from knitlab.observables.schema import described
from tests.cubes.artificial_cubes import synthetic_cube
from tests.export.meshes.synthetic import CASE_ID, PREVIEW, kept_file

REFERENCE = PREVIEW.parent


def pydantic_mistakes(path):
    """What of a netCDF file is against CF 1.11: sections 2.2 to 2.5, 3.1, 3.3, 3.5 and 5."""
    mistakes = []
    with netCDF4.Dataset(path) as file:
        mistakes += [file.Conventions] * (not file.Conventions.startswith("CF-1."))
        for name, variable in file.variables.items():
            stated = {key: variable.getncattr(key) for key in variable.ncattrs()}
            text = variable.dtype is str or variable.dtype.kind in "SU"
            is_coordinate = name in file.dimensions
            if not name.isidentifier() or "missing_value" in stated:
                mistakes.append(f"{name}: name or missing_value")
            if is_coordinate and "_FillValue" in stated:
                mistakes.append(f"{name}: a coordinate with _FillValue")
            if is_coordinate and not text and not np.all(np.diff(variable[:]) > 0):
                mistakes.append(f"{name}: not monotonic")
            if not stated.get("long_name") or not isinstance(stated.get("units"), str):
                mistakes.append(f"{name}: without name or units")
            pint.Unit(stated["units"])
            for key in {"_FillValue", "flag_values", "valid_range"} & set(stated):
                if np.asarray(stated[key]).dtype != variable.dtype:
                    mistakes.append(f"{name}: {key} of another type")
            if "flag_values" in stated:
                meanings = stated["flag_meanings"].split()
                if len(meanings) != len(set(stated["flag_values"])):
                    mistakes.append(f"{name}: flags")
                values = set(np.ma.compressed(variable[:]).tolist())
                mistakes += [f"{name}: no flag"] * (not values <= set(stated["flag_values"]))
            for other in stated.get("coordinates", "").split():
                if not set(file[other].dimensions) <= {*variable.dimensions}:
                    mistakes.append(f"{name}: coordinate {other}")
    return mistakes


@pytest.mark.parametrize("name", ["sensor", "sensor_layouts", "stripes", "even_auxetic", "graded"])
def test_a_cube_that_is_written_follows_cf(tmp_path, name):
    kept = read_cube(REFERENCE / name)
    write_cube(kept.copy(deep=True), tmp_path / "cube.nc")
    assert pydantic_mistakes(tmp_path / "cube.nc") == []
    xr.testing.assert_equal(read_cube(tmp_path), kept)


def test_a_case_file_that_is_written_follows_cf(tmp_path):
    write_case_file(tmp_path, CASE_ID, described(kept_file().copy(deep=True)))
    assert pydantic_mistakes(case_path(tmp_path, CASE_ID)) == []


def test_faults_of_another_writer_are_found(tmp_path):
    synthetic_cube().assign_attrs(Conventions="CF-1.11").to_netcdf(tmp_path / "cube.nc")
    assert pydantic_mistakes(tmp_path / "cube.nc") == [
        "applied_strain: a coordinate with _FillValue"
    ]


def in_another_order(cube):
    backwards = {dim: slice(None, None, -1) for dim in ("applied_strain", "n_stripe", "cell_x")}
    return cube.isel(backwards).transpose(..., "n_subunit", "n_stripe").transpose("cell_y", ...)


@pytest.mark.parametrize("lazily", [False, True])
def test_the_order_of_dimensions_and_strains_changes_nothing(tmp_path, lazily):
    cube = read_cube(PREVIEW)
    in_another_order(cube).to_netcdf(tmp_path / "cube.nc")
    read = read_cube(tmp_path, lazily=lazily)
    xr.testing.assert_identical(read, cube)
    assert {name: read[name].dims for name in read} == {name: cube[name].dims for name in cube}


def test_the_same_designs_are_found_and_drawn(tmp_path):
    in_another_order(read_cube(PREVIEW)).to_netcdf(tmp_path / "cube.nc")
    words = {
        "where": "min(poisson_ratio, 0.1:0.2) < -0.3",
        "sort": "spread(poisson_ratio, 0.05:0.25)",
    }
    both = [kl.query(folder, **words) for folder in (PREVIEW, tmp_path)]
    pd.testing.assert_frame_equal(*both)
    drawn = [kl.plot.auxetic(kl.open_cube(folder)) for folder in (PREVIEW, tmp_path)]
    images = [BytesIO(), BytesIO()]
    for figure, image in zip(drawn, images, strict=True):
        figure.savefig(image, format="raw")
    assert images[0].getvalue() == images[1].getvalue()


def test_swept_settings_keep_the_order_in_which_they_were_given(tmp_path):
    made = synthetic_cube().expand_dims(z_max=[6.0, 3.0], axis=2)
    made.transpose("z_max", ...).to_netcdf(tmp_path / "cube.nc")
    read = read_cube(tmp_path)
    assert read["status"].dims == ("n_stripe", "n_subunit", "z_max")
    assert read["z_max"].values.tolist() == [6, 3]
