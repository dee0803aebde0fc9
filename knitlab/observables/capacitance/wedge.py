"""Capacitance by the wedge integral: a fast estimate for two strips side by side.

Field lines are approximated by arcs about the line midway between the strips, in front of the
fabric and behind it. Each wedge of angle θ has C = ε L G, G = ln(r2/r1)/θ, or width over distance
of parallel plates. With its fringe field it has C = ε L K(k')/2K(k), k = exp(−π G): r^(π/θ) maps it
to a half plane with two coplanar strips. That is exact for flat fabric, and G + ln 4/π for a narrow
wedge.
"""

import math
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from knitlab.model.electrodes import Electrodes
from knitlab.model.fabric import Configuration
from knitlab.model.network import MeshShape
from knitlab.observables.capacitance.boundary_elements import VACUUM_PERMITTIVITY
from knitlab.observables.capacitance.panels import points_on

POINTS_A_CELL = 3  # Gauss points in each part of a grid cell, along each direction
MEAN_STEPS = 8  # steps of the arithmetic-geometric mean
SMALLEST, TIGHT = 1e-12, 12.0  # G of a negligible wedge, and of one for which G + ln 4/π is exact


def side_by_side(electrodes: Electrodes) -> bool:
    """Whether both electrodes are single strips of equal width side by side."""
    if any(len(strips) != 1 for strips in electrodes.strips):
        return False
    across = 1 - electrodes.axis
    extents = [strips[0].extents for strips in electrodes.strips]
    (left, right), (other_left, other_right) = (extent[across] for extent in extents)
    same_width = math.isclose(right - left, other_right - other_left)
    return extents[0][electrodes.axis] == extents[1][electrodes.axis] and same_width


@partial(jax.jit, static_argnames=("electrodes", "shape"))
def wedge_capacitance(
    electrodes: Electrodes, shape: MeshShape, configuration: Configuration
) -> Float[Array, "*state"]:
    """Capacitance between two strips in vacuum, by the wedge integral, differentiable [pF].

    Raises ValueError if the electrodes are not two strips :func:`side_by_side`.
    """
    if not side_by_side(electrodes):
        raise ValueError("the wedge integral needs two strips of equal width, side by side")
    axis = electrodes.axis
    across = 1 - electrodes.axis
    left, right = sorted(
        (strips[0].extents for strips in electrodes.strips), key=lambda e: e[across]
    )
    middle = (left[across][1] + right[across][0]) / 2
    reach, reach_weight = _gauss(
        _cut(right[across][0] - middle, right[across][1] - middle, (middle, -middle))
    )
    run, run_weight = _gauss(_cut(*left[axis], (0.0,)))
    # Mirror images about the centre line: first the left strip, then the right.
    plates = [_plate(middle + side * reach, run, axis, shape, configuration) for side in (-1, 1)]
    chord = jnp.linalg.norm(plates[1][0] - plates[0][0], axis=-1)
    outwards = -plates[0][1], plates[1][1]
    lengthwise = plates[0][2] + plates[1][2]
    lengthwise /= jnp.linalg.norm(lengthwise, axis=-1, keepdims=True)
    turn = (jnp.cross(*outwards) * lengthwise).sum(axis=-1)
    angle = jnp.arctan2(turn, (outwards[0] * outwards[1]).sum(axis=-1)) % (2 * jnp.pi)
    area = sum(jnp.linalg.norm(jnp.cross(plate[1], plate[2]), axis=-1) for plate in plates) / 2
    length = sum(jnp.linalg.norm(plate[2], axis=-1) for plate in plates) / 2
    total = jnp.zeros(chord.shape[:-2])
    for wedge in (angle, 2 * jnp.pi - angle):
        # The length of an arc is chord × (θ/2)/sin(θ/2), infinite behind parallel plates.
        across_gap = jnp.sinc(wedge / (2 * jnp.pi)) / chord
        ratio = (reach_weight * (area / length) * across_gap).sum(axis=-1)
        total += (run_weight * length.mean(axis=-1) * with_ends(ratio)).sum(axis=-1)
    return VACUUM_PERMITTIVITY * total


def with_ends(ratio: Float[Array, "*wedge"]) -> Float[Array, "*wedge"]:
    """K(k')/2K(k) for k = exp(−π G): a wedge of G = ``ratio`` with its fringe field."""
    bounded = jnp.clip(ratio, SMALLEST, TIGHT)
    small = jnp.exp(-jnp.pi * bounded)
    exact = _mean(jnp.sqrt(-jnp.expm1(-2 * jnp.pi * bounded))) / _mean(small) / 2
    return jnp.where(ratio > TIGHT, ratio + jnp.log(4.0) / jnp.pi, exact)


def _mean(other: Float[Array, "*number"]) -> Float[Array, "*number"]:
    """Arithmetic-geometric mean of 1 and another number."""
    one = jnp.ones_like(other)
    for _ in range(MEAN_STEPS):
        one, other = (one + other) / 2, jnp.sqrt(one * other)
    return one


def _plate(
    at: Float[np.ndarray, " reach"],
    run: Float[np.ndarray, " run"],
    axis: int,
    shape: MeshShape,
    configuration: Configuration,
) -> tuple[Float[Array, "*state run reach 3"], ...]:
    """Points of a strip, and the tangents across and along it per grid cell [mm]."""
    places = np.stack(np.meshgrid(at, run), axis=-1).reshape(-1, 2)[:, :: 1 if axis == 1 else -1]
    cells = np.floor(places).astype(int)

    def on(places: Float[np.ndarray, "point 2"]) -> Float[Array, "*state run reach 3"]:
        points = points_on(places, cells[:, ::-1], shape, configuration)
        return jnp.asarray(points).reshape(*points.shape[:-2], len(run), len(at), 3)

    def tangent(along: int) -> Float[Array, "*state run reach 3"]:
        low = places.copy()
        high = places.copy()
        low[:, along] = cells[:, along]
        high[:, along] = cells[:, along] + 1
        return on(high) - on(low)

    return on(places), tangent(1 - axis), tangent(axis)


def _cut(low: float, high: float, origins: tuple[float, ...]) -> list[float]:
    """An interval, divided at the borders of grid cells counted from each origin."""
    lines = {low, high}
    for origin in origins:
        cell = np.arange(np.floor(low + origin) + 1, np.ceil(high + origin)) - origin
        lines |= {line for line in cell.tolist() if low < line < high}
    return sorted(lines)


def _gauss(lines: list[float]) -> tuple[Float[np.ndarray, " point"], Float[np.ndarray, " point"]]:
    """Gauss points and weights of the intervals between lines."""
    node, weight = np.polynomial.legendre.leggauss(POINTS_A_CELL)
    edges = np.array(lines)
    middle = (edges[1:] + edges[:-1]) / 2
    half = np.diff(edges) / 2
    return (middle[:, None] + half[:, None] * node).ravel(), (half[:, None] * weight).ravel()
