"""The fabric: a network with the numbers of its stripes, ready to have its energy taken."""

from dataclasses import dataclass
from typing import Annotated

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from pydantic import PositiveFloat

from knitlab.model.configuration import Configuration
from knitlab.model.network import Network, mesh_shape, network
from knitlab.model.options import FoldAngle, ModelOptions
from knitlab.model.pattern import CELLS_PER_PERIOD, Pattern, fold_senses, inside_runs
from knitlab.model.setting_types import Unit
from knitlab.model.spring_curve import SpringCurve
from knitlab.model.spring_law import LINEAR, SpringLaw, spring_law
from knitlab.model.stripe import Stripe


@dataclass(frozen=True)
class Sheet:
    """What all fabrics share: the walls they lie between.

    Attributes:
        z_max: half the gap between the walls [mm].
        k_wall: penalty stiffness of the walls [N/mm].
    """

    z_max: Annotated[PositiveFloat, Unit("mm")]
    k_wall: Annotated[PositiveFloat, Unit("N/mm")]


class Fabric(eqx.Module):
    """Numbers of one fabric on a network.

    Those of one mesh shape, of one kind of fold angle and of one kind of spring law stack into a
    batch.

    Attributes:
        rest_length: of every spring [mm].
        stretch_stiffness: of every spring [N/mm].
        rest_fold: signed fold angle at rest of every hinge, 0 where flat, positive for a
            mountain [rad].
        fold_stiffness: of every hinge, 0 where the model options put none [N mm].
        z_max: half the gap between the walls [mm].
        k_wall: penalty stiffness of the walls [N/mm].
        cell: flat size of a grid cell along (x, y) [mm].
        fold_angle: what its fold angles are between.
        spring_law: how the force of its springs grows.
    """

    rest_length: Float[Array, " spring"]
    stretch_stiffness: Float[Array, " spring"]
    rest_fold: Float[Array, " hinge"]
    fold_stiffness: Float[Array, " hinge"]
    z_max: Float[Array, ""]
    k_wall: Float[Array, ""]
    cell: Float[Array, "2"]
    fold_angle: FoldAngle = eqx.field(static=True)
    spring_law: SpringLaw = LINEAR


class StripeNumbers(eqx.Module):
    """The numbers of a :class:`~knitlab.model.stripe.Stripe`, to take derivatives by.

    Attributes:
        k_s: stiffness of the extensional springs across the ridges [N/mm].
        k_t: stiffness of the torsional springs, as tabulated [N].
        theta_0: interior rest angle of a fold [rad].
        period: measured peak-to-peak distance of the relaxed corrugation [mm].
        stiffening_strain: of its springs, None where they have another law [1].
        spring_curve: of its springs, None where they have another law.
    """

    k_s: Float[Array, "*quantity"]
    k_t: Float[Array, "*quantity"]
    theta_0: Float[Array, "*quantity"]
    period: Float[Array, "*quantity"]
    stiffening_strain: Float[Array, "*quantity"] | None = None
    spring_curve: SpringCurve | None = eqx.field(static=True, default=None)

    @classmethod
    def of(cls, stripe: Stripe) -> "StripeNumbers":
        """Those of a stripe."""
        stiffening = stripe.stiffening_strain
        return cls(
            k_s=jnp.asarray(stripe.k_s, float),
            k_t=jnp.asarray(stripe.k_t, float),
            theta_0=jnp.asarray(stripe.theta_0, float),
            period=jnp.asarray(stripe.period, float),
            stiffening_strain=None if stiffening is None else jnp.asarray(stiffening, float),
            spring_curve=stripe.spring_curve,
        )


class StripePair(eqx.Module):
    """Both stripes of a fabric; also a derivative by each of their numbers.

    Attributes:
        weft: the rib stripe, whose period is w; for a pure stripe fabric, that stripe.
        warp: the garter stripe, whose period is h; for a pure stripe fabric, that stripe.
    """

    weft: StripeNumbers
    warp: StripeNumbers

    @classmethod
    def of(cls, weft: Stripe, warp: Stripe) -> "StripePair":
        """The numbers of two stripes."""
        return cls(StripeNumbers.of(weft), StripeNumbers.of(warp))


def cell_length(stripe: Stripe | StripeNumbers, options: ModelOptions) -> Float[Array, ""]:
    """Flat length of a grid cell across a stripe's ridges [mm]: the option ``cell_size``."""
    quarter = jnp.asarray(options.length_scale * stripe.period / CELLS_PER_PERIOD)
    return quarter if options.cell_size == "flat" else quarter / jnp.sin(stripe.theta_0 / 2)


