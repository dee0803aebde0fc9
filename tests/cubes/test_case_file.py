"""Case files: what is read from them is what was written."""

import numpy as np
import pytest
import xarray as xr

from knitlab.cubes.case_file import case_path, read_case, read_code, read_values, write_case_file


@pytest.fixture
def dataset():
    return xr.Dataset(
        {
            "status": ((), np.int8(1), {"flag_values": [0, 1], "flag_meanings": "pending ok"}),
            "iterations": ("applied_strain", [3.0, np.nan, 5.0], {"units": "1"}),
            "poisson_ratio": ("applied_strain", [-0.5, np.nan, -0.25], {"units": "1"}),
            "position": (("applied_strain", "component"), np.arange(9.0).reshape(3, 3) / 7),
            "case_id": ((), "4-16-é"),
            "code": ((), "0123456789ab"),
            "empty": ((), ""),
        },
        {
            "applied_strain": [0.0, 0.03, 0.06],
            "component": ["x", "y", "zz"],
            "n_stripe": 4,
            "k_t_factor": 1.1,
        },
        {"reason": "", "title": "größer", "batch_wall_seconds": 1.5},
    )


def test_xarray_reads_what_was_written(dataset, tmp_path):
    write_case_file(tmp_path, "4-16-é", dataset)
    back = read_case(tmp_path, "4-16-é")
    for name in dataset.variables:
        np.testing.assert_array_equal(back[name], dataset[name], err_msg=str(name))
        assert back[name].dims == dataset[name].dims
        for key, value in dataset[name].attrs.items():
            np.testing.assert_array_equal(back[name].attrs[key], value)
    assert back.attrs == dataset.attrs
    assert back["status"].dtype == np.int8
    assert read_code(tmp_path, "4-16-é") == "model 1"


def test_stored_values_are_read_without_xarray(dataset, tmp_path):
    write_case_file(tmp_path, "4-16-é", dataset)
    path = case_path(tmp_path, "4-16-é")
    assert path.read_bytes().startswith(b"CDF\x02")
    values = read_values(path, [*dataset.variables, "absent"])
    assert values.keys() == set(dataset.variables)
    for name in values:
        np.testing.assert_array_equal(values[name], dataset[name].values, err_msg=name)


def test_the_same_dataset_gives_the_same_bytes(dataset, tmp_path):
    contents = []
    for name in ("one", "other"):
        write_case_file(tmp_path / name, "4-16-é", dataset.copy(deep=True))
        contents.append(case_path(tmp_path / name, "4-16-é").read_bytes())
    assert contents[0] == contents[1]


def test_a_case_file_in_the_format_of_hdf5_is_read_too(dataset, tmp_path):
    case_path(tmp_path, "4-16-é").parent.mkdir()
    dataset.to_netcdf(case_path(tmp_path, "4-16-é"), engine="netcdf4")
    assert read_code(tmp_path, "4-16-é") == "model 1"
