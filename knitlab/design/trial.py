"""Trials: simulated cases of a search, stored as case files, with derivatives of their results."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array, Float

from knitlab.cubes import case_file
from knitlab.cubes.derived import with_derived
from knitlab.design.request import PARAMETERS
from knitlab.io.provenance import MODEL
from knitlab.model.cell_grid import CellGrid
from knitlab.model.fabric import Configuration, Fabric
from knitlab.model.network import MeshShape
from knitlab.model.stitches import Gauge
from knitlab.observables import sensitivity
from knitlab.observables.schema import STRAIN
from knitlab.observables.status import Status
from knitlab.runs.cube import cloth_sizes, input_values
from knitlab.runs.simulate import simulated
from knitlab.solvers.case import Case
from knitlab.solvers.equilibrium.adjoint import Adjoint, Measure

ALONG_STRAIN = ("poisson_ratio", "reaction_force", "mean_strain_xx", "mean_strain_yy")
"""Quantities along the applied strain that have derivatives."""
OF_CLOTH = {
    "knit_cell_x": ("relaxed_cell_x", "stitch_width"),
    "knit_cell_y": ("relaxed_cell_y", "stitch_height"),
    "knit_width": ("relaxed_cell_x", "stitch_width"),
    "knit_length": ("relaxed_cell_y", "stitch_height"),
}
"""Sizes in cloth: the cell whose contraction they follow, and the size of a stitch."""
OF_DESIGN = ("relaxed_cell_x", "relaxed_cell_y", *OF_CLOTH)
"""Quantities of the relaxed fabric that have derivatives."""
OVER_WIDTH = ("force_per_width", "tangent_stiffness", "stretch_energy")
"""Curves that follow from the reaction force and the width of the relaxed cloth."""

ShapeFunction = Callable[[Configuration], Float[Array, ""]]  # a user's function, in JAX
ShapeFunctions = tuple[tuple[str, ShapeFunction], ...]  # by name, hashable
Slopes = dict[str, Float[np.ndarray, "strain parameter"]]  # derivatives by name of a variable


@dataclass(frozen=True, eq=False)
class Trial:
    """A simulated case: its case file, and the user's functions of its shapes."""

    case: Case
    gauge: Gauge
    results: xr.Dataset
    own: ShapeFunctions = ()

    @property
    def converged(self) -> bool:
        """Whether the whole test converged."""
        return int(self.results["status"]) == Status.ok

    @cached_property
    def strains(self) -> Float[np.ndarray, " strain"]:
        """Applied strains of the test."""
        return np.asarray(self.results[STRAIN], float)

    @cached_property
    def _shapes(self) -> Configuration:
        return case_file.configurations(self.results)

    def values(self, name: str) -> Float[np.ndarray, " strain"]:
        """A variable: one value for each strain, or a single one."""
        if function := dict(self.own).get(name):
            return np.array([float(function(self._shapes[k])) for k in range(len(self.strains))])
        if name in OVER_WIDTH:
            return self._over_width(name, self.values("reaction_force") / self._width)
        if name in self.results:
            return np.atleast_1d(np.asarray(self.results[name], float))
        numbers = {str(key): array.values for key, array in self.results.data_vars.items()}
        further = input_values(self.case) | cloth_sizes(self.case, numbers, self.gauge)
        return np.atleast_1d(float(further[name]))

    @property
    def _width(self) -> float:
        return float(self.values("knit_cell_x")[0] * self.values("unit_cells_x")[0])

    def _over_width(self, name: str, force: Float[np.ndarray, "strain ..."]) -> np.ndarray:
        """A curve, or its derivatives, from those of the force over the width."""
        curve = xr.Dataset({"force_per_width": ((STRAIN, *"p"[: force.ndim - 1]), force)})
        return with_derived(curve.assign_coords({STRAIN: self.strains}))[name].values

    @lru_cache(maxsize=1)  # noqa: B019, a constrained search needs those of a trial twice
    def slopes(self, names: tuple[str, ...], needed: tuple[bool, ...]) -> Slopes:
        """Derivatives by the logarithm of each parameter, where needed; NoDerivative at a snap."""
        case = self.case
        stripes = len(sensitivity.STRIPE_PARAMETERS)
        shapes = jax.tree.map(np.asarray, self._shapes)
        adjoint = sensitivity.adjoint_of(case, shapes[0])
        over_width = [name for name in names if name in OVER_WIDTH]
        names = tuple(name for name in names if name not in OVER_WIDTH)
        if over_width:
            names = tuple(dict.fromkeys((*names, "reaction_force", "knit_cell_x")))
        along = tuple(name for name in names if name not in OF_DESIGN)
        of_design = tuple(name for name in names if name in OF_DESIGN)
        slopes: Slopes = {
            name: np.zeros((len(self.strains) if name in along else 1, len(PARAMETERS)))
            for name in names
        }
        for k in np.flatnonzero(needed) if along else ():
            measure = shape_measure(case.mesh_shape, case.cell_grid, along, self.own)
            rows = state_slopes(case, adjoint, float(self.strains[k]), shapes[k], measure)
            for name, row in zip(along, rows, strict=True):
                slopes[name][k, :stripes] = row
        if of_design:
            measure = shape_measure(case.mesh_shape, case.cell_grid, of_design)
            rows = state_slopes(case, adjoint, 0.0, shapes[0], measure)
            still = jnp.zeros(case.mesh_shape.unknowns)
            relaxed = np.asarray(measure(shapes[0], shapes[0], case.assemble()[1], still))
            for name, row, reference in zip(of_design, rows, relaxed, strict=True):
                value = self.values(name)[0]
                slopes[name][0, :stripes] = row * value / reference
                if name in OF_CLOTH:
                    slopes[name][0, PARAMETERS.index(OF_CLOTH[name][1])] = value
        for name in over_width:
            force = self.values("force_per_width")[:, None]
            by_width = slopes["knit_cell_x"] / self.values("knit_cell_x")
            slope = slopes["reaction_force"] / self._width - force * by_width
            slopes[name] = self._over_width(name, slope)
        return slopes


