"""The fabric: a network with the numbers of its stripes, ready to have its energy taken."""

from dataclasses import dataclass

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from knitlab.model.network import Network, mesh_shape, network
from knitlab.model.pattern import CELLS_PER_PERIOD, Pattern, fold_senses, inside_runs
from knitlab.model.reading import Reading
from knitlab.model.stripe import Stripe


@dataclass(frozen=True)
class Sheet:
    """What all fabrics share: the walls they lie between.

    Attributes:
        z_max: half the gap between the walls [mm].
        k_wall: penalty stiffness of the walls [N/mm].
    """

    z_max: float
    k_wall: float


class Fabric(eqx.Module):
    """Numbers of one fabric on a network; fabrics of one mesh shape stack into a batch.

    Attributes:
        rest_length: of every spring [mm].
        stretch_stiffness: of every spring [N/mm].
        rest_fold: signed fold angle at rest of every hinge, 0 where flat, positive for a
            mountain [rad].
        fold_stiffness: of every hinge, 0 where the reading puts none [N mm].
        z_max: half the gap between the walls [mm].
        k_wall: penalty stiffness of the walls [N/mm].
        cell: flat size of a grid cell along (x, y) [mm].
    """

    rest_length: Float[Array, " spring"]
    stretch_stiffness: Float[Array, " spring"]
    rest_fold: Float[Array, " hinge"]
    fold_stiffness: Float[Array, " hinge"]
    z_max: Float[Array, ""]
    k_wall: Float[Array, ""]
    cell: Float[Array, "2"]


def cell_length(stripe: Stripe, reading: Reading) -> float:
    """Flat length of a grid cell across a stripe's ridges [mm]: the reading's ``cell_size``."""
    quarter = reading.length_scale * stripe.period / CELLS_PER_PERIOD
    return quarter if reading.cell_size == "flat" else quarter / stripe.contraction


def weave(
    pattern: Pattern, weft: Stripe, warp: Stripe, sheet: Sheet, reading: Reading
) -> tuple[Network, Fabric]:
    """Network and numbers of a patterned fabric (paper, Sec. "3D model").

    Springs and hinges take their values by direction: those across the wales (springs along x,
    hinges about edges along y) from ``weft``, those across the courses from ``warp``, diagonals
    the smaller k_s. Folds lie where :func:`~knitlab.model.pattern.fold_senses` puts them, the
    first of a rib patch a mountain, of a garter patch as the reading says. Hinges that join
    unlike patches, or turn against their patch's folds, rest flat and exist only where the
    reading says ``all``.

    Args:
        pattern: which patch is rib and which garter.
        weft: the rib stripe; for a pure stripe fabric, that stripe.
        warp: the garter stripe; for a pure stripe fabric, that stripe.
        sheet: the walls.
        reading: the choices that the paper leaves open.
    """
    shape = mesh_shape(pattern, reading.boundary)
    net = network(shape)
    cell = np.array([cell_length(weft, reading), cell_length(warp, reading)])

    by_kind = [net.weft, net.warp]
    rest_length = np.select(by_kind, list(cell), np.hypot(*cell))
    stretch_stiffness = np.select(by_kind, [weft.k_s, warp.k_s], min(weft.k_s, warp.k_s))

    rib = pattern.rib_cells
    rib_senses = fold_senses(rib, reading.fold_phase, shape.periodic)
    garter_senses = fold_senses(~rib.T, reading.fold_phase, shape.periodic).T
    garter_sign = 1 if reading.garter_start == "mountain" else -1
    at = tuple(net.hinge_cells.T)
    fold = np.where(
        net.wale, rib_senses[at] * weft.fold, garter_sign * garter_senses[at] * warp.fold
    )
    k_t = np.where(net.wale, weft.k_t, warp.k_t)
    if reading.hinge_stiffness == "per_length":
        k_t = k_t * np.where(net.wale, cell[1], cell[0])
    if reading.hinges == "fold_lines":
        in_rib = inside_runs(rib, shape.periodic)
        in_garter = inside_runs(~rib.T, shape.periodic).T
        k_t = np.where(np.where(net.wale, in_rib[at], in_garter[at]), k_t, 0.0)

    return net, Fabric(
        rest_length=jnp.asarray(rest_length),
        stretch_stiffness=jnp.asarray(stretch_stiffness),
        rest_fold=jnp.asarray(fold),
        fold_stiffness=jnp.asarray(k_t),
        z_max=jnp.asarray(sheet.z_max, float),
        k_wall=jnp.asarray(sheet.k_wall, float),
        cell=jnp.asarray(cell),
    )


def flat_sheet(net: Network, fabric: Fabric) -> Float[Array, " unknown"]:
    """Flat configuration: nodes on the grid in the plane z = 0, then L_x and L_y [mm]."""
    y, x = np.mgrid[: net.shape.nodes_y, : net.shape.nodes_x]
    grid = jnp.asarray(np.stack([x, y], axis=-1).reshape(-1, 2)) * fabric.cell
    positions = jnp.concatenate([grid, jnp.zeros((net.shape.nodes, 1))], axis=1)
    lengths = fabric.cell * jnp.array([net.shape.cells_x, net.shape.cells_y])
    return jnp.concatenate([positions.ravel(), lengths])
