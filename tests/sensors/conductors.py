"""Conductors divided into panels without knitlab, and their capacitance."""

import numpy as np

from knitlab.observables.capacitance.boundary_elements import (
    PAIRS_AT_ONCE,
    VACUUM_PERMITTIVITY,
    images_along,
    maxwell_matrices,
    near_pairs,
    two_terminal,
)

PAIRS_A_PANEL = 48
"""A sufficient number of near pairs for every shape; one number needs one compiled program."""


def evenly(count):
    return np.linspace(0, 1, count + 1)


def crowded(count):
    """Lines from 0 to 1 that are denser towards both ends, where charge concentrates."""
    return (1 - np.cos(np.pi * evenly(count))) / 2


def net_of(points):
    """Panels between the points of a grid, (row, column, 3)."""
    corners = [points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]]
    return np.stack(corners, axis=2).reshape(-1, 4, 3)


def plate(corner, one, other, lines, other_lines):
    """A flat parallelogram with two given sides, divided along lines from 0 to 1."""
    corner, one, other = (np.asarray(vector, float) for vector in (corner, one, other))
    return net_of(corner + (lines[:, None, None] * one + other_lines[None, :, None] * other))


def cube(lines, side=1.0):
    """Surface of a cube about the origin."""
    face = plate([-0.5, -0.5, 0.5], [1, 0, 0], [0, 1, 0], lines, lines)
    turns = [np.roll(np.eye(3), shift, axis=0) for shift in range(3)]
    return side * np.concatenate([sign * face @ turn for turn in turns for sign in (1, -1)])


def sphere(count, radius=1.0):
    """A sphere: a cube whose faces are divided at equal angles and projected onto the sphere."""
    angles = np.tan(np.pi / 4 * np.linspace(-1, 1, count + 1))
    panels = cube((1 + angles) / 2)
    return radius * panels / np.linalg.norm(panels, axis=-1, keepdims=True)


def disc(count, radius=1.0):
    """A disc: a square whose sides are mapped to the rim."""
    u, v = np.meshgrid(2 * crowded(count) - 1, 2 * crowded(count) - 1, indexing="ij")
    x, y = u * np.sqrt(1 - v**2 / 2), v * np.sqrt(1 - u**2 / 2)
    return radius * net_of(np.stack([x, y, 0 * x], axis=-1))


def prism(outline, length, count):
    """A surface along y over an outline (x, z), which may be closed."""
    y = length * evenly(count)
    x, z = (np.repeat(side[:, None], len(y), axis=1) for side in np.asarray(outline, float).T)
    return net_of(np.stack([x, np.broadcast_to(y, x.shape), z], axis=-1))


def strips(ends, count, length):
    """Periodic flat strips along y, each given by its ends (x, z)."""
    return [
        plate(
            [x, 0, z], [to_x - x, 0, to_z - z], [0, length, 0], crowded(count), evenly(count // 3)
        )
        for (x, z), (to_x, to_z) in ends
    ]


def wire(centre, radius, sides, length, count):
    """A round wire along y, as a prism of the area of its own cross-section."""
    angle = 2 * np.pi * evenly(sides)
    reach = radius * np.sqrt(2 * np.pi / sides / np.sin(2 * np.pi / sides))
    outline = np.stack([centre + reach * np.cos(angle), reach * np.sin(angle)], axis=-1)
    return prism(outline, length, count)


def maxwell(*conductors, period=None, axis=1, images=None, apart=0.0, ground=None):
    """Maxwell's matrix of conductors, of one period if there is one.

    Of several states if each has panels of its own, (state, panel, 4, 3). A grounded plane may lie
    at a height.
    """
    panels = np.concatenate(conductors, axis=-3)
    states = panels.reshape(-1, *panels.shape[-3:])
    membership = np.repeat(np.eye(len(conductors)), [np.shape(c)[-3] for c in conductors], axis=0)
    periods = None if period is None else np.broadcast_to(np.asarray(period, float), len(states))
    heights = None if ground is None else np.full(len(states), float(ground))
    if periods is not None and images is None:
        images = images_along(axis, states, periods, heights)
    near = filled(near_pairs(states, images, periods), PAIRS_A_PANEL * states.shape[1])
    matrices = np.asarray(
        maxwell_matrices(states, membership, near, images, periods, apart, heights)
    )
    return matrices.reshape(*panels.shape[:-3], *matrices.shape[1:])


def filled(pairs, count):
    """At least this number of pairs, padded with copies of the last."""
    count = -(-max(count, len(pairs)) // PAIRS_AT_ONCE) * PAIRS_AT_ONCE
    return np.concatenate([pairs, np.repeat(pairs[-1:], count - len(pairs), axis=0)])


def between(*conductors, **around):
    """Capacitance between two of them."""
    return two_terminal(maxwell(*conductors, **around))


def extrapolated(coarse, fine):
    """Extrapolated limit of a quantity that converges with the square of the panel size."""
    return fine + (fine - coarse) / 3


def by_series(one, other, terms=80):
    """Capacitance a length between two periodic flat strips, by Chebyshev's series.

    Each strip is given by its ends (x, z). Its charge is Σ aₙ Tₙ(s)/√(1 − s²), s from −1 to 1,
    whose own potential is in closed form; terms are found from as many points on each strip.
    """
    strips = np.array([one, other], float)
    middle, half = strips.mean(axis=1), (strips[:, 1] - strips[:, 0]) / 2
    order = np.arange(terms)
    angle = np.pi * (order + 0.5) / terms
    points = middle[:, None] + np.cos(angle)[None, :, None] * half[:, None]
    series = np.cos(angle[:, None] * order)
    apart = np.linalg.norm(points[0][:, None] - points[1][None], axis=-1)
    from_other = -np.log(apart) @ series * np.pi / terms
    from_one = -np.log(apart.T) @ series * np.pi / terms
    own = np.pi * series / np.maximum(order, 1)
    lengths = np.linalg.norm(half, axis=-1)
    own_by_strip = [np.column_stack([own[:, 0] * c, own[:, 1:]]) for c in np.log(2 / lengths)]
    # Unknowns: the terms of both strips, and a common potential; their charges are opposite.
    ones, total = np.ones((terms, 1)), np.zeros(2 * terms + 1)
    total[[0, terms]] = 1
    system = np.block(
        [[own_by_strip[0], from_other, ones], [from_one, own_by_strip[1], ones], [total]]
    )
    potentials = np.repeat([1.0, 0.0], [terms, terms + 1])
    return 2 * np.pi * VACUUM_PERMITTIVITY * np.pi * np.linalg.solve(system, potentials)[0]


def bent(panels):
    """Panels in a space that is deformed across y, so that hardly two are equal.

    Which of two equal panels counts as the larger would depend on round-off.
    """
    x, y, z = np.moveaxis(panels, -1, 0)
    return np.stack([x + 0.07 * np.sin(1.1 * z + 0.3 * x), y, z + 0.06 * np.sin(0.9 * x + 1)], -1)


def moved(panels, turn, shift):
    """Panels turned by a rotation, then shifted."""
    return turn.apply(panels.reshape(-1, 3)).reshape(panels.shape) + shift
