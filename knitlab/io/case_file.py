"""Case files: one netCDF file a case with its checksum beside it. Needs no JAX."""

from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING

import netCDF4
import numpy as np

from knitlab.io.atomic_write import atomic_write
from knitlab.io.fingerprint import file_digest
from knitlab.io.schema import encoding

if TYPE_CHECKING:
    import xarray as xr

    from knitlab.model.configuration import Configuration


class StoredCase(Enum):
    """What there is of a case in a results folder."""

    nothing = "pending"
    sound = "sound"
    damaged = "damaged"


def case_path(results: Path, case_id: str) -> Path:
    """Where the file of a case lies within a results folder."""
    return results / "cases" / f"{case_id}.nc"


def checksum_path(results: Path, case_id: str) -> Path:
    """Where its checksum lies, as ``sha256sum --check`` reads it."""
    return results / "cases" / f"{case_id}.sha256"


def write_case_file(results: Path, case_id: str, dataset: "xr.Dataset") -> None:
    """Write a case file and its checksum, each whole.

    The checksum comes first, so that a case is either whole or not there.

    Raises:
        CannotWrite: if they cannot be written.
    """
    path = case_path(results, case_id)
    with atomic_write(path) as temporary:
        dataset.to_netcdf(temporary, encoding=encoding(dataset))
        with atomic_write(checksum_path(results, case_id)) as checksum:
            checksum.write_text(f"{file_digest(temporary)}  {path.name}\n")


def kept(results: Path, case_id: str) -> StoredCase:
    """Whether a case file is there and has the contents that were written."""
    try:
        stated = checksum_path(results, case_id).read_bytes().split(b" ")[0]
        found = file_digest(case_path(results, case_id))
    except FileNotFoundError:
        there = case_path(results, case_id).exists()
        return StoredCase.damaged if there else StoredCase.nothing
    except OSError:
        return StoredCase.damaged
    return StoredCase.sound if found.encode() == stated else StoredCase.damaged


def read_code(results: Path, case_id: str) -> str | None:
    """Fingerprint of the code that computed a case; None if the file is no case."""
    try:
        with netCDF4.Dataset(case_path(results, case_id)) as dataset:
            return str(dataset["code"][...])
    except (OSError, IndexError):
        return None


def configurations(case: "xr.Dataset") -> "Configuration":
    """Configurations of a case at every strain, along a leading axis.

    The lengths, which open samples do not have, are 0 there.
    """
    from knitlab.model.configuration import Configuration

    positions = case["position"].transpose("applied_strain", "node_y", "node_x", "component").values
    none = np.zeros(len(positions))
    lengths = [case[name].values if name in case else none for name in ("length_x", "length_y")]
    return Configuration(positions, np.stack(lengths, axis=-1))


def read_case(results: Path, case_id: str) -> "xr.Dataset":
    """Read a case file into memory."""
    import xarray as xr

    with xr.open_dataset(case_path(results, case_id), engine="netcdf4") as dataset:
        return dataset.load()
