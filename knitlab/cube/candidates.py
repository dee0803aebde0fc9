"""Candidates: the designs of several cubes that are ok, with their variables."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from jaxtyping import Float

from knitlab.cube.design_status import Status
from knitlab.cube.plain_cube import PlainCube
from knitlab.cube.query import designs_of_all
from knitlab.cube.strain_window import STRAIN, StrainWindow
from knitlab.io.errors import fault, unknown


@dataclass(frozen=True)
class Candidates:
    """Designs of several cubes along the same dimensions.

    Attributes:
        cubes: the cubes.
        table: one row for each design that is ok, with all variables that are single numbers.
        passed_over: number of designs that are not ok.
    """

    cubes: tuple[PlainCube, ...]
    table: pd.DataFrame
    passed_over: int

    @classmethod
    def of(cls, cubes: Sequence[PlainCube]) -> "Candidates":
        """The designs of some cubes.

        Raises:
            BadInput: if there is no cube, or no design that is ok.
        """
        if not cubes:
            raise fault("cubes", "none is given; name a cube or its results folder")
        table = designs_of_all(cubes)
        ok = (table["status"] == Status.ok.name).to_numpy()
        if not ok.any():
            raise fault("cubes", "hold no design that is ok; run a workflow first")
        return cls(tuple(cubes), table[ok].reset_index(drop=True), int((~ok).sum()))

    def lies_along_strain(self, name: str, source: str) -> bool:
        """Whether a variable is a curve along the applied strain, rather than one number.

        Args:
            name: the variable.
            source: where it was requested, for the message.

        Raises:
            BadInput: if no cube has it, or it has further dimensions.
        """
        dims = [
            set(cube.dims[name]) - set(cube.design_dims) for cube in self.cubes if name in cube.dims
        ]
        known = {variable for cube in self.cubes for variable in cube.dims}
        if not dims and name not in self.table:
            raise fault(source, unknown(name, sorted(known), "variable"))
        further = set().union(*dims) - {STRAIN}
        if further:
            along = ", ".join(sorted(further))
            raise fault(
                source, f"{name} has the dimension {along}; give a variable of whole designs"
            )
        return any(STRAIN in along for along in dims)

    def numbers(self, name: str) -> Float[np.ndarray, " design"]:
        """A variable of the designs; NaN if a cube does not have it."""
        return self.table[name].to_numpy(float, na_value=np.nan)

    def curves(self, name: str, window: StrainWindow) -> tuple[np.ndarray, np.ndarray]:
        """A variable along the applied strain, over a window.

        Returns:
            Strains of the window, and the values (design, strain), NaN where not known.
        """
        read = [self._curves_of(cube, name, window) for cube in self.cubes]
        at = np.unique(np.concatenate([strains for strains, _ in read]))
        # Curves are linear between the strains at which they were read, so interpolation is exact.
        combined = [
            np.array([np.interp(at, strains, row) for row in rows]).reshape(len(rows), len(at))
            for strains, rows in read
        ]
        return at, np.concatenate(combined)

    def _curves_of(
        self, cube: PlainCube, name: str, window: StrainWindow
    ) -> tuple[np.ndarray, np.ndarray]:
        ok = np.asarray(cube.read("status")) == Status.ok
        strains = np.asarray(cube.coordinates[STRAIN], float)
        values = np.full((int(ok.sum()), len(strains)), np.nan)
        if name in cube.dims:
            values = np.asarray(cube.read(name), float)[ok]
        return window.read(strains, values)
