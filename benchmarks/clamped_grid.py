"""A clamped sample as plain arrays, for loops that others compile."""

from typing import NamedTuple

import numpy as np

from knitlab.solvers.dynamics.grid import ALL, INNER, Shape
from knitlab.solvers.dynamics.motion import Body

LEAST_BYTES = 8 * (6 + 6 + 12)
"""Of a node and step: position and velocity read and written, and read the numbers of four springs
and two hinges, two each."""


class Grid(NamedTuple):
    """A clamped sample on the grid: its springs and hinges by row, and what makes it move."""

    weft: np.ndarray  # k_s and rest length [N/mm, mm], (line of nodes, 2, cell)
    warp: np.ndarray  # (row of cells, 2, node)
    rising: np.ndarray  # (row of cells, 2, cell)
    falling: np.ndarray  # (row of cells, 2, cell)
    wale: np.ndarray  # k_t and rest angle [N mm, rad], (row of cells, 2, node inside)
    course: np.ndarray  # (line of nodes inside, 2, cell)
    inverse_mass: np.ndarray  # of every row of nodes, 0 if it is held [1/g]
    damping: float  # [g/ms]
    z_max: float  # [mm]
    k_wall: float  # [N/mm]


def grid_of(body: Body) -> Grid:
    """The numbers of a clamped sample of linear springs and one mass, without what pads them."""
    springs = [(own.stiffness, own.rest_length) for own in body.fabric.springs]
    hinges = [(own.stiffness, own.rest) for own in body.fabric.hinges]
    places = (ALL, INNER), (INNER, ALL), *[(INNER, INNER)] * 4
    weft, warp, rising, falling, wale, course = (
        np.stack([np.asarray(number)[place] for number in both], axis=1)
        for both, place in zip([*springs, *hinges], places, strict=True)
    )
    inverse_mass = np.ascontiguousarray(np.asarray(body.inverse.positions[1])[:, 0])
    numbers = float(body.damping), float(body.fabric.z_max), float(body.fabric.k_wall)
    return Grid(weft, warp, rising, falling, wale, course, inverse_mass, *numbers)


def rows_of(vector: Shape) -> np.ndarray:
    """Components of positions, velocities or forces: (row, component, column)."""
    return np.stack([np.asarray(component) for component in vector.positions], axis=1)
