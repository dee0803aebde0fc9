# The types of Warp do not know the language of its kernels.
# mypy: ignore-errors
"""The same leapfrog as :mod:`benchmarks.compiled_loop` as kernels of NVIDIA Warp.

A kernel runs for every node or cell and knows nothing of the others, as on a graphics processor:
what is gathered from hinges and diagonals goes through arrays of the whole grid.
"""

import numpy as np
import warp as wp

from benchmarks.clamped_grid import Grid

wp.config.log_level = wp.LOG_WARNING
wp.config.enable_backward = False


@wp.func
def pull(along: wp.vec3d, spring: wp.vec2d) -> wp.vec3d:
    """Derivative of the energy of a spring with respect to the vector along it [N]."""
    return spring[0] * (wp.float64(1.0) - spring[1] / wp.length(along)) * along


@wp.func
def normal_of(places: wp.array2d[wp.vec3d], i: int, j: int) -> wp.vec3d:
    """Normal of a cell."""
    rising = places[i + 1, j + 1] - places[i, j]
    return wp.cross(rising, places[i + 1, j] - places[i, j + 1])


@wp.func
def moments(
    edge: wp.vec3d, before: wp.vec3d, after: wp.vec3d, hinge: wp.vec2d
) -> tuple[wp.vec3d, wp.vec3d, wp.vec3d]:
    """Derivatives of the energy of a hinge with respect to its edge and its normals."""
    length = wp.length(edge)
    along = edge / length
    crossed = wp.cross(before, after)
    sine, cosine = wp.dot(crossed, along), wp.dot(before, after)
    turn = wp.float64(2.0 * wp.PI)
    angle = wp.atan2(sine, cosine) - hinge[1]
    angle = hinge[0] * (angle - turn * wp.rint(angle / turn)) / (sine * sine + cosine * cosine)
    by_sine, by_cosine = angle * cosine, -angle * sine
    return (
        by_sine / length * (crossed - sine * along),
        by_sine * wp.cross(after, along) + by_cosine * after,
        by_sine * wp.cross(along, before) + by_cosine * before,
    )


@wp.kernel
def drift(places: wp.array2d[wp.vec3d], velocities: wp.array2d[wp.vec3d], time: wp.float64) -> None:
    """Move every node by its velocity."""
    i, j = wp.tid()
    places[i, j] = places[i, j] + time * velocities[i, j]


@wp.kernel
def fold(
    places: wp.array2d[wp.vec3d],
    wale: wp.array2d[wp.vec2d],
    course: wp.array2d[wp.vec2d],
    wales: wp.array3d[wp.vec3d],
    courses: wp.array3d[wp.vec3d],
) -> None:
    """Moments of the hinges about the edges up and right of every node, 0 at open edges."""
    i, j = wp.tid()
    rows, columns = places.shape[0] - 1, places.shape[1] - 1
    if i < rows and j > 0 and j < columns:
        by_edge, by_before, by_after = moments(
            places[i + 1, j] - places[i, j],
            normal_of(places, i, j - 1),
            normal_of(places, i, j),
            wale[i, j - 1],
        )
        wales[0, i, j] = by_edge
        wales[1, i, j] = by_before
        wales[2, i, j] = by_after
    if j < columns and i > 0 and i < rows:
        by_edge, by_before, by_after = moments(
            places[i, j] - places[i, j + 1],
            normal_of(places, i - 1, j),
            normal_of(places, i, j),
            course[i - 1, j],
        )
        courses[0, i, j] = by_edge
        courses[1, i, j] = by_before
        courses[2, i, j] = by_after


@wp.kernel
def brace(
    places: wp.array2d[wp.vec3d],
    rising: wp.array2d[wp.vec2d],
    falling: wp.array2d[wp.vec2d],
    wales: wp.array3d[wp.vec3d],
    courses: wp.array3d[wp.vec3d],
    diagonals: wp.array3d[wp.vec3d],
) -> None:
    """Derivatives with respect to both diagonals of every cell."""
    i, j = wp.tid()
    up, down = places[i + 1, j + 1] - places[i, j], places[i + 1, j] - places[i, j + 1]
    by_normal = wales[1, i, j + 1] + wales[2, i, j] + courses[1, i + 1, j] + courses[2, i, j]
    diagonals[0, i, j] = pull(up, rising[i, j]) + wp.cross(down, by_normal)
    diagonals[1, i, j] = pull(down, falling[i, j]) + wp.cross(by_normal, up)


