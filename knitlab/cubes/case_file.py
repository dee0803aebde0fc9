"""Case files: a netCDF file for each case, which ends with its checksum. Needs no JAX."""

import math
import os
import shutil
from collections.abc import Collection
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import netCDF4
import numpy as np
import xarray as xr

from knitlab.io.atomic_write import atomic_write
from knitlab.io.checksum import append_checksum, has_checksum
from knitlab.io.errors import invalid
from knitlab.io.names import inside
from knitlab.io.provenance import stored_model
from knitlab.observables.schema import INTEGERS, MISSING, encoding

if TYPE_CHECKING:  # imports JAX
    from knitlab.model.fabric import Configuration

NETCDF = ".nc"
LENGTH_FACTOR = "mm_of_cloth_per_mm_of_network"  # attribute of a case with shapes in mm of cloth
CLASSIC = b"CDF"
FEW = 5
"""Variables up to which netCDF4 reads a file faster than SciPy, which reads all of them at once."""
SHAPES = (
    *("position", "length_x", "length_y", "length_shear"),
    *("snapshot_position", "snapshot_length_x", "snapshot_length_y"),
)


UNREADABLE = (OSError, RuntimeError, ValueError, TypeError, AttributeError, LookupError)
"""What netCDF and xarray raise of a file that they cannot read."""


def case_path(results: Path, case_id: str) -> Path:
    """Path of the file of a case in a results folder."""
    return inside(results / "cases", f"{case_id}{NETCDF}")


def stored_cases(results: Path) -> dict[str, float]:
    """The cases that have a file in a results folder, with the time of its last change [s]."""
    changed: dict[str, float] = {}
    with suppress(FileNotFoundError, NotADirectoryError), os.scandir(results / "cases") as files:
        for file in files:
            if file.name.endswith(NETCDF):
                about = file.stat()
                # A file that is moved here changes, but was not modified.
                changed[file.name.removesuffix(NETCDF)] = max(about.st_mtime, about.st_ctime)
    return changed


def write_case_file(results: Path, case_id: str, dataset: xr.Dataset) -> None:
    """Write a case file, which ends with its checksum, atomically; CannotWrite if that fails."""
    # The classic format: in HDF5 each of some fifty small variables costs more than its numbers.
    stored = encoding(dataset, compressed=False)
    contents = bytes(dataset.to_netcdf(engine="scipy", format="NETCDF3_64BIT", encoding=stored))
    with atomic_write(case_path(results, case_id)) as temporary:
        temporary.write_bytes(contents)
        append_checksum(temporary)


def copy_case_file(source: Path, target: Path, case_id: str) -> None:
    """Copy an undamaged case file into another results folder; CannotWrite if that fails."""
    with atomic_write(case_path(target, case_id)) as temporary:
        shutil.copyfile(case_path(source, case_id), temporary)


def is_undamaged(results: Path, case_id: str) -> bool:
    """Whether a case file is as it was written, and holds the case that it is named after."""
    path = case_path(results, case_id)
    try:
        # To open the file would take far longer; another case has no such identifier in it.
        return has_checksum(path) and case_id.encode() in path.read_bytes()
    except (OSError, ValueError):
        return False


def read_code(results: Path, case_id: str) -> str:
    """The model that computed a case; empty if the file is not a case file."""
    try:
        return stored_model(str(read_values(case_path(results, case_id), ["code"])["code"]))
    except UNREADABLE:
        return ""


def read_values(path: Path, names: Collection[str]) -> dict[str, Any]:
    """Values of those variables that a case file has, ten times faster than with xarray."""
    stored: dict[str, Any] = {}
    contents = path.read_bytes()
    if len(names) > FEW and contents.startswith(CLASSIC):
        from scipy.io import netcdf_file  # slow to import

        with netcdf_file(BytesIO(contents)) as file:
            stored = {name: file.variables[name].data for name in names if name in file.variables}
    else:
        with netCDF4.Dataset(path.name, memory=contents) as file:
            file.set_auto_maskandscale(False)
            stored = {name: file[name][...] for name in names if name in file.variables}
    return {name: _plain(name, np.asarray(values)) for name, values in stored.items()}


def _plain(name: str, values: np.ndarray) -> Any:
    """Stored values as numbers of this machine, or as text."""
    if values.dtype.kind == "S":  # of characters
        rows = values.reshape(math.prod(values.shape[:-1]), -1)
        texts = np.array([row.tobytes().decode().rstrip("\0") for row in rows])
        return texts.reshape(values.shape[:-1]) if values.ndim > 1 else texts.item()
    if name in INTEGERS:
        return np.where(values == MISSING, np.nan, values)
    return values.astype(values.dtype.newbyteorder("=")) if values.ndim else values.item()


def read_case(results: Path, case_id: str) -> xr.Dataset:
    """Read a case file into memory; InputError if it is not as it was written."""
    path = case_path(results, case_id)
    if not is_undamaged(results, case_id):
        message = "is damaged, or not the case that it is named after; run its workflow again"
        raise invalid(str(path), message)
    with xr.open_dataset(path, engine="netcdf4") as dataset:
        return dataset.load()


def in_cloth(case: xr.Dataset, design: xr.Dataset) -> xr.Dataset:
    """A case with its shapes in mm of cloth, by the sizes of its unit cell in the design of a cube.

    All directions are scaled alike, so that folds keep their angles, by the root of the ratio of
    areas. A design without sizes in cloth, such as a pure stripe, keeps those of its network.
    """
    factor = length_factor(design)
    if LENGTH_FACTOR in case.attrs or factor is None:
        return case
    with xr.set_options(keep_attrs=True):
        scaled = {name: factor * case[name] for name in SHAPES if name in case}
    return case.assign(scaled).assign_attrs({LENGTH_FACTOR: factor})


def length_factor(design: xr.Dataset) -> float | None:
    """Millimetres of cloth per millimetre of the network; None if a design of a cube has none."""
    names = ("knit_cell_x", "knit_cell_y", "relaxed_cell_x", "relaxed_cell_y")
    if not set(names) <= set(design):
        return None
    cloth_x, cloth_y, network_x, network_y = (float(design[name]) for name in names)
    areas = cloth_x * cloth_y / (network_x * network_y)
    return math.sqrt(areas) if 0 < areas < math.inf else None


def length_unit(case: xr.Dataset) -> str:
    """The unit of the shapes of a case, as labels name it."""
    return "mm" if LENGTH_FACTOR in case.attrs else "mm of network"


def configurations(case: xr.Dataset) -> "Configuration":
    """Configurations of a case along a leading axis of strain; lengths of open samples are 0."""
    from knitlab.model.fabric import Configuration

    positions = case["position"].transpose("applied_strain", "node_y", "node_x", "component").values
    none = np.zeros(len(positions))
    names = ["length_x", "length_y", *(["length_shear"] if "length_shear" in case else [])]
    lengths = [case[name].values if name in case else none for name in names]
    return Configuration(positions, np.stack(lengths, axis=-1))


def network_configurations(case: xr.Dataset) -> "Configuration":
    """The same in mm of the network, in which energies are, whatever the lengths of the case."""
    from knitlab.model.fabric import Configuration

    factor, states = cloth_per_network(case), configurations(case)
    return Configuration(states.positions / factor, states.lengths / factor)


def cloth_per_network(case: xr.Dataset) -> float:
    """Millimetres of cloth per millimetre of the network, 1 where the gauge says nothing."""
    return float(case.attrs.get(LENGTH_FACTOR, 1.0))
