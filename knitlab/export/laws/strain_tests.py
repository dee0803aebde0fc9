"""Tests of periodic fabric, as strains of a membrane and the stresses that they take.

In the axes of a test, which is pulled along the second, lines along the first keep their direction:
the deformation gradient is upper triangular, F = [[a, c], [0, b]]. A test prescribes some of a, b
and c; no force acts on the others. With forces Q that do the work ∫ Q·d(a, b, c) over the relaxed
area, the second Piola–Kirchhoff stress is S_22 = Q_b / b, S_12 = (Q_c − c S_22) / a and
S_11 = (Q_a − c S_12) / a.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Float

from knitlab.cubes.case_file import length_factor
from knitlab.cubes.cube_file import cube_name, design_dims
from knitlab.cubes.derived import sides_of_pull
from knitlab.cubes.normalised import require
from knitlab.cubes.selection import choices, select
from knitlab.io.errors import invalid
from knitlab.observables.poisson_ratio import poisson_ratio_of_test
from knitlab.observables.schema import STRAIN

A, B, C = range(3)
NEEDED = ("mean_strain_xx", "mean_strain_yy", "reaction_force", "relaxed_cell_x", "relaxed_cell_y")
ENERGIES = ("energy_stretch", "energy_fold", "energy_wall", "energy_contact")
LOADS = ("load", "load_angle", "load_ratio", "sample")  # dimensions along which tests may lie
SAME = 1e-6  # difference of strains that are prescribed and those that were reached

Strain = Float[np.ndarray, "*state 3"]
"""Green's strain (E_xx, E_yy, 2 E_xy), x along the courses and y along the wales [1]."""
Stress = Float[np.ndarray, "*state 3"]
"""Second Piola–Kirchhoff stress (S_xx, S_yy, S_xy) [N/mm]."""


@dataclass(frozen=True, eq=False)
class StrainTest:
    """One test of periodic fabric."""

    label: str
    angle: float  # from the courses to the second axis, along which it is pulled [degree]
    stretch: Float[np.ndarray, "state 3"]  # a, b and c in its axes [1]
    prescribed: tuple[int, ...]  # which of them the test prescribes
    force: Float[np.ndarray, "state 3"]  # that do work on them [N/mm]
    energy: Float[np.ndarray, " state"]  # over the relaxed area [N/mm]

    @property
    def strain(self) -> Strain:
        """Green's strain along courses and wales."""
        return strain_of(self.stretch, self.angle)

    @property
    def stress(self) -> Stress:
        """Second Piola–Kirchhoff stress along courses and wales."""
        a, b, c = self.stretch.T
        s_22 = self.force[:, B] / b
        s_12 = (self.force[:, C] - c * s_22) / a
        s_11 = (self.force[:, A] - c * s_12) / a
        tensor = np.moveaxis(np.array([[s_11, s_12], [s_12, s_22]]), -1, 0)
        axes = axes_at(self.angle)
        return _components(axes @ tensor @ axes.T, 1.0)

    @property
    def is_pull(self) -> bool:
        """Whether it has a Poisson's ratio: one direction is pulled, with free sides."""
        return self.prescribed == (B,)


def axes_at(angle: float) -> Float[np.ndarray, "2 2"]:
    """The axes of a pull at an angle from the courses [degree], as columns."""
    cos, sin = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    return np.array([[sin, cos], [-cos, sin]])


def ratio_of_pull(stretch: Float[np.ndarray, "state 3"]) -> Float[np.ndarray, " state"]:
    """ν of a pull, along the second axis of its test."""
    return poisson_ratio_of_test(stretch[:, A] - 1, stretch[:, B] - 1)


def strain_of(stretch: Float[np.ndarray, "*state 3"], angle: float) -> Strain:
    """Green's strain along courses and wales of a deformation in the axes of a test."""
    a, b, c = np.moveaxis(stretch, -1, 0)
    metric = np.moveaxis(np.array([[a**2, a * c], [a * c, b**2 + c**2]]), (0, 1), (-2, -1))
    axes = axes_at(angle)
    return _components((axes @ metric @ axes.T - np.eye(2)) / 2, 2.0)


