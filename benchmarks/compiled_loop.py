"""The leapfrog of :mod:`knitlab.solvers.dynamics` as a plain loop over the grid, compiled by Numba.

The loop goes over the grid once in a step. It computes each spring and hinge once, keeps what two
rows of cells need in buffers of a row, and has no knowledge of anything but linear springs, fold
angles between whole normals and a clamped sample.
"""

import math
from typing import Any, NamedTuple

import numba
import numba.core.compiler
import numpy as np

from benchmarks.clamped_grid import Grid
from knitlab.solvers.dynamics.vectors import DENOMINATOR, NUMERATOR


class _Apart(numba.core.compiler.Compiler):
    """Lets LLVM know that arrays given to a function do not overlap, so that loops become SIMD."""

    def define_pipelines(self) -> Any:
        self.state.flags.noalias = True
        return super().define_pipelines()


compiled = numba.njit(fastmath=True, error_model="numpy", pipeline_class=_Apart)
within = numba.njit(fastmath=True, error_model="numpy", forceinline=True)

Numbers = tuple[float, float, float]
Pair = tuple[np.ndarray, np.ndarray]


class Part(NamedTuple):
    """A step, or the kick before the first."""

    drift: float  # time of it [ms]
    before: float  # half steps of the kick up to now
    after: float  # and from now on
    ahead: float  # time after which walls act [ms]


@within
def _subtract(one: Numbers, other: Numbers) -> Numbers:
    return one[0] - other[0], one[1] - other[1], one[2] - other[2]


@within
def _add(one: Numbers, other: Numbers) -> Numbers:
    return one[0] + other[0], one[1] + other[1], one[2] + other[2]


@within
def _scale(factor: float, vector: Numbers) -> Numbers:
    return factor * vector[0], factor * vector[1], factor * vector[2]


@within
def _dot(one: Numbers, other: Numbers) -> float:
    return one[0] * other[0] + one[1] * other[1] + one[2] * other[2]


@within
def _cross(one: Numbers, other: Numbers) -> Numbers:
    return (
        one[1] * other[2] - one[2] * other[1],
        one[2] * other[0] - one[0] * other[2],
        one[0] * other[1] - one[1] * other[0],
    )


@within
def _at(rows: np.ndarray, column: int) -> Numbers:
    return rows[0, column], rows[1, column], rows[2, column]


@within
def _put(rows: np.ndarray, column: int, vector: Numbers) -> None:
    rows[0, column], rows[1, column], rows[2, column] = vector


@within
def _arctan2(y: float, x: float) -> float:
    """As ``arctan2`` of ``vectors.py``: a call to a library cannot be vectorised."""
    size_x, size_y = abs(x), abs(y)
    smaller, larger = min(size_x, size_y), max(size_x, size_y)
    steep = smaller > math.tan(math.pi / 8) * larger
    above = smaller - larger if steep else smaller
    tangent = above / (smaller + larger if steep else larger)
    square = tangent * tangent
    # By Horner's rule, with numbers and no array, for speed.
    n, d = NUMERATOR, DENOMINATOR
    numerator = (((n[0] * square + n[1]) * square + n[2]) * square + n[3]) * square + n[4]
    denominator = (((square + d[1]) * square + d[2]) * square + d[3]) * square + d[4]
    ratio = numerator / (denominator * square + d[5])
    angle = tangent + tangent * square * ratio + (math.pi / 4 if steep else 0.0)
    angle = math.pi / 2 - angle if size_y > size_x else angle
    angle = math.pi - angle if x < 0 else angle
    return -angle if y < 0 else angle


@within
def _pull(along: Numbers, stiffness: float, rest: float) -> Numbers:
    """Derivative of the energy of a spring with respect to the vector along it [N]."""
    return _scale(stiffness * (1 - rest / math.sqrt(_dot(along, along))), along)


@within
def _moments(
    edge: Numbers, before: Numbers, after: Numbers, stiffness: float, rest: float
) -> tuple[Numbers, Numbers, Numbers]:
    """Derivatives of the energy of a hinge with respect to its edge and its normals."""
    per_length = 1 / math.sqrt(_dot(edge, edge))
    along = _scale(per_length, edge)
    crossed = _cross(before, after)
    sine, cosine = _dot(crossed, along), _dot(before, after)
    angle = _arctan2(sine, cosine) - rest
    angle -= 2 * math.pi * np.rint(angle / (2 * math.pi))
    turn = stiffness * angle / (sine * sine + cosine * cosine)
    by_sine, by_cosine = turn * cosine, -turn * sine
    return (
        _scale(by_sine * per_length, _subtract(crossed, _scale(sine, along))),
        _add(_scale(by_sine, _cross(after, along)), _scale(by_cosine, after)),
        _add(_scale(by_sine, _cross(along, before)), _scale(by_cosine, before)),
    )