def state_slopes(
    case: Case, adjoint: Adjoint, strain: float, shape: Configuration, measure: Measure
) -> Float[np.ndarray, "quantity stripe_parameter"]:
    """Logarithmic derivatives p ∂f/∂p of a measure of a state; NoDerivative if it is unstable."""
    derivatives = (
        adjoint.strained_derivatives(strain, shape, measure)
        if strain
        else adjoint.relaxed_derivatives(measure)
    )
    return sensitivity.logarithmic(derivatives, case.stripe_pair)


@lru_cache(maxsize=64)
def shape_measure(
    shape: MeshShape, cells: CellGrid, names: tuple[str, ...], own: ShapeFunctions = ()
) -> Measure:
    """A measure of quantities and own functions, of a size in cloth its relaxed over flat cell."""
    functions = dict(own)
    known = sensitivity.quantities(shape, cells)

    def measured(
        relaxed: Configuration, strained: Configuration, fabric: Fabric, pushed: Array
    ) -> Array:
        flat = {"relaxed_cell_x": fabric.cell_x.mean(), "relaxed_cell_y": fabric.cell_y.mean()}
        values = []
        for name in names:
            if name in functions:
                values.append(functions[name](strained))
            elif name in OF_CLOTH:
                cell, _ = OF_CLOTH[name]
                values.append(known[cell](relaxed, strained, fabric, pushed) / flat[cell])
            else:
                values.append(known[name](relaxed, strained, fabric, pushed))
        return jnp.stack(values)

    return measured


def run_trial(folder: Path, case: Case, gauge: Gauge, own: ShapeFunctions = ()) -> Trial:
    """Simulate a case, or read its file in a folder if the same code has simulated it before."""
    name = case.case_id
    if not case_file.is_undamaged(folder, name) or case_file.read_code(folder, name) != MODEL:
        case_file.write_case_file(folder, name, simulated(case, lambda name, states: None))
    return Trial(case, gauge, case_file.read_case(folder, name), own)
