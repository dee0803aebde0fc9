"""The plates of the states of a case, and of the designs of a cube, as labelled datasets."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import xarray as xr

from knitlab.cubes.case_file import cloth_per_network
from knitlab.cubes.case_states import Described, dataset_of_states, stored_states
from knitlab.cubes.chosen_case import for_each_design
from knitlab.cubes.cube_file import cube_name, is_case, is_measured, model_options
from knitlab.cubes.recorded_case import recorded_case
from knitlab.io.errors import invalid
from knitlab.solvers.plate_condensation import Plate, PlateSolver, PlateStatus

DIRECTIONS = ("xx", "yy", "xy")  # x along the courses (weft), y along the wales (warp)
STATUS = "plate_status"
NOT_PERIODIC = (
    "has clamped samples, but a plate is the average of periodic fabric;"
    " simulate it with boundary = periodic"
)
VARIABLES: dict[str, Described] = {
    "membrane_stiffness": (("row", "column"), "N/mm", "A, membrane force by strain"),
    "coupling_stiffness": (("row", "column"), "N", "B, membrane force by curvature"),
    "bending_stiffness": (("row", "column"), "N mm", "D, moment by curvature"),
    "membrane_force": (("row",), "N/mm", "membrane force in the state"),
    "moment": (("row",), "N", "moment over width in the state, which keeps it flat"),
    "modulus_x": ((), "N/mm", "tangent modulus along the courses, kept flat"),
    "modulus_y": ((), "N/mm", "tangent modulus along the wales, kept flat"),
    "shear_modulus": ((), "N/mm", "tangent shear modulus, kept flat"),
    "poisson_ratio_x": ((), "1", "contraction along y over a small extension along x"),
    "poisson_ratio_y": ((), "1", "contraction along x over a small extension along y"),
    "length_x": ((), "mm", "length of the periodic cell along the courses"),
    "length_y": ((), "mm", "length of the periodic cell along the wales"),
    "length_shear": ((), "mm", "shift of the upper end of the periodic cell along the courses"),
    "reference_height": ((), "mm", "height of the reference plane, the mean of all nodes"),
}
"""Dimensions beside those of states, unit and meaning of the variables of a plate."""
SIDES = ("length_x", "length_y", "length_shear")


def case_plates(case_file: xr.Dataset, selections: Mapping[str, Any] = {}) -> xr.Dataset:
    """The plates of a periodic case at strains; unknown where layers touch."""
    case = recorded_case(case_file)
    if case.options.boundary != "periodic":
        raise invalid(case.label, NOT_PERIODIC)
    if case.friction.acts:
        raise invalid(case.label, "has friction, unlike plates; simulate with fold_friction = 0")
    _, fabric = case.assemble()
    solver = PlateSolver(case.mesh_shape, sheared="length_shear" in case_file)
    factor = cloth_per_network(case_file)
    indices, plates = list[int](), list[dict[str, Any]]()
    for state in stored_states(case_file, selections):
        plate, lengths = Plate.unknown(state.status), np.full(3, np.nan)
        if state.shape is not None:
            lengths = factor * np.asarray(state.shape.lengths)
            plate, _ = solver.response(fabric, state.shape)
        indices.append(state.index)
        plates.append(_numbers(plate, factor) | dict(zip(SIDES, [*lengths, 0.0], strict=False)))
    values = {name: [plate[name] for plate in plates] for name in VARIABLES}
    axes = {"row": list(DIRECTIONS), "column": list(DIRECTIONS)}
    found = dataset_of_states(case_file, indices, VARIABLES, values, axes)
    found.attrs["title"] = "knitlab plates: x along the courses (weft), y along the wales (warp)"
    about_status = {
        "units": "1",
        "long_name": "whether a state has a stiffness",
        "flag_values": np.array([*PlateStatus], np.int8),
        "flag_meanings": " ".join(status.name for status in PlateStatus),
    }
    statuses = np.array([plate[STATUS] for plate in plates], np.int8)
    found[STATUS] = found["length_x"].dims, statuses, about_status
    return found


def design_plates(
    cube: xr.Dataset, selections: Mapping[str, Any] = {}, where: str | None = None
) -> xr.Dataset:
    """The plates of a test, or of the designs of a cube with a periodic shape in its folder."""
    simulated = not (is_case(cube) or is_measured(cube))
    if simulated and model_options(cube).get("boundary") == "clamped":
        raise invalid(cube_name(cube), NOT_PERIODIC)
    plates = for_each_design(case_plates, cube, selections, where)
    plates[STATUS] = plates[STATUS].fillna(PlateStatus.no_shape).astype(np.int8)
    return plates


def known_states(plates: xr.Dataset) -> Iterator[xr.Dataset]:
    """Every state that has a shape, on its own, in the order of the dimensions."""
    dims = plates[STATUS].dims
    for index in np.ndindex(plates[STATUS].shape):
        state = plates.isel(dict(zip(dims, index, strict=True)))
        if state[STATUS] != PlateStatus.no_shape:
            yield state


def stiffness_matrix(state: xr.Dataset) -> np.ndarray:
    """The 6 × 6 matrix [A B; Bᵀ D] of one state, in N and mm."""
    a, b, d = (state[name].values for name in list(VARIABLES)[:3])
    return np.block([[a, b], [b.T, d]])


def in_plane(membrane: np.ndarray, angle: float | np.ndarray = 0.0) -> tuple[Any, Any]:
    """Modulus [N/mm] along an angle from x [rad], and Poisson's ratio, of a flat plate."""
    cosine = np.cos(angle)
    sine = np.sin(angle)
    along = np.stack([cosine**2, sine**2, cosine * sine])
    across = np.stack([sine**2, cosine**2, -cosine * sine])
    # Strain by force; shear counts once in the strain along a direction, twice in the force.
    strain = np.einsum("ij,j...->i...", np.linalg.inv(membrane), along)
    own = (along * strain).sum(0)
    return 1 / own, -(across * strain).sum(0) / own


def _numbers(plate: Plate, factor: float) -> dict[str, Any]:
    """The numbers of a plate in lengths that are so many times those of its network."""
    a = plate.stiffness[:3, :3]
    values = {
        "membrane_stiffness": a / factor,
        "coupling_stiffness": plate.stiffness[:3, 3:],
        "bending_stiffness": plate.stiffness[3:, 3:] * factor,
        "membrane_force": plate.forces[:3] / factor,
        "moment": plate.forces[3:],
        "reference_height": plate.height * factor,
        STATUS: int(plate.status),
    }
    names = ("modulus_x", "poisson_ratio_x", "modulus_y", "poisson_ratio_y", "shear_modulus")
    numbers = [np.nan] * len(names)
    if np.isfinite(a).all() and np.linalg.matrix_rank(a) == len(a):
        sides = in_plane(a / factor), in_plane(a / factor, np.pi / 2)
        numbers = [*sides[0], *sides[1], 1 / np.linalg.inv(a / factor)[2, 2]]
    return values | dict(zip(names, numbers, strict=True))
