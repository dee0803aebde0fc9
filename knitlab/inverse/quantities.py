"""Quantities with derivatives, which targets of a gradient-based search may use."""

from collections.abc import Callable
from functools import lru_cache

import jax.numpy as jnp
from jaxtyping import Array, Float

from knitlab.fabric.configuration import Configuration
from knitlab.fabric.fabric import Fabric
from knitlab.fabric.network import MeshShape
from knitlab.measure.unit_cells import CellGrid
from knitlab.simulation.sensitivity import measured_by, quantities

ALONG_STRAIN = ("poisson_ratio", "reaction_force", "mean_strain_xx", "mean_strain_yy")
"""Quantities along the applied strain."""
OF_CLOTH = {
    "knit_cell_x": ("relaxed_cell_x", "stitch_width"),
    "knit_cell_y": ("relaxed_cell_y", "stitch_height"),
    "knit_width": ("relaxed_cell_x", "stitch_width"),
    "knit_length": ("relaxed_cell_y", "stitch_height"),
}
"""Sizes in cloth: the cell whose contraction they follow, and the size of a stitch."""
OF_DESIGN = ("relaxed_cell_x", "relaxed_cell_y", *OF_CLOTH)
"""Quantities of the relaxed fabric."""

Measure = Callable[[Configuration], Float[Array, ""]]
"""A function of a configuration that returns a number, in JAX."""
Measures = tuple[tuple[str, Measure], ...]
"""Own measures by name, as a hashable tuple."""


@lru_cache(maxsize=64)
def of_strained(
    shape: MeshShape, cells: CellGrid, names: tuple[str, ...], measures: Measures
) -> Callable[[Configuration, Configuration, Fabric], Float[Array, " quantity"]]:
    """Quantities of a state under strain; the same function for the same arguments.

    Args:
        shape: the mesh shape.
        cells: the unit cells.
        names: of :data:`ALONG_STRAIN`, or of own measures.
        measures: the own measures.
    """
    own = dict(measures)
    known = tuple(name for name in names if name not in own)
    combined = measured_by(shape, cells, known) if known else None

    def measured(relaxed: Configuration, strained: Configuration, fabric: Fabric) -> Array:
        values = combined(relaxed, strained, fabric) if combined else ()
        found = dict(zip(known, values, strict=True))
        return jnp.stack([own[name](strained) if name in own else found[name] for name in names])

    return measured


@lru_cache(maxsize=64)
def of_relaxed(
    shape: MeshShape, cells: CellGrid, names: tuple[str, ...]
) -> Callable[[Configuration, Configuration, Fabric], Float[Array, " quantity"]]:
    """Quantities of the relaxed fabric, up to a factor that does not depend on stripe parameters.

    Args:
        shape: the mesh shape.
        cells: the unit cells.
        names: of :data:`OF_DESIGN`; a size in cloth is given as its contraction, relaxed over flat.
    """
    known = quantities(shape, cells)

    def measured(relaxed: Configuration, strained: Configuration, fabric: Fabric) -> Array:
        flat = {"relaxed_cell_x": fabric.cell_x.mean(), "relaxed_cell_y": fabric.cell_y.mean()}
        values = []
        for name in names:
            cell = OF_CLOTH[name][0] if name in OF_CLOTH else name
            size = known[cell](relaxed, strained, fabric)
            values.append(size / flat[cell] if name in OF_CLOTH else size)
        return jnp.stack(values)

    return measured