@wp.kernel
def kick(
    places: wp.array2d[wp.vec3d],
    velocities: wp.array2d[wp.vec3d],
    weft: wp.array2d[wp.vec2d],
    warp: wp.array2d[wp.vec2d],
    wales: wp.array3d[wp.vec3d],
    courses: wp.array3d[wp.vec3d],
    diagonals: wp.array3d[wp.vec3d],
    inverse_mass: wp.array1d[wp.float64],
    damping: wp.float64,
    walls: wp.vec2d,
    step: wp.float64,
    part: wp.vec3d,
    sums: wp.array1d[wp.float64],
) -> None:
    """Move every velocity on; adds Σ v² before and Σ v_y ∂V/∂y of a held top after to the sums."""
    i, j = wp.tid()
    rows, columns = places.shape[0] - 1, places.shape[1] - 1
    here, force = places[i, j], wp.vec3d()
    if j > 0:
        force += pull(here - places[i, j - 1], weft[i, j - 1]) - courses[0, i, j - 1]
    if j < columns:
        force += courses[0, i, j] - pull(places[i, j + 1] - here, weft[i, j])
    if i > 0:
        force += pull(here - places[i - 1, j], warp[i - 1, j]) + wales[0, i - 1, j]
        if j > 0:
            force += diagonals[0, i - 1, j - 1]
        if j < columns:
            force += diagonals[1, i - 1, j]
    if i < rows:
        force -= pull(places[i + 1, j] - here, warp[i, j]) + wales[0, i, j]
        if j > 0:
            force -= diagonals[1, i, j - 1]
        if j < columns:
            force -= diagonals[0, i, j]
    one, before, after, ahead = wp.float64(1.0), part[0], part[1], part[2]
    inverse, old = inverse_mass[i], velocities[i, j]
    if inverse > wp.float64(0.0):
        wp.atomic_add(sums, 0, wp.dot(old, old))
    half = step * damping * inverse / wp.float64(2.0)
    push = step * (before + after) / wp.float64(2.0) * inverse / (one + before * half)
    new = (one - after * half) / (one + before * half) * old - push * force
    height = here[2] + ahead * new[2]
    beyond = height - wp.clamp(height, -walls[0], walls[0])
    new[2] -= push * walls[1] / (one + ahead * push * walls[1]) * beyond
    velocities[i, j] = new
    if inverse == wp.float64(0.0) and i == rows:
        wp.atomic_add(sums, 1, new[1] * force[1])


def leapfrog(
    grid: Grid, places: np.ndarray, velocities: np.ndarray, step: float, count: int
) -> tuple[float, float]:
    """As :func:`benchmarks.compiled_loop.leapfrog`, on the processor."""
    nodes = places.shape[0], places.shape[2]
    cells = nodes[0] - 1, nodes[1] - 1

    def on_device(rows: np.ndarray, of: type) -> wp.array:
        return wp.array(np.ascontiguousarray(rows.transpose(0, 2, 1)), dtype=of, device="cpu")

    def empty(*size: int) -> wp.array:
        return wp.zeros(size, dtype=wp.vec3d, device="cpu")

    place, velocity = on_device(places, wp.vec3d), on_device(velocities, wp.vec3d)
    weft, warp, rising, falling, wale, course = (on_device(each, wp.vec2d) for each in grid[:6])
    wales, courses, diagonals = empty(3, *nodes), empty(3, *nodes), empty(2, *cells)
    sums = wp.zeros(2, dtype=wp.float64, device="cpu")
    inverse_mass = wp.array(grid.inverse_mass, dtype=wp.float64, device="cpu")
    walls = wp.vec2d(grid.z_max, grid.k_wall)

    def recorded(kernel: wp.Kernel, size: tuple[int, int], *inputs: object) -> wp.Launch:
        return wp.launch(kernel, dim=size, inputs=inputs, device="cpu", record_cmd=True)

    def kicked(before: float, after: float, ahead: float) -> list[wp.Launch]:
        of = wales, courses, diagonals, inverse_mass, grid.damping, walls, step
        part = wp.vec3d(before, after, ahead)
        return [
            recorded(fold, nodes, place, wale, course, wales, courses),
            recorded(brace, cells, place, rising, falling, wales, courses, diagonals),
            recorded(kick, nodes, place, velocity, weft, warp, *of, part, sums),
        ]

    moved = recorded(drift, nodes, place, velocity, step)
    full, final = [moved, *kicked(1.0, 1.0, step)], [moved, *kicked(1.0, 0.0, 0.0)]
    totals = []  # of the sums: after the first kick, before the last step, and after it
    for launches in (kicked(0.0, 1.0, step), full * (count - 1), final * min(count, 1)):
        for launch in launches:
            launch.launch()
        totals.append(sums.numpy().copy())
    (squares, first), (_, before_last), (all_squares, power) = totals
    for rows, moved_rows in ((places, place), (velocities, velocity)):
        rows[:] = moved_rows.numpy().transpose(0, 2, 1)
    half_ends = (first + power - before_last) / 2
    return step * grid.damping * (all_squares - squares), step * (power - half_ends)