@dataclass(frozen=True, eq=False)
class FabricLayout:
    """How a patterned fabric takes its numbers from its stripes: all of it but the numbers.

    Attributes:
        net: the network of its mesh shape.
        sheet: the walls.
        options: the choices that the paper leaves open.
        spring_kind: of every spring, 0 along the weft, 1 along the warp, 2 a diagonal.
        hinge_kind: of every hinge, 0 if it turns about an edge along y, else 1.
        fold_sense: of every hinge, 1 for a mountain, −1 for a valley, 0 where it rests flat.
        hinged: of every hinge, whether the model options put one there.
    """

    net: Network
    sheet: Sheet
    options: ModelOptions
    spring_kind: Int[np.ndarray, " spring"]
    hinge_kind: Int[np.ndarray, " hinge"]
    fold_sense: Float[np.ndarray, " hinge"]
    hinged: Bool[np.ndarray, " hinge"]

    def fabric(self, stripes: StripePair) -> Fabric:
        """The fabric of two stripes; pure JAX, so that derivatives pass through it.

        There is none by k_s where both stripes have the same: diagonals take the smaller, and the
        spring law of its stripe.
        """
        pair = stripes.weft, stripes.warp
        cell = jnp.stack([cell_length(stripe, self.options) for stripe in pair])
        k_s = jnp.stack([stripe.k_s for stripe in pair])
        k_t = jnp.stack([stripe.k_t for stripe in pair])
        if self.options.hinge_stiffness == "per_length":
            k_t = k_t * cell[::-1]
        rest_length = jnp.append(cell, jnp.hypot(*cell))
        stretch_stiffness = jnp.append(k_s, k_s.min())
        laws = spring_law(
            [stripe.stiffening_strain for stripe in pair], [stripe.spring_curve for stripe in pair]
        )
        along_spring = jnp.append(jnp.arange(2), k_s.argmin())
        fold = jnp.pi - jnp.stack([stripe.theta_0 for stripe in pair])
        return Fabric(
            rest_length=jnp.take(rest_length, self.spring_kind),
            stretch_stiffness=jnp.take(stretch_stiffness, self.spring_kind),
            rest_fold=jnp.asarray(self.fold_sense) * jnp.take(fold, self.hinge_kind),
            fold_stiffness=jnp.asarray(self.hinged) * jnp.take(k_t, self.hinge_kind),
            z_max=jnp.asarray(self.sheet.z_max, float),
            k_wall=jnp.asarray(self.sheet.k_wall, float),
            cell=cell,
            fold_angle=self.options.fold_angle,
            spring_law=laws.of(jnp.take(along_spring, self.spring_kind)),
        )


def patch_senses(
    pattern: Pattern, options: ModelOptions
) -> tuple[Float[np.ndarray, "row column"], Float[np.ndarray, "row column"]]:
    """Senses of the folds of rib and of garter patches, 1 for a mountain and −1 for a valley.

    Of rib at the edge to the left of every grid cell, of garter at the edge below it; 0 where the
    fabric rests flat.
    """
    rib, periodic = pattern.rib_cells, options.boundary == "periodic"
    garter_sign = 1 if options.garter_start == "mountain" else -1
    return (
        fold_senses(rib, options.fold_phase, periodic),
        garter_sign * fold_senses(~rib.T, options.fold_phase, periodic).T,
    )


def fabric_layout(pattern: Pattern, sheet: Sheet, options: ModelOptions) -> FabricLayout:
    """Where a patterned fabric has which spring, hinge and fold (paper, Sec. "3D model").

    Springs and hinges take their values by direction: those across the wales (springs along x,
    hinges about edges along y) from the weft stripe, those across the courses from the warp
    stripe, diagonals the smaller k_s. Folds lie where
    :func:`~knitlab.model.pattern.fold_senses` puts them, the first of a rib patch a mountain, of
    a garter patch as the option ``garter_start`` has it. Hinges that join unlike patches, or turn
    against their patch's folds, rest flat and exist only by the option ``hinges = "all"``.

    Args:
        pattern: which patch is rib and which garter.
        sheet: the walls.
        options: the choices that the paper leaves open.
    """
    shape = mesh_shape(pattern, options.boundary)
    net = network(shape)
    rib = pattern.rib_cells
    at = tuple(net.hinge_cells.T)
    rib_senses, garter_senses = patch_senses(pattern, options)
    hinged = np.ones(len(net.wale), dtype=bool)
    if options.hinges == "fold_lines":
        in_rib = inside_runs(rib, shape.periodic)
        in_garter = inside_runs(~rib.T, shape.periodic).T
        hinged = np.where(net.wale, in_rib[at], in_garter[at])
    return FabricLayout(
        net=net,
        sheet=sheet,
        options=options,
        spring_kind=np.select([net.weft, net.warp], [0, 1], 2),
        hinge_kind=np.where(net.wale, 0, 1),
        fold_sense=np.where(net.wale, rib_senses[at], garter_senses[at]),
        hinged=hinged,
    )


def assemble_fabric(
    pattern: Pattern, weft: Stripe, warp: Stripe, sheet: Sheet, options: ModelOptions
) -> tuple[Network, Fabric]:
    """Network and numbers of a patterned fabric, see :func:`fabric_layout`.

    Args:
        pattern: which patch is rib and which garter.
        weft: the rib stripe; for a pure stripe fabric, that stripe.
        warp: the garter stripe; for a pure stripe fabric, that stripe.
        sheet: the walls.
        options: the choices that the paper leaves open.
    """
    layout = fabric_layout(pattern, sheet, options)
    return layout.net, layout.fabric(StripePair.of(weft, warp))


def flat_sheet(net: Network, fabric: Fabric) -> Configuration:
    """Flat configuration: nodes on the grid in the plane z = 0 [mm]."""
    y, x = np.mgrid[: net.shape.nodes_y, : net.shape.nodes_x]
    grid = jnp.asarray(np.stack([x, y], axis=-1)) * fabric.cell
    heights = jnp.zeros((*grid.shape[:-1], 1))
    lengths = fabric.cell * jnp.array([net.shape.cells_x, net.shape.cells_y])
    return Configuration(jnp.concatenate([grid, heights], axis=-1), lengths)
