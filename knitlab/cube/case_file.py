"""Case files: for each case a netCDF file and its checksum. Needs no JAX."""

from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING

import netCDF4
import numpy as np

from knitlab.cube.classic_file import classic_bytes
from knitlab.io.atomic_write import write_atomically
from knitlab.io.fingerprint import bytes_digest, file_digest

if TYPE_CHECKING:
    import xarray as xr

    from knitlab.fabric.configuration import Configuration


class StoredCase(Enum):
    """Whether a results folder has the file of a case."""

    nothing = "pending"
    sound = "sound"
    damaged = "damaged"


def case_path(results: Path, case_id: str) -> Path:
    """Path of the file of a case in a results folder."""
    return results / "cases" / f"{case_id}.nc"


def checksum_path(results: Path, case_id: str) -> Path:
    """Path of its checksum, in the format of ``sha256sum --check``."""
    return results / "cases" / f"{case_id}.sha256"


def write_case_file(results: Path, case_id: str, dataset: "xr.Dataset") -> None:
    """Write a case file and its checksum, each atomically.

    The checksum is written first, so that a case file without one is damaged.

    Raises:
        CannotWrite: if they cannot be written.
    """
    path, contents = case_path(results, case_id), classic_bytes(dataset)
    checksum = f"{bytes_digest(contents)}  {path.name}\n"
    write_atomically(checksum_path(results, case_id), checksum.encode())
    write_atomically(path, contents)


def check_case_file(results: Path, case_id: str) -> StoredCase:
    """Compare a case file with its checksum."""
    try:
        stated = checksum_path(results, case_id).read_bytes().split(b" ")[0]
        found = file_digest(case_path(results, case_id))
    except FileNotFoundError:
        exists = case_path(results, case_id).exists()
        return StoredCase.damaged if exists else StoredCase.nothing
    except OSError:
        return StoredCase.damaged
    return StoredCase.sound if found.encode() == stated else StoredCase.damaged


def read_code(results: Path, case_id: str) -> str | None:
    """Fingerprint of the code that computed a case; None if the file is not a case file."""
    try:
        with netCDF4.Dataset(case_path(results, case_id)) as dataset:
            return str(dataset["code"][...])
    except (OSError, IndexError):
        return None


def configurations(case: "xr.Dataset") -> "Configuration":
    """Configurations of a case at every strain, along a leading axis.

    The lengths of open samples, which have none, are 0.
    """
    from knitlab.fabric.configuration import Configuration

    positions = case["position"].transpose("applied_strain", "node_y", "node_x", "component").values
    none = np.zeros(len(positions))
    lengths = [case[name].values if name in case else none for name in ("length_x", "length_y")]
    return Configuration(positions, np.stack(lengths, axis=-1))


def read_case(results: Path, case_id: str) -> "xr.Dataset":
    """Read a case file into memory."""
    import xarray as xr

    with xr.open_dataset(case_path(results, case_id), engine="netcdf4") as dataset:
        return dataset.load()
