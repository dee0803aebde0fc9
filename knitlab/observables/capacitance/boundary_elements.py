"""Capacitance of conductors divided into panels, by the boundary-element method.

Every panel carries a uniform charge. The mean potential on one panel due to a unit charge on
another (Galerkin's method) fills a symmetric matrix, whose inverse, summed over the panels of each
conductor, is Maxwell's capacitance matrix. Potentials of near panels are in closed form (Wilton et
al., IEEE T-AP 32, 1984), others by quadrature.
"""

import math
from itertools import product
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from scipy.spatial import cKDTree
from scipy.special import zeta

from knitlab.solvers.dynamics.vectors import Vector, cross, dot, norm, scale, subtract

VACUUM_PERMITTIVITY = 8.8541878128e-3  # ε0 [pF/mm] (CODATA 2018)

NEAR = 2.0  # largest distance of the centres of near panels, over the size of the larger one
POINTS_A_SIDE = 2  # Gauss points along each side of a panel
PAIRS_AT_ONCE = 512  # near pairs that are computed together
PAIRS_RATIO = 1.25  # ratio of successive numbers of pairs for which a program is compiled
TIE = 1e-9  # relative difference in size above which one panel counts as larger
MIN_IMAGES = 2
IMAGES_AN_EXTENT = 3  # distance of multipole images, over the width of conductors
SMALLEST = 1e-300  # keeps quotients finite where their factor is zero

Matrix = Float[Array, "panel panel"]


class Images(eqx.Module):
    """Periodic repetition of all conductors along x (0) or y (1).

    The nearest ``count`` images on either side are summed one by one; those ``beyond``, with their
    ζ(3) and ζ(5), as second and fourth multipoles.
    """

    count: Int[Array, ""]
    beyond: Float[Array, "2"]
    axis: int = eqx.field(static=True)


def images_along(
    axis: int,
    panels: Float[np.ndarray, "state panel 4 3"],
    period: Float[np.ndarray, " state"],
    ground: Float[np.ndarray, " state"] | None = None,
) -> Images:
    """Enough images for the multipoles of the others to converge."""
    if ground is not None:
        mirror = _mirrored(panels, ground[:, None, None, None])
        panels = np.concatenate([panels, mirror], axis=1)
    across = np.delete(panels, axis, axis=-1)
    extent = np.linalg.norm(np.ptp(across, axis=(1, 2)), axis=-1)
    count = max(MIN_IMAGES, math.ceil(IMAGES_AN_EXTENT * float((extent / period).max())))
    beyond = jnp.array([zeta(power, count + 1) for power in (3, 5)])
    return Images(jnp.asarray(count), beyond, axis)


def near_pairs(
    panels: Float[np.ndarray, "state panel 4 3"],
    images: Images | None = None,
    period: Float[np.ndarray, " state"] | None = None,
) -> Int[np.ndarray, "pair 2"]:
    """Pairs of panels that are near in any state, each once, the larger panel second, padded."""
    states, count = panels.shape[:2]
    turns = np.zeros((states, 3))
    if images is not None:
        turns[:, images.axis] = period
    near = np.eye(count, dtype=bool)
    extent = np.zeros(count)
    for corners, turn in zip(panels, turns, strict=True):
        centre = corners.mean(axis=1)
        size = np.linalg.norm(corners - np.roll(corners, 2, axis=1), axis=-1).max(axis=1)
        extent = np.maximum(extent, size)
        tree = cKDTree(centre)
        for image in (-1, 0, 1) if turn.any() else (0,):
            distances = tree.sparse_distance_matrix(
                cKDTree(centre + image * turn), NEAR * size.max(), output_type="coo_matrix"
            )
            close = distances.data <= NEAR * np.maximum(size[distances.row], size[distances.col])
            near[distances.row[close], distances.col[close]] = True
    pairs = np.argwhere(np.triu(near | near.T))
    first, second = extent[pairs].T
    # Gauss points of a large panel would not resolve the potential of a small one close to it.
    turned = first > second * (1 + TIE)
    pairs[turned] = pairs[turned, ::-1]
    # The number of pairs is rounded up, so that few programs are compiled for many shapes.
    steps = math.ceil(math.log(max(len(pairs) / PAIRS_AT_ONCE, 1), PAIRS_RATIO))
    filled = PAIRS_AT_ONCE * math.ceil(PAIRS_RATIO**steps)
    return np.concatenate([pairs, np.repeat(pairs[-1:], filled - len(pairs), axis=0)])


