"""The case that a case file, a plan or a list of failures records."""

from typing import Any

import xarray as xr
from pydantic import ValidationError

from knitlab.cubes.cube_file import cube_name, parameters_of
from knitlab.io.errors import invalid
from knitlab.solvers.case import Case, case_of


def recorded_case(case_file: xr.Dataset) -> Case:
    """The case of a case file or a test; InputError if its parameters are not those of a case."""
    return case_of_record(parameters_of(case_file), cube_name(case_file) or "test")


def case_of_record(record: dict[str, Any], where: str) -> Case:
    """The case that a record at a place describes; InputError if it cannot be read."""
    try:
        return case_of(record)
    except (ValidationError, KeyError, TypeError) as error:
        raise invalid(where, "was recorded by another version of knitlab; run it again") from error