@compiled
def _drift(place: np.ndarray, velocity: np.ndarray, time: float) -> None:
    for column in range(place.shape[1]):
        for axis in range(3):
            place[axis, column] += time * velocity[axis, column]


@compiled
def _cells(low: np.ndarray, high: np.ndarray, normal: np.ndarray) -> None:
    """Normals of a row of cells, from the nodes below and above."""
    for cell in range(normal.shape[1]):
        rising = _subtract(_at(high, cell + 1), _at(low, cell))
        falling = _subtract(_at(high, cell), _at(low, cell + 1))
        _put(normal, cell, _cross(rising, falling))


@compiled
def _along_weft(low: np.ndarray, spring: np.ndarray, weft: np.ndarray) -> None:
    for cell in range(spring.shape[1]):
        edge = _subtract(_at(low, cell + 1), _at(low, cell))
        _put(weft, cell + 1, _pull(edge, spring[0, cell], spring[1, cell]))


@compiled
def _along_warp(lines: np.ndarray, spring: np.ndarray, warp: np.ndarray) -> None:
    low, high = lines[0], lines[1]
    for column in range(spring.shape[1]):
        edge = _subtract(_at(high, column), _at(low, column))
        _put(warp, column, _pull(edge, spring[0, column], spring[1, column]))


@compiled
def _about_wales(
    lines: np.ndarray,
    hinge: np.ndarray,
    normal: np.ndarray,
    warp: np.ndarray,
    before: np.ndarray,
    after: np.ndarray,
) -> None:
    low, high = lines[0], lines[1]
    for cell in range(hinge.shape[1]):
        edge = _subtract(_at(high, cell + 1), _at(low, cell + 1))
        by_edge, by_before, by_after = _moments(
            edge, _at(normal, cell), _at(normal, cell + 1), hinge[0, cell], hinge[1, cell]
        )
        _put(warp, cell + 1, _add(_at(warp, cell + 1), by_edge))
        _put(before, cell, by_before)
        _put(after, cell + 1, by_after)


@compiled
def _about_course(
    line: np.ndarray, hinge: np.ndarray, normals: Pair, weft: np.ndarray, by_normals: Pair
) -> None:
    (below, above), (by_below, by_above) = normals, by_normals
    for cell in range(hinge.shape[1]):
        edge = _subtract(_at(line, cell), _at(line, cell + 1))  # points to −x
        by_edge, by_before, by_after = _moments(
            edge, _at(below, cell), _at(above, cell), hinge[0, cell], hinge[1, cell]
        )
        _put(weft, cell + 1, _subtract(_at(weft, cell + 1), by_edge))
        _put(by_below, cell, _add(_at(by_below, cell), by_before))
        _put(by_above, cell, by_after)


@compiled
def _along_diagonals(
    lines: np.ndarray, springs: Pair, by_normal: np.ndarray, up: np.ndarray, down: np.ndarray
) -> None:
    low, high, (up_spring, down_spring) = lines[0], lines[1], springs
    for cell in range(by_normal.shape[1]):
        rising = _subtract(_at(high, cell + 1), _at(low, cell))
        falling = _subtract(_at(high, cell), _at(low, cell + 1))
        by = _at(by_normal, cell)
        pull = _pull(rising, up_spring[0, cell], up_spring[1, cell])
        _put(up, cell + 1, _add(pull, _cross(falling, by)))
        pull = _pull(falling, down_spring[0, cell], down_spring[1, cell])
        _put(down, cell + 1, _add(pull, _cross(by, rising)))


@compiled
def _add_both(total: np.ndarray, one: np.ndarray, other: np.ndarray) -> None:
    for cell in range(total.shape[1]):
        for axis in range(3):
            total[axis, cell] += one[axis, cell] + other[axis, cell]