@jax.jit
def maxwell_matrices(
    panels: Float[Array, "state panel 4 3"],
    membership: Float[Array, "panel conductor"],
    near: Int[Array, "pair 2"],
    images: Images | None = None,
    period: Float[Array, " state"] | None = None,
    insulation: Float[Array, ""] | float = 0.0,
    ground: Float[Array, " state"] | None = None,
) -> Float[Array, "state conductor conductor"]:
    """Maxwell's capacitance matrices in vacuum [pF], NaN if panels are inside each other.

    For periodic conductors they give the charge of one period; without a grounded plane only
    :func:`two_terminal` is meaningful. ``membership`` is 1 if a panel belongs to a conductor.
    Between different conductors, with an ``insulation`` d, a distance r counts as √(r² + d²) [mm].
    A grounded plane is at a height ``ground`` below all panels [mm].
    """
    insulation_squared = insulation**2 * (1 - membership @ membership.T)

    def one_state(panels: Array, period: Array, ground: Array | None) -> Array:
        conductors = _Conductors(panels, near, images, period, insulation_squared)
        lower = jnp.linalg.cholesky(conductors.potential_coefficients(ground))
        half = jax.scipy.linalg.solve_triangular(lower, membership, lower=True)
        return half.T @ half

    periods = jnp.ones(len(panels)) if period is None else period
    matrices = jax.vmap(one_state)(panels, periods, ground)
    return 4 * jnp.pi * VACUUM_PERMITTIVITY * matrices


def two_terminal(
    matrix: Float[Array | np.ndarray, "*state 2 2"],
) -> Float[Array | np.ndarray, "*state"]:
    """Capacitance between two conductors with opposite charges, as a meter measures it [pF]."""
    one = matrix[..., 0, 0]
    other = matrix[..., 1, 1]
    mutual = matrix[..., 0, 1]
    return (one * other - mutual**2) / (one + other + 2 * mutual)


