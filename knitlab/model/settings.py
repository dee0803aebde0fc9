"""Settings of a fabric: model options, sheet and plain knit, and the types of all settings.

``z_max: Annotated[PositiveFloat, Unit("mm")]`` is the only declaration of a setting, with its range
and unit: parameter files, workflows and the documentation derive from it.
"""

import math
from dataclasses import dataclass, replace
from typing import Annotated, Literal

from pydantic import Field, NonNegativeFloat, PositiveFloat

from knitlab.model.checked import Checked


@dataclass(frozen=True)
class Unit:
    """The unit of a setting, as UDUNITS text; a setting without unit is dimensionless."""

    symbol: str


Fraction = Annotated[float, Field(gt=0, le=1)]  # A fraction, above 0 and at most 1
Position = Annotated[float, Field(ge=0, le=1)]  # from 0 at the start of a length to 1 at its end
RestAngle = Annotated[float, Field(gt=0, lt=math.pi), Unit("rad")]  # π is flat

CellSize = Literal["flat", "relaxed"]
FoldPhase = Literal["stripe_centre", "stripe_border"]
GarterStart = Literal["mountain", "valley"]
FoldAngle = Literal["whole_normals", "across_edge"]
Boundary = Literal["clamped", "periodic"]
Contact = Literal["none", "barrier"]


@dataclass(frozen=True)
class ModelOptions(Checked):
    """One combination of model options: what the paper leaves open, recorded with every result.

    Attributes:
        cell_size: ``"flat"`` makes a grid cell w/4 × h/4 (Sec. "3D model"); ``"relaxed"`` makes
            it w/(4 sin(θ0/2)) × h/(4 sin(θ0/2)), so that the folded period is the measured one
            (Sec. "2D model" and the table captions).
        fold_phase: ``"stripe_centre"`` folds at the odd grid lines of a run of like patches,
            ``"stripe_border"`` at the even ones.
        hinges: ``"fold_lines"`` puts hinges only across the fold direction inside like patches
            (rest angles π and θ0 alternately); ``"all"`` adds every other interior edge, flat at
            rest, with the k_t of its direction: rib for edges along y, garter along x.
        hinge_stiffness: with ``"per_edge"`` each edge has k_t, with ``"per_length"``
            k_t × edge length, as its tabulated unit, N, suggests.
        garter_start: sense of the first fold of a garter patch; the first fold of a rib patch is a
            mountain, and folds alternate. In a periodic checkerboard with folds at stripe
            centres, whose number in a patch is even, both values give the same fabric.
        fold_angle: definition of the angle between two cells about their shared edge. A cell is
            not plane, and its normal may have a component along the edge. ``"whole_normals"`` is
            atan2((n1 × n2)·ê, n1·n2), which is discontinuous where both arguments vanish;
            ``"across_edge"`` uses the components of the normals across the edge, so that a
            rotation of a cell about the edge changes the fold angle by the same angle.
        length_scale: factor on the periods of the stripes, and thus on every grid length [1].
        cells_per_period: grid cells along one period, 4 in the paper; on a finer grid folds are
            rounded (:mod:`~knitlab.model.fold_lines`).
        ridge_fraction: part of a stripe that its rounded ridge covers; without effect on the
            paper's grid [1].
        contact: ``"none"`` lets a fabric pass through itself; with ``"barrier"`` its parts keep a
            distance of its thickness (:mod:`knitlab.solvers.equilibrium.contact_barrier`).
        boundary: ``"clamped"`` sample or ``"periodic"`` fabric without edges.
    """

    cell_size: CellSize = "flat"
    fold_phase: FoldPhase = "stripe_border"
    hinges: Literal["fold_lines", "all"] = "all"
    hinge_stiffness: Literal["per_edge", "per_length"] = "per_edge"
    garter_start: GarterStart = "mountain"
    fold_angle: FoldAngle = "whole_normals"
    length_scale: PositiveFloat = 1.0
    cells_per_period: Literal[4, 8, 16] = 4
    ridge_fraction: Fraction = 0.5
    contact: Contact = "none"
    boundary: Boundary = "clamped"


