"""The fabric: a network with the parameters of its elements, from which its energy follows."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float
from pydantic import PositiveFloat

from knitlab.fabric.array_library import array_library
from knitlab.fabric.configuration import Configuration
from knitlab.fabric.network import Network
from knitlab.fabric.options import FoldAngle, ModelOptions
from knitlab.fabric.setting_types import Unit
from knitlab.fabric.spring_curve import SpringCurve
from knitlab.fabric.spring_law import LINEAR, SpringLaw
from knitlab.fabric.stripe import Stripe


@dataclass(frozen=True)
class Sheet:
    """The walls between which every fabric lies, and its thickness.

    Attributes:
        z_max: half the gap between the walls [mm].
        k_wall: penalty stiffness of the walls [N/mm].
        thickness: distance that the middle surfaces of two plies keep; used with contact only [mm].
        contact_pressure: pressure scale at which they do [N/mm²].
    """

    z_max: Annotated[PositiveFloat, Unit("mm")]
    k_wall: Annotated[PositiveFloat, Unit("N/mm")]
    thickness: Annotated[PositiveFloat, Unit("mm")] = 0.1
    contact_pressure: Annotated[PositiveFloat, Unit("N/mm^2")] = 1.0


class Fabric(eqx.Module):
    """Parameters of one fabric on a network.

    Fabrics with the same mesh shape, kind of fold angle and kind of spring law can be stacked into
    a batch.

    Attributes:
        rest_length: of every spring [mm].
        stretch_stiffness: of every spring [N/mm].
        rest_fold: signed fold angle at rest of every hinge, 0 where flat, positive for a
            mountain [rad].
        fold_stiffness: of every hinge, 0 where the model options omit the hinge [N mm].
        z_max: half the gap between the walls [mm].
        k_wall: penalty stiffness of the walls [N/mm].
        cell_x: flat width of every column of grid cells [mm].
        cell_y: flat height of every row of grid cells [mm].
        fold_angle: definition of the fold angle, a model option.
        spring_law: force of the springs as a function of their length.
    """

    rest_length: Float[Array | np.ndarray, " spring"]
    stretch_stiffness: Float[Array | np.ndarray, " spring"]
    rest_fold: Float[Array | np.ndarray, " hinge"]
    fold_stiffness: Float[Array | np.ndarray, " hinge"]
    z_max: Float[Array | np.ndarray, ""]
    k_wall: Float[Array | np.ndarray, ""]
    cell_x: Float[Array | np.ndarray, " grid_x"]
    cell_y: Float[Array | np.ndarray, " grid_y"]
    fold_angle: FoldAngle = eqx.field(static=True)
    spring_law: SpringLaw = LINEAR

    @property
    def cell_sides(self) -> Float[Array | np.ndarray, " side"]:
        """Sides of all grid cells, those along x first [mm]."""
        return array_library(self.cell_x).concatenate([self.cell_x, self.cell_y])


class StripeNumbers(eqx.Module):
    """The parameters of a :class:`~knitlab.fabric.stripe.Stripe`, as variables of derivatives.

    Attributes:
        k_s: stiffness of the extensional springs across the ridges [N/mm].
        k_t: stiffness of the torsional springs, as tabulated [N].
        theta_0: interior rest angle of a fold [rad].
        period: measured peak-to-peak distance of the relaxed corrugation [mm].
        stiffening_strain: of its springs; infinite for stripes with another law, None if all
            stripes have another law [1].
        spring_curves: measured curve of the springs of each stripe, None for stripes with another
            law.
    """

    k_s: Float[Array | np.ndarray, "*quantity"]
    k_t: Float[Array | np.ndarray, "*quantity"]
    theta_0: Float[Array | np.ndarray, "*quantity"]
    period: Float[Array | np.ndarray, "*quantity"]
    stiffening_strain: Float[Array | np.ndarray, "*quantity"] | None = None
    spring_curves: tuple[SpringCurve | None, ...] = eqx.field(static=True, default=(None,))

    @classmethod
    def of(cls, stripe: Stripe) -> "StripeNumbers":
        """The parameters of a stripe."""
        stiffening = stripe.stiffening_strain
        return cls(
            k_s=np.asarray(stripe.k_s, float),
            k_t=np.asarray(stripe.k_t, float),
            theta_0=np.asarray(stripe.theta_0, float),
            period=np.asarray(stripe.period, float),
            stiffening_strain=None if stiffening is None else np.asarray(stiffening, float),
            spring_curves=(stripe.spring_curve,),
        )

    @classmethod
    def of_several(cls, stripes: Sequence[Stripe]) -> "StripeNumbers":
        """The parameters of several stripes, along one axis."""
        strains = [stripe.stiffening_strain for stripe in stripes]
        stiffening = [np.inf if strain is None else strain for strain in strains]
        return cls(
            k_s=np.array([stripe.k_s for stripe in stripes], float),
            k_t=np.array([stripe.k_t for stripe in stripes], float),
            theta_0=np.array([stripe.theta_0 for stripe in stripes], float),
            period=np.array([stripe.period for stripe in stripes], float),
            stiffening_strain=np.array(stiffening, float) if any(strains) else None,
            spring_curves=tuple(stripe.spring_curve for stripe in stripes),
        )

    @property
    def laws(self) -> tuple[list[Float[Array | np.ndarray, ""] | None], list[SpringCurve | None]]:
        """Stiffening strain and measured curve of the springs of each stripe."""
        count = len(self.spring_curves)
        if self.stiffening_strain is None:
            return [None] * count, list(self.spring_curves)
        strains = self.stiffening_strain.reshape(-1)
        return [strains[number] for number in range(count)], list(self.spring_curves)


class StripePair(eqx.Module):
    """Both stripes of a fabric; also a derivative with respect to each of their parameters.

    A graded fabric has several stripes of each knit, along an axis of the parameters.

    Attributes:
        weft: the rib stripe, whose period is w; for a pure stripe fabric, that stripe.
        warp: the garter stripe, whose period is h; for a pure stripe fabric, that stripe.
    """

    weft: StripeNumbers
    warp: StripeNumbers

    @classmethod
    def of(cls, weft: Stripe, warp: Stripe) -> "StripePair":
        """The parameters of two stripes."""
        return cls(StripeNumbers.of(weft), StripeNumbers.of(warp))

    @classmethod
    def of_several(cls, weft: Sequence[Stripe], warp: Sequence[Stripe]) -> "StripePair":
        """The parameters of several rib and several garter stripes."""
        return cls(StripeNumbers.of_several(weft), StripeNumbers.of_several(warp))


def cell_length(
    stripe: Stripe | StripeNumbers, options: ModelOptions
) -> Float[Array | np.ndarray, "*stripe"]:
    """Flat length of a grid cell across a stripe's ridges, by the option ``cell_size`` [mm]."""
    xp = array_library(stripe)
    part = xp.asarray(options.length_scale * stripe.period / options.cells_per_period)
    return part if options.cell_size == "flat" else part / xp.sin(stripe.theta_0 / 2)


def flat_sheet(net: Network, fabric: Fabric) -> Configuration:
    """Flat configuration: nodes on the grid in the plane z = 0 [mm]."""
    xp = array_library(fabric.cell_x, fabric.cell_y)
    x, y = (
        xp.concatenate([np.zeros(1), xp.cumsum(side)]) for side in (fabric.cell_x, fabric.cell_y)
    )
    shape = net.shape
    grid = xp.stack(xp.meshgrid(x[: shape.nodes_x], y[: shape.nodes_y]), axis=-1)
    heights = np.zeros((*grid.shape[:-1], 1))
    return Configuration(xp.concatenate([grid, heights], axis=-1), xp.stack([x[-1], y[-1]]))