class _Conductors(eqx.Module):
    panels: Float[Array, "panel 4 3"]
    near: Int[Array, "pair 2"]
    images: Images | None
    period: Float[Array, ""]
    insulation_squared: Matrix

    def potential_coefficients(self, ground: Float[Array, ""] | None) -> Matrix:
        """4πε0 times the mean potential on each panel due to a unit charge on each [1/mm].

        With images it is that of a charge and all its images, up to a constant; with a grounded
        plane also that of the opposite charges that are mirrored in it, without a constant.
        """
        direct = self._due_to(self.panels)
        if ground is not None:
            # Near pairs include all that are near in the mirror, where no distance is shorter.
            return direct - self._due_to(_mirrored(self.panels, ground))
        if self.images is not None:
            across = jnp.delete(self.panels.mean(axis=1), self.images.axis, axis=-1) / self.period
            widest = jnp.linalg.norm(across[:, None] - across[None], axis=-1).max()
            # The constant raises the potentials enough for the matrix to be positive definite.
            direct += 4 * (1 + jnp.log1p(widest)) / self.period
        return direct

    def _due_to(self, sources: Float[Array, "panel 4 3"]) -> Matrix:
        """Mean potential on each panel due to a unit charge on each source, images included."""
        images = self.images
        period = self.period
        insulation_squared = self.insulation_squared
        centre = self.panels.mean(axis=1)
        middle = sources.mean(axis=1)
        turns = jnp.zeros_like(insulation_squared)
        axis = None
        if images is not None:
            axis = images.axis
            turns = jnp.round((centre[:, None, axis] - middle[None, :, axis]) / period)

        def inverse_distance(one: Array, other: Array, image: Array | float = 0.0) -> Matrix:
            steps = [one[:, None, k] - other[None, :, k] for k in range(3)]
            if axis is not None:
                steps[axis] -= (turns + image) * period
            return 1 / jnp.sqrt(steps[0] ** 2 + steps[1] ** 2 + steps[2] ** 2 + insulation_squared)

        points, share = _quadrature(self.panels)
        charges, part = _quadrature(sources)

        def add_points(total: Array, pair: Array) -> tuple[Array, None]:
            one, other = pair
            weight = share[one][:, None] * part[other][None, :]
            return total + weight * inverse_distance(points[one], charges[other]), None

        combinations = jnp.array(list(product(range(len(points)), repeat=2)))
        total, _ = jax.lax.scan(add_points, jnp.zeros_like(turns), combinations)

        def closed(pairs: Array) -> Array:
            seen_from, charged = pairs.T
            source = sources[charged]
            if axis is not None:
                source = source.at[..., axis].add((turns[seen_from, charged] * period)[:, None])
            return _closed_form(
                self.panels[seen_from], source, insulation_squared[seen_from, charged]
            )

        coefficients = jax.lax.map(closed, self.near.reshape(-1, PAIRS_AT_ONCE, 2)).ravel()
        one, other = self.near.T
        total = total.at[one, other].set(coefficients).at[other, one].set(coefficients)
        if images is None:
            return total

        def add_image(number: Array, sum_so_far: Array) -> Array:
            image = jnp.where(number % 2, 1, -1) * (1 + number // 2)
            term = inverse_distance(centre, middle, image) - 1 / (jnp.abs(image) * period)
            return sum_so_far + term

        total = jax.lax.fori_loop(0, 2 * images.count, add_image, total)
        # Images further away, by their second and fourth multipoles.
        distance = (centre[:, None] - middle[None]) / period
        along = distance[..., axis] - turns
        squared = (distance**2).sum(axis=-1) - distance[..., axis] ** 2 + along**2
        squared += insulation_squared / period**2
        second = (3 * along**2 - squared) / 2
        fourth = (35 * along**4 - 30 * along**2 * squared + 3 * squared**2) / 8
        second_weight, fourth_weight = images.beyond
        return total + 2 * (second_weight * second + fourth_weight * fourth) / period


def _mirrored(panels: Any, ground: Any) -> Any:
    return panels * np.array([1.0, 1.0, -1.0]) + 2 * ground * np.array([0.0, 0.0, 1.0])


def _closed_form(
    seen_from: Float[Array, "pair 4 3"],
    charged: Float[Array, "pair 4 3"],
    insulation_squared: Float[Array, " pair"],
) -> Float[Array, " pair"]:
    """Mean potential of uniformly charged panels, each of two triangles, over other panels."""
    points, share = _quadrature(seen_from)
    corners = jnp.moveaxis(charged, 0, -1)
    halves = jnp.stack([corners[np.array(half)] for half in ((0, 1, 2), (0, 2, 3))], axis=2)
    normal = jnp.cross(halves[1] - halves[0], halves[2] - halves[0], axis=0)
    area = jnp.linalg.norm(normal, axis=0).sum(axis=0)
    at = jnp.moveaxis(points, -1, 0)[:, :, None]
    seen = triangle_potential(at, halves[:, :, None], insulation_squared)
    return (share * seen.sum(axis=1)).sum(axis=0) * 2 / area


def _quadrature(
    panels: Float[Array, "panel 4 3"],
) -> tuple[Float[Array, "point panel 3"], Float[Array, "point panel"]]:
    """Gauss points of panels, and their weights as fractions of the area of the panel."""
    node, weight = np.polynomial.legendre.leggauss(POINTS_A_SIDE)
    u, v = (grid.ravel()[:, None, None] for grid in np.meshgrid((1 + node) / 2, (1 + node) / 2))
    first, second, third, fourth = jnp.moveaxis(panels, 1, 0)
    along_u = (1 - v) * (second - first) + v * (third - fourth)
    along_v = (1 - u) * (fourth - first) + u * (third - second)
    points = (1 - u) * ((1 - v) * first + v * fourth) + u * ((1 - v) * second + v * third)
    area = jnp.linalg.norm(jnp.cross(along_u, along_v), axis=-1)
    share = np.outer(weight, weight).ravel()[:, None] * area
    return points, share / share.sum(axis=0)


def triangle_potential(
    at: Float[Array, "3 *#point"],
    corners: Float[Array, "3 3 *#point"],
    added_squared: Float[Array, "*#point"] | float = 0.0,
) -> Float[Array, "..."]:
    """Integral of 1/r over a triangle, as seen from a point [mm].

    With the point at height d above the plane of the triangle, and each edge at distance t from the
    foot of the perpendicular, extending from l⁻ to l⁺, it is the sum over edges of t ln((R⁺ +
    l⁺)/(R⁻ + l⁻)) − |d| (atan(t l⁺/(R₀² + |d| R⁺)) − atan(t l⁻/(R₀² + |d| R⁻))). A triangle without
    area gives 0. Triangles are given by corner and component. With ``added_squared`` c², r counts
    as √(r² + c²), and the height d likewise [mm²].
    """
    ends = [(corner[0] - at[0], corner[1] - at[1], corner[2] - at[2]) for corner in corners]
    edges = [subtract(ends[(k + 1) % 3], ends[k]) for k in range(3)]
    normal = _unit(cross(edges[0], edges[1]))
    distance = [jnp.sqrt(dot(end, end) + added_squared) for end in ends]
    height = jnp.sqrt(dot(ends[0], normal) ** 2 + added_squared)
    total = jnp.zeros_like(height)
    for first, second in ((0, 1), (1, 2), (2, 0)):
        along = _unit(edges[first])
        ahead = dot(ends[second], along)
        behind = dot(ends[first], along)
        outwards = dot(ends[first], cross(along, normal))
        from_edge = outwards**2 + height**2
        # Of two equivalent forms, the one without cancellation.
        forwards = ahead + behind > 0
        above = jnp.where(forwards, distance[second] + ahead, distance[first] - behind)
        below = jnp.where(forwards, distance[first] + behind, distance[second] - ahead)
        logarithm = jnp.log(jnp.maximum(above, SMALLEST) / jnp.maximum(below, SMALLEST))
        # The difference of two angles, each within ±π/2.
        far = from_edge + height * distance[second]
        near = from_edge + height * distance[first]
        angle = jnp.arctan2(
            outwards * (ahead * near - behind * far), far * near + outwards**2 * ahead * behind
        )
        total += jnp.where(from_edge > 0, outwards * logarithm, 0.0) - height * angle
    return total


def _unit(vector: Vector) -> Vector:
    return scale(1 / jnp.maximum(norm(vector), SMALLEST), vector)
