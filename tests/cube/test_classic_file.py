"""Case files in the classic format: what xarray reads from them, and files of other formats."""

from tempfile import NamedTemporaryFile

import hypothesis.extra.numpy as npst
import netCDF4
import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

from knitlab.cube.case_file import case_path, read_case, read_code, write_case_file
from knitlab.cube.classic_file import classic_bytes, read_classic


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
    write_case_file(tmp_path, "4-16", dataset)
    back = read_case(tmp_path, "4-16")
    for name in dataset.variables:
        np.testing.assert_array_equal(back[name], dataset[name], err_msg=str(name))
        assert back[name].dims == dataset[name].dims
        for key, value in dataset[name].attrs.items():
            np.testing.assert_array_equal(back[name].attrs[key], value)
    assert back.attrs == dataset.attrs
    assert back["status"].dtype == np.int8
    assert read_code(tmp_path, "4-16") == "0123456789ab"


def test_the_library_of_netcdf_reads_the_same_values(dataset, tmp_path):
    write_case_file(tmp_path, "4-16", dataset)
    path = case_path(tmp_path, "4-16")
    ours = read_classic(path, {*dataset.variables})
    with netCDF4.Dataset(path) as stored:
        assert stored.data_model == "NETCDF3_64BIT_OFFSET"
        stored.set_auto_mask(False)
        for name, values in ours.items():
            np.testing.assert_array_equal(values, stored[name][...], err_msg=name)
    assert ours["iterations"].tolist() == [3, -1, 5]
    assert ours["poisson_ratio"].dtype.isnative


@given(
    st.dictionaries(
        st.sampled_from(["a", "bb", "ccc", "x" * 31]),
        npst.arrays(
            st.sampled_from([np.float64, np.float32, np.int32, np.int8]),
            npst.array_shapes(max_dims=3, max_side=4),
        ),
    )
)
def test_any_numbers_are_read_as_they_were_written(arrays):
    variables = {
        name: ([f"{name}_{k}" for k in range(values.ndim)], values)
        for name, values in arrays.items()
    }
    with NamedTemporaryFile(suffix=".nc") as file:
        file.write(classic_bytes(xr.Dataset(variables)))
        file.flush()
        with netCDF4.Dataset(file.name) as stored:
            stored.set_auto_mask(False)
            assert stored.variables.keys() == arrays.keys()
            for name, values in arrays.items():
                np.testing.assert_array_equal(stored.variables[name][...], values)


def test_the_same_dataset_gives_the_same_bytes(dataset):
    assert classic_bytes(dataset) == classic_bytes(dataset.copy(deep=True))


def test_a_file_of_another_format_is_left_to_others(dataset, tmp_path):
    dataset.to_netcdf(tmp_path / "case.nc", engine="netcdf4")
    assert read_classic(tmp_path / "case.nc", {"status"}) is None
