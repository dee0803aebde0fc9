"""Arc-length continuation: branches of equilibria through limit and branch points.

A point (u, t) of a branch is followed by a predictor along its tangent and Newton's method at a
constant distance along it, so that a branch is followed where it turns back (Riks, Int. J. Solids
Struct. 15, 1979; Keller, 1977). Between two points that differ in the number of negative
eigenvalues of the stiffness lies a limit point, at which t turns, or a branch point.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import IntEnum
from itertools import pairwise

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float
from scipy.optimize import brentq
from scipy.sparse.linalg import LinearOperator, eigsh, splu

from knitlab.io.progress import report
from knitlab.solvers.branches.equations import FabricEquations, Vector

# Steps along a branch, in strain and in u over its size.
FIRST_STEP = 0.005
MAX_STEP = 0.02
MIN_STEP = 1e-5
MAX_POINTS = 400  # of a branch
TOLERANCE = 1e-9  # largest force in equilibrium [N]
MAX_ITERATIONS = 12  # of Newton's method at a point
EASY = 4  # iterations up to which the next step is longer
MIN_COSINE = 0.8  # cosine between the tangents at both ends of a step, at least
MAX_ELONGATION = 1.2  # distance between them over the step, at most
NUMBER = 6  # of lowest eigenvalues that are computed
DENSE = 300  # number of unknowns up to which all are
SOFT = 1e-9  # eigenvalue over the largest stiffness below which a motion is neutral
NO_STIFFNESS = 1e-9  # force of a lift over the largest stiffness below which it costs nothing
NEARLY_ZERO = 0.05  # eigenvalue of a critical point over those on either side of it
NEAR = 1e-5  # difference of parameters of two sides of a branch that are mirror images
HALVINGS = 6  # of the distance onto another branch


class Kind(IntEnum):
    """Kind of a point of a branch."""

    regular = 0
    limit = 1
    branch = 2


class NotFollowed(ArithmeticError):
    """Newton's method reached no equilibrium."""


@dataclass(frozen=True)
class PathPoint:
    """An equilibrium on a branch, stable if no eigenvalue of its stiffness is negative."""

    unknowns: Vector
    parameter: float
    energy: float
    eigenvalues: Float[np.ndarray, " lowest"]  # the lowest, ascending, without neutral motions
    modes: Float[np.ndarray, "free lowest"]
    tangent: Float[np.ndarray, " free+1"]  # direction of the branch, by (u / size, t)
    kind: Kind = Kind.regular

    @property
    def unstable(self) -> int:
        """Number of independent motions that lower the energy."""
        return int((self.eigenvalues < 0).sum())


def equilibrium(equations: FabricEquations, u: Vector, t: float) -> PathPoint:
    """The equilibrium near u at a parameter, with the tangent towards larger ones."""
    held = np.append(np.zeros(len(u)), 1.0)
    u, t, _ = _corrected(equations, u, t, held)
    return _point(equations, u, t, held)


def follow(
    equations: FabricEquations, start: PathPoint, until: tuple[float, float]
) -> list[PathPoint]:
    """Points of a branch, its critical points included, from one of it along its tangent.

    It ends where the parameter leaves a range, where the branch closes, after :data:`MAX_POINTS`,
    or where no smaller step succeeds.
    """
    points = [start]
    length = FIRST_STEP
    while len(points) < MAX_POINTS and until[0] <= points[-1].parameter <= until[1]:
        last = points[-1]
        report(0.0, f"strain {last.parameter:.3f}")
        try:
            point, iterations = _stepped(equations, last, length, last.tangent)
        except NotFollowed:
            length /= 2
            if length < MIN_STEP:
                break
            continue
        turned = point.tangent @ last.tangent < MIN_COSINE
        moved = _distance(equations, last, point)
        if (turned or moved > MAX_ELONGATION * length) and length > 16 * MIN_STEP:
            length /= 4  # it may have jumped to another branch
            continue
        points += [*_critical_points(equations, last, point, length), point]
        if last is not start and _distance(equations, start, point) < length:
            break
        length = min(1.5 * length, MAX_STEP) if iterations <= EASY else length / 1.5
    return points


def at_parameter(
    equations: FabricEquations, points: Sequence[PathPoint], parameter: float
) -> Iterator[PathPoint]:
    """The points of a branch at a parameter, and that next to its first point if this is near."""
    if abs(points[0].parameter - parameter) < NEAR:
        with suppress(NotFollowed):
            yield equilibrium(equations, points[0].unknowns, parameter)
    for one, other in pairwise(points):
        if (one.parameter - parameter) * (other.parameter - parameter) < 0:
            along = one.tangent
            moved = (other.unknowns - one.unknowns) / equations.size
            length = along @ np.append(moved, other.parameter - one.parameter)

            def beyond(distance: float, one: PathPoint = one) -> float:
                return _at_distance(equations, one, distance, one.tangent)[1] - parameter

            with suppress(NotFollowed, ValueError):
                yield _stepped(equations, one, float(brentq(beyond, 0.0, length)), along)[0]


