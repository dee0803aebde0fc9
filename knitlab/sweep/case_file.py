"""Case files: where one netCDF file a case lies, and how it is read. Needs no JAX."""

from pathlib import Path

import xarray as xr


def case_path(results: Path, case_id: str) -> Path:
    """Where the file of a case lies within a results folder."""
    return results / "cases" / f"{case_id}.nc"


def read_case(results: Path, case_id: str) -> xr.Dataset:
    """Read a case file into memory."""
    with xr.open_dataset(case_path(results, case_id), engine="netcdf4") as dataset:
        return dataset.load()