@compiled
def _kick(
    place: np.ndarray,
    velocity: np.ndarray,
    weft: np.ndarray,
    warps: Pair,
    ups: Pair,
    downs: Pair,
    factors: tuple[float, float, float, float, float],
) -> tuple[float, float]:
    """Move the velocity of a row of nodes on; returns Σ v² before and Σ v_y ∂V/∂y after."""
    kept, push, push_of_wall, ahead, z_max = factors
    (warp_below, warp), (up_below, up), (down_below, down) = warps, ups, downs
    squares = power = 0.0
    for column in range(place.shape[1]):
        old = _at(velocity, column)
        squares += _dot(old, old)
        force = _add(
            _add(
                _subtract(_at(weft, column), _at(weft, column + 1)),
                _subtract(_at(warp_below, column), _at(warp, column)),
            ),
            _add(
                _subtract(_at(up_below, column), _at(up, column + 1)),
                _subtract(_at(down_below, column + 1), _at(down, column)),
            ),
        )
        x, y, z = _subtract(_scale(kept, old), _scale(push, force))
        height = place[2, column] + ahead * z
        z -= push_of_wall * (height - min(max(height, -z_max), z_max))
        _put(velocity, column, (x, y, z))
        power += y * force[1]
    return squares, power


@compiled
def _step(
    grid: Grid, places: np.ndarray, velocities: np.ndarray, step: float, part: Part
) -> tuple[float, float]:
    """Drift, then kick; returns Σ v² over what is free before and Σ v_y ∂V/∂y of the top after."""
    rows, columns = grid.rising.shape[0], grid.rising.shape[2]
    # Of the row of cells or the line of nodes above the last ones, and of these.
    normal, by_normal = np.zeros((2, 3, columns)), np.zeros((2, 3, columns))
    weft, warp = np.zeros((2, 3, columns + 2)), np.zeros((2, 3, columns + 1))
    up, down = np.zeros((2, 3, columns + 2)), np.zeros((2, 3, columns + 2))
    before, after = np.zeros((3, columns)), np.zeros((3, columns))
    squares = power = 0.0
    _drift(places[0], velocities[0], part.drift)
    for row in range(rows + 2):
        this, last = row % 2, 1 - row % 2
        if row < rows:
            _drift(places[row + 1], velocities[row + 1], part.drift)
            _cells(places[row], places[row + 1], normal[this])
        if row <= rows:
            _along_weft(places[row], grid.weft[row], weft[this])
        if 0 < row < rows:
            normals, by_normals = (normal[last], normal[this]), (by_normal[last], by_normal[this])
            _about_course(places[row], grid.course[row - 1], normals, weft[this], by_normals)
        if 0 < row <= rows:
            springs = grid.rising[row - 1], grid.falling[row - 1]
            _along_diagonals(
                places[row - 1 : row + 1], springs, by_normal[last], up[last], down[last]
            )
        elif row > rows:
            up[last], down[last] = 0.0, 0.0
        if row > 0:
            inverse = grid.inverse_mass[row - 1]
            half = step * grid.damping * inverse / 2
            push = step * (part.before + part.after) / 2 * inverse / (1 + part.before * half)
            factors = (
                (1 - part.after * half) / (1 + part.before * half),
                push,
                push * grid.k_wall / (1 + part.ahead * push * grid.k_wall),
                part.ahead,
                grid.z_max,
            )
            old, power = _kick(
                places[row - 1],
                velocities[row - 1],
                weft[last],
                (warp[this], warp[last]),
                (up[this], up[last]),
                (down[this], down[last]),
                factors,
            )
            squares += old if inverse > 0 else 0.0
        if row < rows:
            lines = places[row : row + 2]
            _along_warp(lines, grid.warp[row], warp[this])
            _about_wales(lines, grid.wale[row], normal[this], warp[this], before, after)
            _add_both(by_normal[this], before, after)
        else:
            warp[this] = 0.0
    return squares, power if grid.inverse_mass[-1] == 0 else 0.0


@compiled
def leapfrog(
    grid: Grid, places: np.ndarray, velocities: np.ndarray, step: float, count: int
) -> tuple[float, float]:
    """Move a sample by equal steps, in place: ``leapfrog`` of ``knitlab.solvers.dynamics.motion``.

    Args:
        grid: the sample.
        places: components of the positions of its nodes, (row, component, column) [mm].
        velocities: the same of their velocities [mm/ms].
        step: time step [ms].
        count: number of steps.

    Returns:
        Work done against the drag, and on what is held [N mm].
    """
    dissipated = supplied = 0.0
    _, last = _step(grid, places, velocities, step, Part(0.0, 0.0, 1.0, step))
    for number in range(count):
        whole = 1.0 if number < count - 1 else 0.0
        squares, power = _step(grid, places, velocities, step, Part(step, 1.0, whole, whole * step))
        dissipated += step * grid.damping * squares
        supplied += step / 2 * (last + power)
        last = power
    return dissipated, supplied


@compiled
def triad(one: np.ndarray, other: np.ndarray, total: np.ndarray) -> None:
    """A sum of two arrays, one of them times a number, which measures the memory's bandwidth."""
    for index in range(total.size):
        total[index] = one[index] + 3.0 * other[index]