def stretch_along(gradient: Float[np.ndarray, "state 2 2"], angle: float) -> np.ndarray:
    """a, b and c of deformation gradients in the axes of a test."""
    axes = axes_at(angle)
    metric = axes.T @ np.swapaxes(gradient, -1, -2) @ gradient @ axes
    a = np.sqrt(metric[:, 0, 0])
    c = metric[:, 0, 1] / a
    return np.stack([a, np.sqrt(metric[:, 1, 1] - c**2), c], axis=-1)


def rows_of_tests(cube: xr.Dataset, selections: Mapping[str, Any]) -> xr.Dataset:
    """The tests of the one design of a cube that selections leave, along ``test``."""
    require(cube, NEEDED, "a law")
    if cube.attrs.get("model_boundary") != "periodic":
        message = "has no periodic fabric, to whose tests a law is fitted; run the workflow law"
        raise invalid(cube_name(cube), message)
    left = select(cube, selections)
    dims = design_dims(left)
    rows = left.stack(test=dims).transpose("test", ...)
    rows = rows.isel(test=np.flatnonzero(rows["case_id"] != ""))
    labels = {dim: np.unique(rows[dim]) for dim in dims if dim not in LOADS}
    several = [dim for dim, values in labels.items() if len(values) > 1]
    if several:
        listed = choices(xr.Dataset(coords=labels), several)
        raise invalid("selections", f"leave several designs; select {listed}")
    return rows


def strain_tests(rows: xr.Dataset) -> list[StrainTest]:
    """Tests as strains and stresses, up to the first strain that is missing."""
    tests = [_test(rows.isel(test=number)) for number in range(rows.sizes["test"])]
    return [test for test in tests if len(test.energy) > 1]


def is_strained_across(row: xr.Dataset) -> bool:
    """Whether the test in one row of a cube prescribes the strain across the pull too."""
    across = "reaction_force_across"
    return across in row and bool(np.isfinite(row[across][0]))


def _test(row: xr.Dataset) -> StrainTest:
    """The test in one row of a cube, up to the first state that is missing."""

    def curve(name: str) -> Float[np.ndarray, " state"]:
        missing = xr.zeros_like(row[STRAIN])
        return row[name].fillna(0).values if name in row else missing.values

    applied = row[STRAIN].values
    known = np.isfinite(row["reaction_force"].values) & np.isfinite(row["mean_strain_xx"].values)
    reached = slice(0, len(known) if known.all() else int(np.argmin(known)))
    gradient = np.zeros((len(applied), 2, 2))
    gradient[:, 0, 0] = 1 + curve("mean_strain_xx")
    gradient[:, 1, 1] = 1 + curve("mean_strain_yy")
    gradient[:, 0, 1] = curve("mean_strain_xy")
    width = float(row["relaxed_cell_x"] * row["unit_cells_x"])
    height = float(row["relaxed_cell_y"] * row["unit_cells_y"])
    along, across = curve("reaction_force"), curve("reaction_force_across")
    angle = float(row["load_direction"].fillna(90)) if "load_direction" in row else 90.0
    stretch = stretch_along(gradient, angle)
    force = np.zeros_like(stretch)
    is_pull = np.abs(stretch[reached, B] - 1 - applied[reached]).max(initial=0) < SAME
    side_across, side_along = sides_of_pull(width, height, math.radians(angle))
    prescribed: tuple[int, ...]
    if is_strained_across(row):
        force[:, A], force[:, B] = across / side_along, along / side_across
        prescribed = (A, B, C)
        ratio = round((stretch[reached, A][-1] - 1) / max(applied[reached][-1], SAME), 6) + 0.0
        label = f"biaxial at {angle:g}°, {ratio:.3g} times across"
    elif is_pull:
        force[:, B], prescribed = along / side_across, (B,)
        label = f"pull at {angle:g}°"
    else:
        force[:, C], prescribed, label = along / width, (C,), "shear"
    energy = sum(map(curve, ENERGIES), np.zeros(len(applied)))
    energy = (energy - energy[0]) / (width * height)
    factor = length_factor(row) or 1.0
    return StrainTest(
        label,
        angle,
        stretch[reached],
        prescribed,
        (force / factor)[reached],
        (energy / factor)[reached],
    )


def _components(tensor: Float[np.ndarray, "*state 2 2"], shear: float) -> np.ndarray:
    components = [tensor[..., 0, 0], tensor[..., 1, 1], shear * tensor[..., 0, 1]]
    return np.stack(components, axis=-1)