def switched(equations: FabricEquations, at: PathPoint, amplitude: float) -> list[PathPoint]:
    """Points on either side of the other branch at a branch point, an ``amplitude`` away.

    The amplitude, in u over its size and in t, is halved where a second eigenvalue changes its
    sign.
    """
    mode = at.modes[:, np.argmin(np.abs(at.eigenvalues))]
    directions = [np.append(mode, 0.0), _across_mode(equations, at, mode)]
    # Both branches lie in the plane of these directions, and mostly at right angles.
    crossing_directions = [each - at.tangent * (each @ at.tangent) for each in directions]
    other = max(crossing_directions, key=np.linalg.norm)
    other /= np.linalg.norm(other)
    negative = int((np.delete(at.eigenvalues, np.argmin(np.abs(at.eigenvalues))) < 0).sum())
    points = []
    for direction in (other, -other):
        side = None
        for halvings in range(HALVINGS):
            with suppress(NotFollowed):
                side, _ = _stepped(equations, at, amplitude / 2**halvings, direction)
                if side.unstable in (negative, negative + 1):
                    break
        points += [side] if side else []
    return points


def _across_mode(
    equations: FabricEquations, at: PathPoint, mode: Vector
) -> Float[np.ndarray, " free+1"]:
    """The direction (u / size, t) in which the force stays zero and the critical mode is still."""
    stiffness = equations.stiffness(at.unknowns, at.parameter)
    by_parameter = equations.force_by_parameter(at.unknowns, at.parameter)
    held = [mode, *_free_motions(equations, stiffness).T]
    border = sp.csc_array(np.stack(held, axis=1))
    whole = sp.block_array([[stiffness, border], [border.T, None]], format="csc")
    moved = splu(whole).solve(np.append(-by_parameter, np.zeros(len(held))))[: len(mode)]
    direction = np.append(moved / equations.size, 1.0)
    return direction / np.linalg.norm(direction)


def _stepped(
    equations: FabricEquations, last: PathPoint, length: float, along: Float[np.ndarray, " along"]
) -> tuple[PathPoint, int]:
    """The point at a distance from one along a direction, and the iterations that it took."""
    u, t, iterations = _at_distance(equations, last, length, along)
    return _point(equations, u, t, along), iterations


def _at_distance(
    equations: FabricEquations, last: PathPoint, length: float, along: Float[np.ndarray, " along"]
) -> tuple[Vector, float, int]:
    """The unknowns and the parameter of that point, and the iterations that they took."""
    u = last.unknowns + length * equations.size * along[:-1]
    return _corrected(equations, u, last.parameter + length * along[-1], along)


def _corrected(
    equations: FabricEquations, u: Vector, t: float, normal: Float[np.ndarray, " free+1"]
) -> tuple[Vector, float, int]:
    """Newton's method in the plane through (u, t) across a direction; NotFollowed if it fails."""
    for iteration in range(1, MAX_ITERATIONS + 1):
        force = equations.force(u, t)
        if not np.isfinite(force).all():
            raise NotFollowed("the energy is not defined there")
        if np.abs(force).max() <= TOLERANCE:
            return u, t, iteration
        by_parameter = equations.force_by_parameter(u, t)
        moved = _bordered(
            equations, equations.stiffness(u, t), by_parameter, normal, np.append(-force, 0.0)
        )
        u = u + equations.size * moved[:-1]
        t = t + moved[-1]
    raise NotFollowed(f"{np.abs(equations.force(u, t)).max():.1e} N are left")


def _bordered(
    equations: FabricEquations,
    stiffness: sp.csc_array,
    by_parameter: Vector,
    normal: Float[np.ndarray, " free+1"],
    right: Float[np.ndarray, " free+1"],
) -> Float[np.ndarray, " free+1"]:
    """Solution (du / size, dt) of the stiffness, bordered by the parameter and the normal."""
    # Neutral motions take no part: a small stiffness makes them definite.
    soft = SOFT * abs(stiffness.diagonal()).max() if equations.neutral.size else 0.0
    scaled = equations.size * (stiffness + soft * sp.eye_array(len(by_parameter), format="csc"))
    column = sp.csc_array(by_parameter[:, None])
    whole = sp.block_array([[scaled, column], [normal[None, :-1], normal[None, -1:]]], format="csc")
    try:
        solution = splu(whole).solve(right)
    except RuntimeError as error:
        raise NotFollowed("the stiffness is singular") from error
    if not np.isfinite(solution).all():
        raise NotFollowed("the stiffness is singular")
    own = solution[:-1]
    solution[:-1] = own - equations.neutral @ (equations.neutral.T @ own)
    return solution


