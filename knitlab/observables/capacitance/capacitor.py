"""A knitted capacitor during a test: its capacitance in every state, or why it is missing."""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from knitlab.model.electrodes import Capacitor, Electrodes
from knitlab.model.energy import fold_angles
from knitlab.model.fabric import Configuration, Fabric
from knitlab.model.network import MeshShape, Network
from knitlab.model.surfaces import crossings, gap_between
from knitlab.observables.capacitance import boundary_elements as bem
from knitlab.observables.capacitance.panels import PanelChart, panel_chart, panels_on
from knitlab.observables.capacitance.sensor import CapacitorStatus

STATES_AT_ONCE = 4  # states that are computed together
ORDER = 2  # order of convergence of the capacitance with the size of graded panels
CAUTION = 0.7
"""Estimated error over the change by extrapolation; on folds of 0.15 to 2 rad and at levels 1 to 3
the true error was never larger."""
LEVELS = (1, 2, 3, 4)
MOST_PANELS = 2400  # largest number of panels of a finer level


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

    A value is extrapolated from the last two sizes; the estimated error is :data:`CAUTION` times
    the change. Panels are refined while the error exceeds ``capacitor.accuracy``. There is no
    value if bare electrodes touch, or if electrodes or a fold at them have passed through each
    other or themselves. Gaps are searched up to the length of a cell of the paper's grid, which is
    ``refinement`` cells long.
    """
    shape, states = net.shape, len(configurations.lengths)
    status = np.full(states, CapacitorStatus.measured)
    reach = refinement * float(np.asarray(fabric.cell_sides).max())
    gap, through = _obstacles(electrodes, shape, configurations, reach)
    folds = fold_angles(net, fabric, configurations)[:, _hinges_at(electrodes, net)]
    through |= (np.abs(folds) > np.pi).any(axis=-1)
    status[through] = CapacitorStatus.folded_through
    closed = gap == 0 if capacitor.dielectric_thickness else gap < capacitor.clearance
    status[~through & closed] = CapacitorStatus.touching
    value, mutual, error = (np.full(states, np.nan) for _ in range(3))
    coarse, coarse_level = np.full((states, 2), np.nan), 0
    pending = np.flatnonzero(status == CapacitorStatus.measured)
    for level in LEVELS:
        chart = panel_chart(electrodes, shape, level)
        if not pending.size or (level > LEVELS[1] and len(chart.cell) > MOST_PANELS):
            break
        fine = np.full((states, 2), np.nan)
        fine[pending] = _in_vacuum(electrodes, chart, shape, configurations[pending], capacitor)
        if coarse_level:
            gain = 1 / ((level / coarse_level) ** ORDER - 1)
            limit = fine + gain * (fine - coarse)
            value[pending], mutual[pending] = limit[pending].T
            error[pending] = CAUTION * np.abs(limit - fine)[pending, 0] / np.abs(limit[pending, 0])
            pending = pending[~(error[pending] <= capacitor.accuracy)]
        coarse, coarse_level = fine, level
    status[pending] = CapacitorStatus.unresolved
    unmeasured = status != CapacitorStatus.measured
    value[unmeasured] = mutual[unmeasured] = np.nan
    if shape.periodic and capacitor.ground == "none":
        mutual[:] = np.nan
    scale = capacitor.permittivity
    return Capacitances(status, scale * value, scale * mutual, error, gap)


def _in_vacuum(
    electrodes: Electrodes,
    chart: PanelChart,
    shape: MeshShape,
    configurations: Configuration,
    capacitor: Capacitor,
) -> Float[np.ndarray, "state 2"]:
    """Two-terminal and mutual capacitance in vacuum [pF]."""
    panels = np.asarray(panels_on(chart, shape, configurations))
    period = np.asarray(configurations.lengths)[:, electrodes.axis]
    ground = None
    if capacitor.ground == "plane":
        lowest = np.asarray(configurations.positions)[..., 2].min(axis=(1, 2))
        ground = lowest - capacitor.ground_distance
    images = bem.images_along(electrodes.axis, panels, period, ground) if shape.periodic else None
    near, membership = bem.near_pairs(panels, images, period), np.eye(2)[chart.electrode]
    values = []
    for first in range(0, len(panels), STATES_AT_ONCE):
        # The last batch is padded, as a smaller one would be compiled separately.
        batch = np.minimum(np.arange(first, first + STATES_AT_ONCE), len(panels) - 1)
        matrices = bem.maxwell_matrices(
            jnp.asarray(panels[batch]),
            jnp.asarray(membership),
            jnp.asarray(near),
            images,
            jnp.asarray(period[batch]),
            capacitor.dielectric_thickness,
            None if ground is None else jnp.asarray(ground[batch]),
        )
        values.append(np.stack([bem.two_terminal(matrices), -matrices[:, 0, 1]], axis=-1))
    return np.concatenate(values)[: len(panels)]


def _obstacles(
    electrodes: Electrodes, shape: MeshShape, configurations: Configuration, reach: float
) -> tuple[Float[np.ndarray, " state"], Bool[np.ndarray, " state"]]:
    """Distance of the electrodes in every state, and whether one passes through itself."""
    chart = panel_chart(electrodes, shape, LEVELS[0])
    panels = np.asarray(panels_on(chart, shape, configurations))
    lengths = np.asarray(configurations.lengths) * np.eye(2)[electrodes.axis] * shape.periodic
    gaps, through = [], []
    for panels_of_state, periods in zip(panels, lengths, strict=True):
        one, other = (panels_of_state[chart.electrode == k] for k in (0, 1))
        gaps.append(gap_between(one, other, reach, periods))
        through.append(crossings(one, periods) + crossings(other, periods) > 0)
    return np.array(gaps), np.array(through)


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
    first, last = np.floor(extents[..., 0].min(axis=0)), np.ceil(extents[..., 1].max(axis=0))
    edge, cells = net.hinge_cells[:, ::-1], (net.shape.cells_x, net.shape.cells_y)
    within = (edge >= first) & (edge < last)
    within |= (edge + cells < last) & net.shape.periodic
    return within.all(axis=1)
