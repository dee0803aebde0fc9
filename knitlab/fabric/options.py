"""Model options: what the paper leaves open, as settings that every result records."""

from dataclasses import dataclass
from typing import Literal

from pydantic import PositiveFloat

from knitlab.fabric.setting_types import Fraction

CellSize = Literal["flat", "relaxed"]
FoldPhase = Literal["stripe_centre", "stripe_border"]
Hinges = Literal["fold_lines", "all"]
HingeStiffness = Literal["per_edge", "per_length"]
GarterStart = Literal["mountain", "valley"]
FoldAngle = Literal["whole_normals", "across_edge"]
Contact = Literal["none", "barrier"]
Boundary = Literal["clamped", "periodic"]
CellsPerPeriod = Literal[4, 8, 16]


@dataclass(frozen=True)
class ModelOptions:
    """One combination of model options.

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
            rounded (:mod:`~knitlab.fabric.fold_lines`).
        ridge_fraction: part of a stripe that its rounded ridge covers; without effect on the
            paper's grid [1].
        contact: ``"none"`` lets a fabric pass through itself; with ``"barrier"`` its parts keep a
            distance of its thickness (:mod:`knitlab.fabric.barrier`).
        boundary: ``"clamped"`` sample or ``"periodic"`` fabric without edges.
    """

    cell_size: CellSize = "flat"
    fold_phase: FoldPhase = "stripe_border"
    hinges: Hinges = "all"
    hinge_stiffness: HingeStiffness = "per_edge"
    garter_start: GarterStart = "mountain"
    fold_angle: FoldAngle = "whole_normals"
    length_scale: PositiveFloat = 1.0
    cells_per_period: CellsPerPeriod = 4
    ridge_fraction: Fraction = 0.5
    contact: Contact = "none"
    boundary: Boundary = "clamped"
