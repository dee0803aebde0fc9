"""The fabric as a structured grid: its energy and forces by shifted arrays, without index lists.

The network of :mod:`knitlab.fabric.network` is regular: the ends of a spring and the cells beside
a hinge are neighbours on the grid. Every difference between nodes is a difference of two slices,
and a force is gathered from slices too. A step of the dynamics is a few loops over the grid then.

Periodic fabric is extended by the image of its first row and column of nodes, so that both kinds of
fabric have one more line of nodes than of cells. What lies on the images counts once.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from knitlab.dynamics.vectors import (
    Component,
    Vector,
    add,
    arctan2,
    cross,
    dot,
    norm,
    scale,
    subtract,
)
from knitlab.fabric.energy import Energy
from knitlab.fabric.fabric import Fabric
from knitlab.fabric.network import MeshShape
from knitlab.fabric.settings import FoldAngle
from knitlab.fabric.spring_law import SpringLaw

ALL, INNER = slice(None), slice(1, -1)
BEFORE, AFTER = slice(None, -1), slice(1, None)

Lines = Float[Array, "_ _"]
"""A component on some lines of the grid, whose number differs within a function."""
OnLines = tuple[Lines, Lines, Lines]


class Shape(NamedTuple):
    """Configuration of a fabric on the grid, its velocity, or a gradient with respect to it.

    Attributes:
        positions: components of the position of every node [mm].
        lengths: L_x and L_y of periodic fabric; without effect on a sample [mm].
    """

    positions: Vector
    lengths: Float[Array, "2"]


class Springs(eqx.Module):
    """Springs of one direction; those beyond an edge or on an image of a line have no stiffness."""

    stiffness: Float[Array, "row column"]
    rest_length: Float[Array, "row column"]
    law: SpringLaw

    def energy(self, along: Vector) -> Float[Array, ""]:
        """Energy of all springs, given the vectors along them [N mm]."""
        return jnp.sum(self.stiffness * self.law.stored(norm(along), self.rest_length))

    def gradient(self, along: Vector) -> Vector:
        """Derivative of the energy with respect to the vectors along them [N]."""
        pull_over_length = self.law.pull_over_length(norm(along), self.rest_length)
        return scale(self.stiffness * pull_over_length, along)


class Hinges(eqx.Module):
    """Hinges about the edges of one direction, on every line of the grid across it.

    Attributes:
        stiffness: k_t, 0 at an open edge and beyond it, where there is none [N mm].
        rest: signed fold angle at rest [rad].
        of: definition of the fold angle, a model option.
    """

    stiffness: Float[Array, "row column"]
    rest: Float[Array, "row column"]
    of: FoldAngle = eqx.field(static=True)

    def from_rest(self, edge: Vector, before: Vector, after: Vector) -> Component:
        """Fold angle minus its rest value, on the branch nearest zero [rad].

        It follows from the vectors along the edges [mm] and the normals of the cells before and
        after them, as long as the cells are large [mm²].
        """
        sine, cosine = self._sine_and_cosine(edge, before, after)
        angle = arctan2(sine, cosine) - self.rest
        return angle - 2 * np.pi * jnp.round(angle / (2 * np.pi))

    def energy(self, edge: Vector, before: Vector, after: Vector) -> Component:
        """Energy of every hinge [N mm]."""
        return 0.5 * self.stiffness * self.from_rest(edge, before, after) ** 2

    def gradient(
        self, edge: Vector, before: Vector, after: Vector
    ) -> tuple[Vector, Vector, Vector]:
        """Derivatives of the energy with respect to the edges and to the normals.

        :mod:`knitlab.fabric.fold_angle` derives the formulas.
        """
        sine, cosine = self._sine_and_cosine(edge, before, after)
        moment = self.stiffness * self.from_rest(edge, before, after)
        per_length = 1 / norm(edge)
        along = scale(per_length, edge)
        if self.of == "across_edge":
            one, other = dot(before, along), dot(after, along)
            before = subtract(before, scale(one, along))
            after = subtract(after, scale(other, along))
            by_before = scale(moment / dot(before, before), cross(before, along))
            by_after = scale(moment / dot(after, after), cross(along, after))
            turned = add(scale(one, by_before), scale(other, by_after))
            return scale(-per_length, turned), by_before, by_after
        turn = moment / (sine**2 + cosine**2)
        by_sine, by_cosine = turn * cosine, -turn * sine
        crossed = cross(before, after)
        return (
            scale(by_sine * per_length, subtract(crossed, scale(dot(crossed, along), along))),
            add(scale(by_sine, cross(after, along)), scale(by_cosine, after)),
            add(scale(by_sine, cross(along, before)), scale(by_cosine, before)),
        )

    def _sine_and_cosine(
        self, edge: Vector, before: Vector, after: Vector
    ) -> tuple[Component, Component]:
        """Sine and cosine of the fold angles, times the same positive number."""
        sine = dot(cross(before, after), edge) / norm(edge)
        cosine = dot(before, after)
        if self.of == "across_edge":
            cosine = cosine - dot(before, edge) * dot(after, edge) / dot(edge, edge)
        return sine, cosine


class GridFabric(eqx.Module):
    """A fabric on the structured grid.

    Attributes:
        weft, warp, rising, falling: springs along x, along y, and along both diagonals.
        wale, course: hinges about edges along y, and along x.
        z_max: half the gap between the walls [mm].
        k_wall: penalty stiffness of the walls [N/mm].
        periodic: whether the fabric is periodic.
    """

    weft: Springs
    warp: Springs
    rising: Springs
    falling: Springs
    wale: Hinges
    course: Hinges
    z_max: Float[Array, ""]
    k_wall: Float[Array, ""]
    periodic: bool = eqx.field(static=True)

    @classmethod
    def of(cls, shape: MeshShape, fabric: Fabric) -> "GridFabric":
        """A fabric of a mesh shape, whose elements are numbered as in the network."""
        rows, columns = shape.cells_y, shape.cells_x
        image = int(shape.periodic)
        # Lines of nodes are as they are, or with their image; cells get one more on every side.
        lines, cells = (0, image), (1, 1)
        springs, first = [], 0
        for size, around in (
            ((shape.nodes_y, columns), (lines, cells)),
            ((rows, shape.nodes_x), (cells, lines)),
            ((rows, columns), (cells, cells)),
            ((rows, columns), (cells, cells)),
        ):
            numbers = np.arange(first, first := first + size[0] * size[1]).reshape(size)
            places = np.pad(numbers, around, "edge")
            exists = np.pad(np.ones(size), around)
            springs.append(
                Springs(
                    jnp.asarray(fabric.stretch_stiffness)[places] * exists,
                    jnp.asarray(fabric.rest_length)[places],
                    fabric.spring_law.of(places),
                )
            )
        wales = rows * (columns if shape.periodic else columns - 1)
        hinges = []
        for own, size, across in (
            (slice(None, wales), (rows, -1), 1),
            (slice(wales, None), (-1, columns), 0),
        ):
            # The hinge on the image of the first line is that line's; open edges have none.
            lines, mode = ((0, 1), "wrap") if shape.periodic else ((1, 1), "constant")
            beyond = [(0, 0), (0, 0)]
            beyond[across] = lines
            beside = [(0, 0), (0, 0)]
            beside[1 - across] = cells
            stiffness, rest = (
                jnp.pad(jnp.pad(jnp.asarray(values)[own].reshape(size), beyond, mode), beside)
                for values in (fabric.fold_stiffness, fabric.rest_fold)
            )
            hinges.append(Hinges(stiffness, rest, fabric.fold_angle))
        weft, warp, rising, falling = springs
        wale, course = hinges
        return cls(
            weft,
            warp,
            rising,
            falling,
            wale,
            course,
            z_max=jnp.asarray(fabric.z_max),
            k_wall=jnp.asarray(fabric.k_wall),
            periodic=shape.periodic,
        )

    def energy(self, shape: Shape) -> Energy:
        """Elastic energy in its parts [N mm]."""
        weft, warp, rising, falling = _edges(self._surrounded(shape))
        wale, course = _hinged(weft, warp, cross(rising, falling))
        return Energy(
            stretch=self.weft.energy(_at(weft, INNER, ALL))
            + self.warp.energy(_at(warp, ALL, INNER))
            + self.rising.energy(rising)
            + self.falling.energy(falling),
            fold=self.wale.energy(*wale)[:, self._counted].sum()
            + self.course.energy(*course)[self._counted].sum(),
            wall=0.5 * self.k_wall * jnp.sum(self._beyond(shape.positions[2]) ** 2),
        )

    def gradient(self, shape: Shape, walls: bool = True) -> Shape:
        """Derivative of the elastic energy, minus the force, with or without the walls [N]."""
        weft, warp, rising, falling = _edges(self._surrounded(shape))
        wale, course = _hinged(weft, warp, cross(rising, falling))
        by_warp, wale_before, wale_after = self.wale.gradient(*wale)
        by_weft, course_before, course_after = self.course.gradient(*course)
        if self.periodic:
            by_warp = _cleared(by_warp, np.s_[:, -1])
            by_weft = _cleared(by_weft, np.s_[-1])
        # A cell is before the hinges on its far lines, and after those on its near lines.
        by_normal = add(
            _at(wale_before, INNER, AFTER),
            _at(wale_after, INNER, BEFORE),
            _at(course_before, AFTER, INNER),
            _at(course_after, BEFORE, INNER),
        )
        by_normal = jax.tree.map(lambda part: jnp.pad(part, 1), by_normal)
        # The edge of a course hinge points to −x.
        along_weft = subtract(self.weft.gradient(_at(weft, INNER, ALL)), by_weft)
        along_warp = add(self.warp.gradient(_at(warp, ALL, INNER)), by_warp)
        along_rising = add(self.rising.gradient(rising), cross(falling, by_normal))
        along_falling = add(self.falling.gradient(falling), cross(by_normal, rising))
        x, y, z = map(_gathered, along_weft, along_warp, along_rising, along_falling)
        lengths = jnp.zeros(2)
        if self.periodic:
            lengths = jnp.stack([x[:, -1].sum(), y[-1].sum()])
            x, y, z = map(_images_added, (x, y, z))
        if walls:
            z = z + self.k_wall * self._beyond(shape.positions[2])
        return Shape((x, y, z), lengths)

    @property
    def _counted(self) -> slice:
        """The lines that are not images."""
        return BEFORE if self.periodic else ALL

    def _beyond(self, heights: Component) -> Component:
        """How far nodes are beyond the walls, with the sign of their height [mm]."""
        return heights - jnp.clip(heights, -self.z_max, self.z_max)

    def _surrounded(self, shape: Shape) -> Vector:
        """Positions on all lines, and on one more on every side [mm].

        Beyond an open edge the sheet goes on straight, so that normals exist; nothing acts there.
        """
        (x, y, z), (length_x, length_y) = shape.positions, shape.lengths
        return (
            _extended(x, self.periodic, length_x, 0.0),
            _extended(y, self.periodic, 0.0, length_y),
            _extended(z, self.periodic, 0.0, 0.0),
        )


def _hinged(
    weft: OnLines, warp: OnLines, normals: OnLines
) -> tuple[tuple[OnLines, OnLines, OnLines], tuple[OnLines, OnLines, OnLines]]:
    """Edge, normal before and normal after, of the wale hinges and of the course hinges."""
    x, y, z = _at(weft, INNER, ALL)
    return (
        (_at(warp, ALL, INNER), _at(normals, ALL, BEFORE), _at(normals, ALL, AFTER)),
        ((-x, -y, -z), _at(normals, BEFORE, ALL), _at(normals, AFTER, ALL)),
    )


def _at(vector: OnLines, rows: slice, columns: slice) -> OnLines:
    return jax.tree.map(lambda part: part[rows, columns], vector)


def _cleared(vector: Vector, lines: Any) -> Vector:
    return jax.tree.map(lambda part: part.at[lines].set(0.0), vector)


def _extended(
    part: Lines, periodic: bool, offset_x: Array | float, offset_y: Array | float
) -> Lines:
    """One component of the positions, with a line before the first and one after the last.

    Periodic fabric gets two lines after the last: the image of the first, and the one beyond.
    """
    if periodic:
        part = jnp.concatenate([part[-1:] - offset_y, part, part[:2] + offset_y], axis=0)
        return jnp.concatenate([part[:, -1:] - offset_x, part, part[:, :2] + offset_x], axis=1)
    part = jnp.concatenate([2 * part[:1] - part[1:2], part, 2 * part[-1:] - part[-2:-1]], axis=0)
    return jnp.concatenate(
        [2 * part[:, :1] - part[:, 1:2], part, 2 * part[:, -1:] - part[:, -2:-1]], axis=1
    )


def _edges(around: OnLines) -> tuple[OnLines, OnLines, OnLines, OnLines]:
    """Vectors along the weft, along the warp, and along both diagonals of every cell [mm]."""
    return (
        subtract(_at(around, ALL, AFTER), _at(around, ALL, BEFORE)),
        subtract(_at(around, AFTER, ALL), _at(around, BEFORE, ALL)),
        subtract(_at(around, AFTER, AFTER), _at(around, BEFORE, BEFORE)),
        subtract(_at(around, AFTER, BEFORE), _at(around, BEFORE, AFTER)),
    )


def _gathered(weft: Lines, warp: Lines, rising: Lines, falling: Lines) -> Lines:
    """One component of the gradient at every node, from those with respect to the vectors."""
    return (
        weft[:, BEFORE]
        - weft[:, AFTER]
        + warp[BEFORE]
        - warp[AFTER]
        + rising[BEFORE, BEFORE]
        - rising[AFTER, AFTER]
        + falling[BEFORE, AFTER]
        - falling[AFTER, BEFORE]
    )


def _images_added(part: Lines) -> Lines:
    """One component of the gradient at the nodes of periodic fabric: that of images added."""
    part = part[:-1].at[0].add(part[-1])
    return part[:, :-1].at[:, 0].add(part[:, -1])
