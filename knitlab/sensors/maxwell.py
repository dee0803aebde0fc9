"""Maxwell's capacitance matrix of electrodes on a fabric, in air or on cloth that polarises."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree

from knitlab.model.electrodes import Capacitor
from knitlab.model.fabric import Configuration
from knitlab.model.surfaces import gap_between
from knitlab.observables.capacitance import boundary_elements as bem
from knitlab.observables.capacitance.capacitor import ORDER, STATES_AT_ONCE
from knitlab.observables.capacitance.panels import panels_on
from knitlab.sensors.electrode_set import ElectrodeSet

LEVELS = (1, 2)  # sizes of panels from which a matrix is extrapolated
GAIN = 1 / ((LEVELS[1] / LEVELS[0]) ** ORDER - 1)  # and the part of their difference to add
CLOSED = 1e-9  # charge that leaves a pair of electrodes, over its own, which is round-off
Others = Literal["floating", "grounded"]
Panels = Float[np.ndarray, "state panel 4 3"]
Matrices = Float[np.ndarray, "state electrode electrode"]


@dataclass(frozen=True)
class Around:
    """What surrounds panels: their images along an axis, a grounded plane, an insulation."""

    axis: int | None = None
    period: Float[np.ndarray, " state"] | None = None  # [mm]
    ground: Float[np.ndarray, " state"] | None = None  # height of a grounded plane [mm]
    apart: float = 0.0  # thickness of insulation between different electrodes [mm]
    polarised: float = 0.0  # (relative permittivity of the cloth - 1) times its thickness [mm]


def matrices_of(
    panels: Panels, number: Int[np.ndarray, " panel"], count: int, around: Around
) -> Matrices:
    """Maxwell's matrices in air of ``count`` electrodes [pF].

    Panels whose ``number`` is ``count`` are cloth without an electrode. The cloth is a thin sheet:
    a field E along it polarises it by ε0 ``polarised`` E over its width; across it the field is
    that of air. Of periodic electrodes without a plane, only charges that sum to zero have
    potentials, and the rows of the matrix sum to zero.
    """
    images = None
    if around.axis is not None and around.period is not None:
        images = bem.images_along(around.axis, panels, around.period, around.ground)
    near = bem.near_pairs(panels, images, around.period)
    member = np.eye(count + 1)[number][:, :count]
    unknown = np.eye(len(number)) if around.polarised else member
    found = []
    size = math.ceil(len(panels) / math.ceil(len(panels) / STATES_AT_ONCE))
    for first in range(0, len(panels), size):
        # The last batch is padded, as a smaller one would be compiled separately.
        batch = np.minimum(np.arange(first, first + size), len(panels) - 1)
        given = (None if each is None else each[batch] for each in (around.period, around.ground))
        period, ground = (None if each is None else jnp.asarray(each) for each in given)
        matrices = bem.maxwell_matrices(
            *map(jnp.asarray, (panels[batch], unknown, near)), images, period, around.apart, ground
        )
        found.append(np.asarray(matrices))
    whole = np.concatenate(found)[: len(panels)]
    if around.polarised:
        turns = np.zeros((len(panels), 3))
        if images is not None:
            turns[:, images.axis] = around.period
        states = zip(whole, panels, turns, strict=True)
        whole = np.array(
            [_with_cloth(one, of, member, around.polarised, turn) for one, of, turn in states]
        )
    if images is not None and around.ground is None:
        of_rows = whole.sum(axis=2)
        total = of_rows.sum(axis=1)[:, None, None]
        whole = whole - of_rows[:, :, None] * of_rows[:, None, :] / total
    return whole


def _with_cloth(
    inverse: Float[np.ndarray, "panel panel"],
    panels: Float[np.ndarray, "panel 4 3"],
    member: Float[np.ndarray, "panel electrode"],
    polarised: float,
    period: Float[np.ndarray, "3"],
) -> Float[np.ndarray, "electrode electrode"]:
    """The matrix on polarised cloth, from the inverse of the potentials of all panels in air.

    Bare panels have the charge of the polarisation, which flows between neighbours as a current
    would through a sheet: the divergence of ε0 ``polarised`` times the gradient of the potential.
    """
    following = np.roll(panels, -1, axis=1)
    middles, lengths = (panels + following) / 2, np.linalg.norm(following - panels, axis=-1)
    reach = np.linalg.norm(middles - panels.mean(axis=1)[:, None], axis=-1)
    points, count = middles.reshape(-1, 3), middles.size // 3
    images = [points, points + period] if period.any() else [points]
    # Panels are neighbours where the middles of two sides are one point.
    pairs = cKDTree(np.concatenate(images)).query_pairs(1e-6 * lengths.max(), output_type="ndarray")
    one, other = (pairs[(pairs < count).any(axis=1)] % count).T
    bare = member.sum(axis=1) == 0
    # Up to the edge an electrode has one potential.
    distance = (reach * bare[:, None]).ravel()
    distance = distance[one] + distance[other]
    between = distance > 0
    flow = lengths.ravel()[one][between] / distance[between]
    one, other = one[between] // 4, other[between] // 4
    sheet = np.zeros_like(inverse)
    for rows, columns in ((one, other), (other, one)):
        np.add.at(sheet, (rows, columns), -flow)
        np.add.at(sheet, (rows, rows), flow)
    stiff = inverse + bem.VACUUM_PERMITTIVITY * polarised * sheet
    fixed = stiff @ member
    free = np.linalg.solve(stiff[np.ix_(bare, bare)], fixed[bare])
    return np.asarray(member.T @ fixed - fixed[bare].T @ free)


def capacitance_matrices(
    of_set: ElectrodeSet, states: Configuration, capacitor: Capacitor, polarised: float = 0.0
) -> Matrices:
    """Maxwell's matrices of a set in several states without leads, NaN where electrodes touch [pF].

    Those of one period if periodic. Electrodes that lie on each other by design are insulated.
    """
    ground = period = None
    if capacitor.ground == "plane":
        lowest = np.asarray(states.positions)[..., 2].min(axis=(1, 2))
        ground = lowest - capacitor.ground_distance
    if of_set.axis is not None:
        period = np.asarray(states.lengths)[:, of_set.axis]
    around = Around(of_set.axis, period, ground, capacitor.dielectric_thickness, polarised)
    found = []
    for level in LEVELS:
        chart = of_set.charts(level, bare=polarised > 0)
        panels = np.asarray(panels_on(chart, of_set.shape, states))
        found.append(matrices_of(panels, chart.electrode, len(of_set.names), around))
    matrices = found[1] + GAIN * (found[1] - found[0])
    for one, other in combinations(range(len(of_set.names)), 2):
        if of_set.overlapping(one, other):
            continue
        for state, of_state in enumerate(panels):
            first, second = (of_state[chart.electrode == number] for number in (one, other))
            periods = [0.0, 0.0]
            if of_set.axis is not None and period is not None:
                periods[of_set.axis] = float(period[state])
            gap = gap_between(first, second, capacitor.clearance, (periods[0], periods[1]))
            if gap == 0 or (gap < capacitor.clearance and not capacitor.dielectric_thickness):
                matrices[state] = np.nan
    return capacitor.permittivity * matrices


def readings(
    matrices: Matrices, sensors: Sequence[tuple[int, int]], others: Others
) -> Float[np.ndarray, "state sensor"]:
    """What a meter between two electrodes shows, with all other electrodes held so [pF].

    ``floating`` ones carry no charge, ``grounded`` ones are connected to the guard of the meter,
    which then shows the mutual capacitance alone.
    """
    found = []
    for one, other in sensors:
        if others == "grounded":
            found.append(-matrices[:, one, other])
            continue
        pair = np.array([one, other])
        rest = np.setdiff1d(np.arange(matrices.shape[1]), pair)
        own, across = matrices[:, pair[:, None], pair], matrices[:, pair[:, None], rest]
        if rest.size:
            inner = matrices[:, rest[:, None], rest]
            own = own - across @ np.linalg.solve(inner, np.swapaxes(across, 1, 2))
        # As ``two_terminal``, also of electrodes whose charges always sum to zero.
        one_left, other_left = own.sum(axis=2).T
        both = one_left + other_left
        floats = both > CLOSED * own[:, 0, 0]
        series = one_left * other_left / np.where(floats, both, 1.0)
        found.append(np.where(floats, series, 0.0) - own[:, 0, 1])
    return np.stack(found, axis=1)
