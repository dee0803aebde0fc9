"""Capacitance matrices of electrodes on a fabric, and what a meter between two of them reads."""

from collections.abc import Sequence
from itertools import combinations
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from knitlab.model.electrodes import Capacitor
from knitlab.model.fabric import Configuration
from knitlab.observables.capacitance.maxwell import (
    LEVELS,
    Matrices,
    Panels,
    Surroundings,
    extrapolated,
    gaps,
    maxwell_matrices,
    neutral,
    surroundings,
    touching,
)
from knitlab.observables.capacitance.panels import panels_on
from knitlab.sensors.electrode_set import ElectrodeSet

ROUND_OFF = 1e-9  # charge that leaves a pair of electrodes, over its own, that counts as none
Others = Literal["floating", "grounded"]


def electrode_matrices(
    panels: Panels, electrode: Int[np.ndarray, " panel"], count: int, around: Surroundings
) -> Matrices:
    """Maxwell's matrices in vacuum [pF]; of periodic electrodes without a plane, rows sum to 0."""
    matrices = maxwell_matrices(panels, electrode, count, around)
    return matrices if around.axis is None or around.ground is not None else neutral(matrices)


def capacitance_matrices(
    electrodes: ElectrodeSet, states: Configuration, capacitor: Capacitor, polarised: float = 0.0
) -> Matrices:
    """Maxwell's matrices in several states, NaN where electrodes touch, of one period [pF]."""
    around = surroundings(states, electrodes.axis, capacitor, polarised)
    count = len(electrodes.names)

    def solve(level: int) -> Matrices:
        chart = electrodes.chart(level, bare=polarised > 0)
        panels = np.asarray(panels_on(chart, electrodes.shape, states))
        return electrode_matrices(panels, chart.electrode, count, around)

    found = extrapolated(solve)
    chart = electrodes.chart(LEVELS[1])
    panels = np.asarray(panels_on(chart, electrodes.shape, states))
    for pair in combinations(range(count), 2):
        if not electrodes.overlapping(*pair):
            distance = gaps(panels, chart.electrode, pair, capacitor.clearance, around)
            found[touching(distance, capacitor)] = np.nan
    return capacitor.permittivity * found


def readings(
    matrices: Matrices, sensors: Sequence[tuple[int, int]], others: Others
) -> Float[np.ndarray, "state sensor"]:
    """What a meter between two electrodes shows; others carry no charge or are grounded [pF]."""
    found = []
    for one, other in sensors:
        if others == "grounded":
            found.append(-matrices[:, one, other])
            continue
        pair = np.array([one, other])
        rest = np.setdiff1d(np.arange(matrices.shape[1]), pair)
        own = matrices[:, pair[:, None], pair]
        across = matrices[:, pair[:, None], rest]
        if rest.size:
            inner = matrices[:, rest[:, None], rest]
            own = own - across @ np.linalg.solve(inner, np.swapaxes(across, 1, 2))
        # As ``two_terminal``, also of electrodes whose charges always sum to zero.
        one_left, other_left = own.sum(axis=2).T
        both = one_left + other_left
        floats = both > ROUND_OFF * own[:, 0, 0]
        series = one_left * other_left / np.where(floats, both, 1.0)
        found.append(np.where(floats, series, 0.0) - own[:, 0, 1])
    return np.stack(found, axis=1)
