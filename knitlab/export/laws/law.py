"""The law of a fabric: fitted to its tests, judged by those that were left out, and written."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from jaxtyping import Bool, Float
from numpy.typing import ArrayLike
from scipy.spatial import Delaunay, QhullError

from knitlab.cubes.chosen_case import selected_case
from knitlab.cubes.cube_file import cube_name, design_dims
from knitlab.cubes.model_line import model_line
from knitlab.export.laws.fitting import fitted, predicted
from knitlab.export.laws.law_files import FORMATS
from knitlab.export.laws.ridge_law import MIRROR, RidgeLaw
from knitlab.export.laws.strain_tests import (
    Strain,
    StrainTest,
    Stress,
    ratio_of_pull,
    strain_tests,
)
from knitlab.export.plates.plate_stiffness import STATUS, case_plates
from knitlab.io.atomic_write import atomic_write
from knitlab.io.errors import InputError, invalid
from knitlab.io.names import check_suffix
from knitlab.observables.schema import STRAIN
from knitlab.solvers.plate_condensation import PlateStatus

MIN_TESTS = 4
WEAK = 0.2  # of the largest force of a test, below which its errors are relative to this
MOST = 0.8  # of the states of a test that others enclose so that they predict it


@dataclass(frozen=True, eq=False)
class Plate:
    """The fabric as a plate, in one state."""

    applied_strain: float
    membrane: Float[np.ndarray, "3 3"]  # [N/mm]
    bending: Float[np.ndarray, "3 3"]  # [N mm]


@dataclass(frozen=True, eq=False)
class Law:
    """An energy density of a membrane, fitted to the tests of one fabric.

    Strains are Green's (E_xx, E_yy, 2 E_xy), stresses second Piola–Kirchhoff (S_xx, S_yy, S_xy)
    [N/mm], x along the courses and y along the wales; arguments may have leading axes.

    Attributes:
        ridges: the energy density, see ``docs/how-to/law.md``.
        tests: the tests that it is fitted to.
        mirrored: whether the fabric is its own mirror image.
        model: the model behind the tests, in one line.
        plate: the fabric as a plate at its smallest strain that has one; if that is 0, the tangent
            at rest is fitted to it.
    """

    ridges: RidgeLaw
    tests: tuple[StrainTest, ...]
    mirrored: bool
    model: str
    plate: Plate | None = None

    def __repr__(self) -> str:
        return f"<Law: {len(self.ridges.weights)} ridges, fitted to {len(self.tests)} tests>"

    def energy(
        self, strain: ArrayLike, curvature: ArrayLike | None = None
    ) -> Float[np.ndarray, "*state"]:
        """Energy over the relaxed area [N/mm], with that of curvatures (xx, yy, 2 xy) [1/mm]."""
        energy = self.ridges.energy(np.asarray(strain, float))
        if curvature is None:
            return energy
        if self.plate is None:
            raise invalid("curvature", "has no energy: the cube has no plate of this fabric")
        curvature = np.asarray(curvature, float)
        return energy + np.sum(curvature @ self.plate.bending * curvature, axis=-1) / 2

    def stress(self, strain: ArrayLike) -> Stress:
        """The stress, the first derivative of the energy by the strain [N/mm]."""
        return self.ridges.stress(np.asarray(strain, float))

    def tangent(self, strain: ArrayLike) -> Float[np.ndarray, "*state 3 3"]:
        """The stiffness, the second derivative; positive semidefinite at every strain [N/mm]."""
        return self.ridges.tangent(np.asarray(strain, float))

    def covers(self, strain: ArrayLike) -> Bool[np.ndarray, "*state"]:
        """Whether strains lie between those of the tests; beyond them the law is a guess."""
        return _inside(self._hull, np.asarray(strain, float))

    @cached_property
    def _hull(self) -> Delaunay | None:
        return _hull(self.tests, self.mirrored)

    @property
    def range(self) -> tuple[np.ndarray, np.ndarray]:
        """The lowest and the highest strain of all tests [1]."""
        points = _strains(self.tests, self.mirrored)
        return points.min(axis=0), points.max(axis=0)

    @cached_property
    def errors(self) -> pd.DataFrame:
        """Each test: largest errors of force, over its size, and of ν [1].

        ``left_out`` are errors of a law that is fitted to the other tests; ``between`` says whether
        the strains of the test lie between those of the others, so that these predict it.
        """
        rows = []
        for number, test in enumerate(self.tests):
            others = [*self.tests[:number], *self.tests[number + 1 :]]
            without = fitted(others, self.mirrored, _stiffness_at_rest(self.plate))
            row: dict[str, Any] = {"test": test.label}
            for name, law in (("", self.ridges), ("_left_out", without)):
                row[f"force_error{name}"], row[f"ratio_error{name}"] = errors_of(law, test)
            enclosed = _inside(_hull(others, self.mirrored), test.strain)
            row["between"] = bool(enclosed.mean() > MOST)
            rows.append(row)
        return pd.DataFrame(rows)

    def write(self, path: str | Path) -> Path:
        """Write it as ``.py``, functions without knitlab, or ``.csv``, stress over strains."""
        path = Path(path)
        check_suffix(path, FORMATS, "a law")
        with atomic_write(path) as temporary:
            FORMATS[path.suffix.lower()](self, temporary)
        return path


def law_of(cube: xr.Dataset, rows: xr.Dataset) -> Law:
    """The law of the tests of one design of a cube, by their rows."""
    tests = strain_tests(rows)
    if len(tests) < MIN_TESTS:
        message = f"has {len(tests)} tests of this design; a law needs {MIN_TESTS}"
        raise invalid(cube_name(cube), f"{message}, as of the workflow law")
    # Angles beyond 90° are simulated where the fabric is not its own mirror image.
    mirrored = all(test.angle <= 90 for test in tests)
    plate = _plate(cube, rows)
    ridges = fitted(tests, mirrored, _stiffness_at_rest(plate))
    return Law(ridges, tuple(tests), mirrored, model_line(cube), plate)


def _plate(cube: xr.Dataset, rows: xr.Dataset) -> Plate | None:
    """The first state that has a plate; None without the shapes of the cube."""
    first = {dim: rows[dim].values[0] for dim in design_dims(cube)}
    try:
        plates = case_plates(selected_case(cube, first))
    except InputError:
        return None
    ok = np.flatnonzero(plates[STATUS] == PlateStatus.ok)
    if not len(ok):
        return None
    state = plates.isel({STRAIN: ok[0]})
    matrices = (state[name].values for name in ("membrane_stiffness", "bending_stiffness"))
    return Plate(float(state[STRAIN]), *matrices)


def _stiffness_at_rest(plate: Plate | None) -> Float[np.ndarray, "3 3"] | None:
    """The membrane stiffness, if layers do not touch at rest [N/mm]."""
    return plate.membrane if plate is not None and plate.applied_strain == 0 else None


def _strains(tests: Sequence[StrainTest], mirrored: bool) -> Float[np.ndarray, "state 3"]:
    """The strains of tests, and of their mirror images."""
    points = np.concatenate([test.strain for test in tests])
    return np.concatenate([points, points * MIRROR]) if mirrored else points


def _hull(tests: Sequence[StrainTest], mirrored: bool) -> Delaunay | None:
    """What lies between the strains of tests; None if all lie in a plane."""
    try:
        return Delaunay(_strains(tests, mirrored))
    except QhullError:
        return None


def _inside(hull: Delaunay | None, strain: Strain) -> Bool[np.ndarray, "*state"]:
    if hull is None:
        return np.zeros(strain.shape[:-1], bool)
    return hull.find_simplex(strain) >= 0


def errors_of(law: RidgeLaw, test: StrainTest) -> tuple[float, float]:
    """Largest errors of a test by a law: of forces, over their size, and of ν."""
    stretch, force = predicted(law, test)
    size = np.linalg.norm(test.force[1:], axis=1)
    missed = np.linalg.norm((force - test.force)[1:, [*test.prescribed]], axis=1)
    of_force = float((missed / np.maximum(size, WEAK * size.max())).max())
    if not test.is_pull:
        return of_force, np.nan
    difference = ratio_of_pull(stretch) - ratio_of_pull(test.stretch)
    return of_force, float(np.nanmax(np.abs(difference)))
