"""A knitted capacitor during a test: its capacitance in every state, or why it is missing."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from knitlab.io.progress import each
from knitlab.model.electrodes import Capacitor, Electrodes
from knitlab.model.energy import fold_angles
from knitlab.model.fabric import Configuration, Fabric
from knitlab.model.network import MeshShape, Network
from knitlab.model.surfaces import crossings
from knitlab.observables.capacitance.boundary_elements import two_terminal
from knitlab.observables.capacitance.maxwell import (
    STATES_AT_ONCE,
    Panels,
    Surroundings,
    gaps,
    limit,
    maxwell_matrices,
    surroundings,
    touching,
)
from knitlab.observables.capacitance.panels import panel_chart, panels_on
from knitlab.observables.capacitance.sensor import CapacitorStatus

CAUTION = 0.7
"""Estimated error over the change by extrapolation; on folds of 0.15 to 2 rad and at levels 1 to 3
the true error was never larger."""
LEVELS = (1, 2, 3, 4)
MAX_PANELS = 2400  # largest number of panels of a finer level


@dataclass(frozen=True, eq=False)
class Capacitances:
    """A capacitor in every state of a test."""

    status: Int[np.ndarray, " state"]  # a CapacitorStatus
    capacitance: Float[np.ndarray, " state"]  # without leads, of one period if periodic [pF]
    mutual: Float[np.ndarray, " state"]  # −C₁₂; NaN if periodic without a grounded plane [pF]
    error: Float[np.ndarray, " state"]  # estimated, relative, also where it is too large [1]
    gap: Float[np.ndarray, " state"]  # of the electrodes, searched up to a grid cell [mm]


def capacitances(
    electrodes: Electrodes,
    net: Network,
    fabric: Fabric,
    configurations: Configuration,
    capacitor: Capacitor,
    refinement: int = 1,
) -> Capacitances:
    """Capacitance in every one of several states, by boundary elements of two or more sizes.

    Panels are refined while the estimated error, :data:`CAUTION` times the last change, exceeds
    ``capacitor.accuracy``. There is no value if bare electrodes touch, or if electrodes or a fold
    at them have passed through each other. Gaps are searched up to ``refinement`` grid cells.
    """
    shape = net.shape
    states = len(configurations.lengths)
    axis = electrodes.axis if shape.periodic else None
    chart = panel_chart(electrodes, shape, LEVELS[0])
    panels = np.asarray(panels_on(chart, shape, configurations))
    around = surroundings(configurations, axis, capacitor)
    reach = refinement * float(np.asarray(fabric.cell_sides).max())
    gap = gaps(panels, chart.electrode, (0, 1), reach, around)
    folds = fold_angles(net, fabric, configurations)[:, _hinges_at(electrodes, net)]
    through = _crossing_itself(panels, chart.electrode, around)
    through |= (np.abs(folds) > np.pi).any(axis=-1)
    status = np.full(states, CapacitorStatus.measured)
    status[through] = CapacitorStatus.folded_through
    status[~through & touching(gap, capacitor)] = CapacitorStatus.touching
    value, mutual, error = (np.full(states, np.nan) for _ in range(3))
    coarse = np.full((states, 2), np.nan)
    coarse_level = 0
    pending = np.flatnonzero(status == CapacitorStatus.measured)
    for level in each(LEVELS, "capacitances"):
        chart = panel_chart(electrodes, shape, level)
        if not pending.size or (level > LEVELS[1] and len(chart.cell) > MAX_PANELS):
            break
        chosen = configurations[pending]
        panels = np.asarray(panels_on(chart, shape, chosen))
        around = surroundings(chosen, axis, capacitor)
        matrices = maxwell_matrices(panels, chart.electrode, 2, around, STATES_AT_ONCE)
        fine = np.full((states, 2), np.nan)
        fine[pending] = np.stack([two_terminal(matrices), -matrices[:, 0, 1]], axis=-1)
        if coarse_level:
            finest = limit(coarse, fine, coarse_level, level)
            value[pending], mutual[pending] = finest[pending].T
            change = np.abs(finest - fine)[pending, 0]
            error[pending] = CAUTION * change / np.abs(finest[pending, 0])
            pending = pending[~(error[pending] <= capacitor.accuracy)]
        coarse = fine
        coarse_level = level
    status[pending] = CapacitorStatus.unresolved
    unmeasured = status != CapacitorStatus.measured
    value[unmeasured] = mutual[unmeasured] = np.nan
    if shape.periodic and capacitor.ground == "none":
        mutual[:] = np.nan
    scale = capacitor.permittivity
    return Capacitances(status, scale * value, scale * mutual, error, gap)


def _crossing_itself(
    panels: Panels, electrode: Int[np.ndarray, " panel"], around: Surroundings
) -> Bool[np.ndarray, " state"]:
    periods = np.broadcast_to(around.periods[:2].T, (len(panels), 2))
    return np.array(
        [
            any(crossings(state[electrode == k], (x, y)) for k in (0, 1))
            for state, (x, y) in zip(panels, periods, strict=True)
        ]
    )


def mean_fold(
    electrodes: Electrodes, net: Network, fabric: Fabric, configurations: Configuration
) -> Float[np.ndarray, " state"]:
    """Mean angle of the folds at and between the electrodes and parallel to them [rad]."""
    rest = np.asarray(fabric.rest_fold)
    alongside = net.wale if electrodes.along == "wale" else ~net.wale
    counted = _hinges_at(electrodes, net) & alongside & (rest != 0)
    angles = fold_angles(net, fabric, configurations)
    return (angles * np.sign(rest))[:, counted].mean(axis=1)


def electrode_length(electrodes: Electrodes, shape: MeshShape, relaxed: Configuration) -> float:
    """Length of the electrodes on a relaxed fabric; that of one period if it is periodic [mm]."""
    axis = electrodes.axis
    if shape.periodic:
        return float(relaxed.lengths[axis])
    start, end = electrodes.strips[0][0].extents[axis]
    along = np.asarray(relaxed.positions)[..., axis].mean(axis=axis)
    ends = np.interp([start, end], np.arange(len(along)), along)
    return float(ends[1] - ends[0])


def _hinges_at(electrodes: Electrodes, net: Network) -> Bool[np.ndarray, " hinge"]:
    """Hinges on the electrodes or between them, also across the border of periodic fabric."""
    extents = np.array([strip.extents for strips in electrodes.strips for strip in strips])
    first = np.floor(extents[..., 0].min(axis=0))
    last = np.ceil(extents[..., 1].max(axis=0))
    edge = net.hinge_cells[:, ::-1]
    cells = (net.shape.cells_x, net.shape.cells_y)
    within = (edge >= first) & (edge < last)
    within |= (edge + cells < last) & net.shape.periodic
    return within.all(axis=1)