@dataclass(frozen=True)
class Friction(Checked):
    """Friction at the folds, relative to the stiffness k_t of each, and drift of their rest angles.

    Attributes:
        fold_friction: yield moment over k_t: the angle by which friction can shift the rest angle;
            0 for no friction [rad].
        fold_slide: angle over which friction builds up from none, half of what a fold turns back
            before it slips the other way; small against the angles of the test [rad].
        fold_hardening: growth of the yield moment with the angle slipped, over k_t [1].
        fold_drift: what a rest angle takes on of the change of its fold in the first cycle, at the
            largest strain; 1/c of that in cycle c, so that the set grows with its logarithm [1].
    """

    fold_friction: Annotated[float, Field(ge=0), Unit("rad")] = 0.0
    fold_slide: Annotated[PositiveFloat, Unit("rad")] = 0.05
    fold_hardening: Annotated[float, Field(ge=0)] = 0.0
    fold_drift: Annotated[float, Field(ge=0)] = 0.0

    @property
    def acts(self) -> bool:
        """Whether friction or drift makes loading and unloading differ."""
        return self.fold_friction > 0 or self.fold_drift > 0


NO_FRICTION = Friction()


@dataclass(frozen=True)
class Sheet(Checked):
    """The walls between which every fabric lies, and its thickness.

    ``z_max`` and ``thickness`` are lengths of the cloth if the size of its stitch is given. The
    lengths of a network, those of its stripes, may be others: then walls and thickness are scaled
    by the flat length of a stitch in the network, of the stripes in the tables, over that in the
    cloth.

    Attributes:
        z_max: half the gap between the walls [mm].
        k_wall: penalty stiffness of the walls [N/mm].
        thickness: distance that two middle surfaces keep; used with contact only [mm].
        contact_pressure: pressure scale at which they do [N/mm²].
        cloth_stitch_width: width of a stitch of the flat cloth, along the course; 0 if walls and
            thickness are lengths of the network [mm].
        cloth_stitch_height: height of a stitch of the flat cloth, along the wale, for stripes
            that fold along it; 0 as above [mm].
    """

    z_max: Annotated[PositiveFloat, Unit("mm")]
    k_wall: Annotated[PositiveFloat, Unit("N/mm")]
    thickness: Annotated[PositiveFloat, Unit("mm")] = 0.1
    contact_pressure: Annotated[PositiveFloat, Unit("N/mm^2")] = 1.0
    cloth_stitch_width: Annotated[NonNegativeFloat, Unit("mm")] = 0.0
    cloth_stitch_height: Annotated[NonNegativeFloat, Unit("mm")] = 0.0

    def on_network(self, ratio: float) -> "Sheet":
        """The sheet in lengths of the network, by their ratio to those of the cloth."""
        return replace(self, z_max=ratio * self.z_max, thickness=ratio * self.thickness)


@dataclass(frozen=True)
class PlainKnit(Checked):
    """Stiffness of plain knit (stockinette) as a continuous sheet, which is flat at rest.

    It does not depend on the grid: a spring along the weft of a cell a × b has
    k_s = ``plain_stretch_weft`` · b / a, and a hinge between two cells along the weft has
    k_t = ``plain_bend_weft`` · b / a; the same holds along the warp. Diagonals have the smaller
    k_s, as in all patches.

    Attributes:
        plain_stretch_weft: force along the weft per unit of width and strain, without diagonals
            [N/mm].
        plain_stretch_warp: the same along the warp [N/mm].
        plain_bend_weft: moment per unit of width and curvature along the weft [N mm].
        plain_bend_warp: the same along the warp [N mm].
    """

    plain_stretch_weft: Annotated[PositiveFloat, Unit("N/mm")]
    plain_stretch_warp: Annotated[PositiveFloat, Unit("N/mm")]
    plain_bend_weft: Annotated[PositiveFloat, Unit("N mm")]
    plain_bend_warp: Annotated[PositiveFloat, Unit("N mm")]


CONTACT_RANGE = 0.25  # reach of the contact barrier beyond one thickness, in thicknesses


def largest_thickness(cell: float, theta_0: float) -> float:
    """Thickness from which on the contact barrier would act in folds at their rest angles [mm].

    Nearest are the cell beside a fold and, on its other side, the next cell but one: in a fold at
    rest they are cell × sin(θ0) apart, or a cell in a blunt one. The cell is the shortest side.
    """
    return cell * math.sin(min(theta_0, math.pi / 2)) / (1 + CONTACT_RANGE)
