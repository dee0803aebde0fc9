"""Distances of contact: where the barrier acts, and how thick a fabric may be. Needs no ipctk."""

import math

RANGE = 0.25
"""Distance beyond one thickness over which the barrier acts, in thicknesses."""
NEAR_RANGE = 0.1
"""Distance over which it acts between parts that are near on the grid, in thicknesses: it keeps
them from passing through each other, and leaves the calibrated folds alone."""
NEAR_CELLS = 2
"""Nodes within this many of the paper's cells of each other, along both axes, are near. A fold at
its rest angle brings them nearer than a thickness, without any force but that of its hinge."""


def largest_thickness(cell: float, theta_0: float) -> float:
    """Thickness from which on the barrier would act in folds at their rest angles [mm].

    Nearest to each other of parts that are not near on the grid are the cell beside a fold and, on
    its other side, the next cell but one. In a fold at rest their distance is cell × sin(θ0), or a
    cell in a blunt one.

    Args:
        cell: shortest side of a grid cell of the paper's grid [mm].
        theta_0: sharpest rest angle [rad].

    Example:
        >>> round(largest_thickness(0.35, 0.77), 3)
        0.195
    """
    return cell * math.sin(min(theta_0, math.pi / 2)) / (1 + RANGE)
