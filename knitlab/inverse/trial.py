"""Trials: simulated cases of a search, stored as case files, with derivatives of their results."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import jax
import numpy as np
import xarray as xr
from jaxtyping import Float

from knitlab.cube.case_file import (
    StoredCase,
    check_case_file,
    configurations,
    read_case,
    read_code,
    write_case_file,
)
from knitlab.cube.schema import Status
from knitlab.cube.strain_window import STRAIN, without_gap_at_zero
from knitlab.fabric.configuration import Configuration
from knitlab.inverse.quantities import OF_CLOTH, OF_DESIGN, Measures, of_relaxed, of_strained
from knitlab.inverse.request import PARAMETERS
from knitlab.io.fingerprint import code_fingerprint
from knitlab.measure.knit_size import Gauge
from knitlab.measure.sensitivity import STRIPE_PARAMETERS, logarithmic
from knitlab.simulation.case import Case
from knitlab.simulation.simulate import simulated
from knitlab.simulation.stripe_sensitivity import adjoint_of
from knitlab.sweep.cube import known_in_advance, sizes_of

STRIPE_COUNT = len(STRIPE_PARAMETERS)
Slopes = Float[np.ndarray, "strain parameter"]


@dataclass(frozen=True, eq=False)
class Trial:
    """A simulated case.

    Attributes:
        case: the case.
        gauge: gauge of its sizes in cloth.
        results: contents of its case file.
        measures: own measures of its shapes.
    """

    case: Case
    gauge: Gauge
    results: xr.Dataset
    measures: Measures = ()

    @property
    def converged(self) -> bool:
        """Whether the whole test converged."""
        return int(self.results["status"]) == Status.ok

    @property
    def snapped(self) -> bool:
        """Whether the fabric snapped on the way to a strain."""
        return bool((self.results["snapped"] == 1).any())

    @cached_property
    def strains(self) -> Float[np.ndarray, " strain"]:
        """Applied strains of the test."""
        return np.asarray(self.results[STRAIN], float)

    @cached_property
    def _shapes(self) -> Configuration:
        return configurations(self.results)

    def values(self, name: str) -> Float[np.ndarray, " strain"]:
        """A variable: one value for each strain, or a single one.

        Raises:
            KeyError: if the case does not have it.
        """
        own = dict(self.measures)
        if name in own:
            shapes = self._shapes
            values = [float(own[name](shapes[place])) for place in range(len(self.strains))]
            return np.array(values)
        if name in self.results:
            found = np.atleast_1d(np.asarray(self.results[name], float))
        else:
            numbers = {str(key): array.values for key, array in self.results.data_vars.items()}
            further = known_in_advance(self.case) | sizes_of(self.case, numbers, self.gauge)
            found = np.atleast_1d(float(further[name]))
        if len(found) == len(self.strains):
            found = without_gap_at_zero(self.strains, found[None])[0]
        return found

    def slopes(self, names: Sequence[str], needed: np.ndarray) -> dict[str, Slopes]:
        """Derivatives of variables by the logarithm of each parameter of stripes and gauge.

        Args:
            names: names of :mod:`~knitlab.inverse.quantities`.
            needed: whether each strain is needed; derivatives at the others are 0.

        Returns:
            (strain, parameter) by name, one strain for a variable of the design.

        Raises:
            NoDerivative: if a state is not a stable equilibrium, such as at a snap.
        """
        key = tuple(names), needed.tobytes()
        if key not in self._known_slopes:
            self._known_slopes[key] = self._derived(names, needed)
        return self._known_slopes[key]

    @cached_property
    def _known_slopes(self) -> dict[tuple[tuple[str, ...], bytes], dict[str, Slopes]]:
        """Cached derivatives, which a constrained search uses twice."""
        return {}

    def _derived(self, names: Sequence[str], needed: np.ndarray) -> dict[str, Slopes]:
        case, shape = self.case, self.case.mesh_shape
        stripes = case.stripe_pair
        shapes = jax.tree.map(np.asarray, self._shapes)
        adjoint = adjoint_of(case, shapes[0])
        along = tuple(name for name in names if name not in OF_DESIGN)
        of_design = tuple(name for name in names if name in OF_DESIGN)
        found: dict[str, Slopes] = {
            name: np.zeros((len(self.strains) if name in along else 1, len(PARAMETERS)))
            for name in names
        }
        for place in np.flatnonzero(needed) if along else ():
            measure = of_strained(shape, case.cell_grid, along, self.measures)
            strain = float(self.strains[place])
            by_number = (
                adjoint.of_strained(strain, shapes[place], measure)
                if place
                else adjoint.of_relaxed(measure)
            )
            for name, row in zip(along, logarithmic(by_number, stripes), strict=True):
                found[name][place, :STRIPE_COUNT] = row
        if "poisson_ratio" in found and len(self.strains) > 1:
            found["poisson_ratio"][0] = found["poisson_ratio"][1]
        if of_design:
            measure = of_relaxed(shape, case.cell_grid, of_design)
            rows = logarithmic(adjoint.of_relaxed(measure), stripes)
            relaxed = np.asarray(measure(shapes[0], shapes[0], case.assemble()[1]))
            for name, row, reference in zip(of_design, rows, relaxed, strict=True):
                value = self.values(name)[0]
                found[name][0, :STRIPE_COUNT] = row * value / reference
                if name in OF_CLOTH:
                    found[name][0, PARAMETERS.index(OF_CLOTH[name][1])] = value
        return found


def run_trial(folder: Path, case: Case, gauge: Gauge, measures: Measures = ()) -> Trial:
    """Simulate a case, or read its file if the same code has simulated it before.

    Args:
        folder: folder of the case files.
        case: the case.
        gauge: of its sizes in cloth.
        measures: own measures of its shapes.

    Raises:
        CannotWrite: if its file cannot be written.
    """
    sound = check_case_file(folder, case.case_id) is StoredCase.sound
    if not sound or read_code(folder, case.case_id) != code_fingerprint():
        write_case_file(folder, case.case_id, simulated(case, lambda name, states: None))
    return Trial(case, gauge, read_case(folder, case.case_id), measures)
