"""Case files: one netCDF file a case, there whole or not at all."""

import json
from dataclasses import asdict
from pathlib import Path

import xarray as xr

from knitlab.mechanics.tension import TensileTest
from knitlab.sweep.files import written_whole
from knitlab.sweep.measurement import measured
from knitlab.sweep.plan import Case
from knitlab.sweep.provenance import provenance
from knitlab.sweep.registry import Status, encoding


def case_path(results: Path, case_id: str) -> Path:
    """Where the file of a case lies within a results folder."""
    return results / "cases" / f"{case_id}.nc"


def write_case(results: Path, case: Case, test: TensileTest, wall_seconds: float) -> Status:
    """Measure a finished test, write its case file and return its status."""
    dataset = measured(case, test)
    dataset.attrs |= provenance() | {
        "title": f"knitlab case {case.case_id}",
        "parameters": json.dumps(asdict(case)),
        "reason": failure_reason(case, test),
        "batch_wall_seconds": wall_seconds,
    }
    with written_whole(case_path(results, case.case_id)) as temporary:
        dataset.to_netcdf(temporary, encoding=encoding(dataset))
    return Status(int(dataset["status"]))


def read_case(results: Path, case_id: str) -> xr.Dataset:
    """Read a case file into memory."""
    with xr.open_dataset(case_path(results, case_id), engine="netcdf4") as dataset:
        return dataset.load()


def failure_reason(case: Case, test: TensileTest) -> str:
    """Why a test did not reach its last strain; empty if it did."""
    last = test.states[-1]
    if last.converged:
        return ""
    strain = case.applied_strain[len(test.states) - 1]
    return (
        f"no equilibrium at applied strain {strain:g}: {last.residual:.1e} N left after"
        f" {last.iterations} Newton steps ({last.outcome.name.replace('_', ' ')})"
    )