def _point(
    equations: FabricEquations, u: Vector, t: float, before: Float[np.ndarray, " free+1"]
) -> PathPoint:
    stiffness = equations.stiffness(u, t)
    by_parameter = equations.force_by_parameter(u, t)
    try:
        ahead = np.append(np.zeros(len(u)), 1.0)
        tangent = _bordered(equations, stiffness, by_parameter, before, ahead)
    except NotFollowed:  # exactly at a branch point, where there are two
        tangent = before
    values, modes = lowest_eigenvalues(equations, stiffness)
    energy = equations.energy(u, t)
    return PathPoint(u, t, energy, values, modes, tangent / np.linalg.norm(tangent))


def lowest_eigenvalues(
    equations: FabricEquations, stiffness: sp.csc_array
) -> tuple[Float[np.ndarray, " lowest"], Float[np.ndarray, "free lowest"]]:
    """The lowest eigenvalues of a stiffness, ascending, and their modes, but neutral motions."""
    rigid = _free_motions(equations, stiffness)
    size = stiffness.shape[0]
    largest = float(abs(stiffness.diagonal()).max())
    if size <= DENSE:
        values, modes = np.linalg.eigh(stiffness.toarray() + 10 * largest * rigid @ rigid.T)
        return values[:NUMBER], modes[:, :NUMBER]
    shift = -1e-4 * largest
    while _negative(stiffness, shift):
        shift *= 4
    factors = splu(sp.csc_array(stiffness - shift * sp.eye_array(size)))

    def without_rigid(vector: Vector) -> Vector:
        return vector - rigid @ (rigid.T @ vector)

    # Motions without stiffness are left out of the inverse: they would mix with critical modes.
    inverse = LinearOperator(
        stiffness.shape,
        lambda vector: without_rigid(factors.solve(without_rigid(vector.ravel()))),
        dtype=float,
    )
    start = without_rigid(np.random.default_rng(0).normal(size=size))
    values, modes = eigsh(stiffness, NUMBER, sigma=shift, OPinv=inverse, v0=start)
    order = np.argsort(values)
    return values[order], modes[:, order]


def _free_motions(
    equations: FabricEquations, stiffness: sp.csc_array
) -> Float[np.ndarray, "free mode"]:
    largest = abs(stiffness.diagonal()).max()
    if (abs(stiffness @ equations.lift) < NO_STIFFNESS * largest).all():
        return np.concatenate([equations.neutral, equations.lift], axis=1)
    return equations.neutral


def _distance(equations: FabricEquations, one: PathPoint, other: PathPoint) -> float:
    moved = (other.unknowns - one.unknowns) / equations.size
    return float(np.hypot(np.linalg.norm(moved), other.parameter - one.parameter))


def _negative(stiffness: sp.csc_array, shift: float) -> int:
    """Number of eigenvalues below a shift: negative pivots of the factors (Sylvester)."""
    shifted = sp.csc_array(stiffness - shift * sp.eye_array(stiffness.shape[0]))
    symmetric = {"SymmetricMode": True}
    factors = splu(shifted, "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=symmetric)
    return int((factors.U.diagonal() < 0).sum())


def _critical_points(
    equations: FabricEquations, before: PathPoint, after: PathPoint, length: float
) -> Iterator[PathPoint]:
    """The points between two at which an eigenvalue is zero, by root finding along the branch."""
    few, many = sorted((before.unstable, after.unstable))
    critical: Sequence[int] = range(few, min(many, len(before.eigenvalues)))

    def at(distance: float) -> PathPoint:
        return _stepped(equations, before, distance, before.tangent)[0]

    def crossing(value: Callable[[PathPoint], float]) -> tuple[float, PathPoint] | None:
        try:
            distance = brentq(
                lambda distance: value(at(distance) if distance else before),
                0.0,
                length,
                xtol=min(1e-6, MIN_STEP),
            )
            return float(distance), at(float(distance))
        except (NotFollowed, ValueError):
            return None

    def eigenvalue(number: int) -> Callable[[PathPoint], float]:
        return lambda point: float(point.eigenvalues[number])

    turns = before.tangent[-1] * after.tangent[-1] < 0
    crossings = [(crossing(eigenvalue(number)), number) for number in critical]
    if turns and not critical:
        # A branch that ends on another turns there, and goes on as its mirror image.
        crossings = [(crossing(lambda point: point.tangent[-1]), 0)]
    known = [(*there, number) for there, number in crossings if there is not None]
    for _, point, number in sorted(known, key=lambda each: each[0]):
        # An eigenvalue that jumps over zero is of another branch.
        scale = max(abs(each.eigenvalues[number]) for each in (before, after))
        if abs(point.eigenvalues[number]) > NEARLY_ZERO * scale:
            continue
        # There is no single tangent at a branch point: that before it, or the mode, is of this one.
        tangent = before.tangent if critical else np.append(point.modes[:, number], 0.0)
        kind = Kind.limit if turns and critical else Kind.branch
        yield replace(point, kind=kind, tangent=tangent)
